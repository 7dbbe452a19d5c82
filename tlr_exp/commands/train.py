"""``tlr-train``: one run from the command line; it wires the parts.

Hydra hands many (``-m``) to the sweeper in ``hydra_plugins``: each of them is a process that uses
these parts.
"""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING, Any

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig

from tlr_exp.config.input_files import INITIAL
from tlr_exp.config.load import (
    CONFIG_PATH,
    ConfigError,
    load_settings,
    plain_config,
    with_absolute_paths,
)
from tlr_exp.config.overrides import OTHER_SWEEPER, explain_mistakes, overridden_keys
from tlr_exp.machine.cores import OPENMP_DEFAULTS
from tlr_exp.machine.terminal import (
    EXIT_INTERRUPTED,
    command,
    refuse_without_docstrings,
    show_any_text,
    version_of,
)
from tlr_exp.records.directory import FINISHED
from tlr_exp.records.run_directory import RunDirectory, RunDirectoryError
from tlr_exp.training.next_scale import next_step
from tlr_exp.training.resuming import FinishedError, is_run, resumption, run_to_resume, store_of_run
from tlr_exp.training.run import check_inputs, open_run, tracking_uri, train_in

if TYPE_CHECKING:
    from tlr_exp.training.loop import Outcome


def main() -> None:
    """Entry point of ``tlr-train``."""
    if "--version" in sys.argv[1:]:  # Hydra would tell its own
        print(version_of("tlr-train"))
        return
    show_any_text()
    refuse_without_docstrings("tlr-train")
    for name, value in OPENMP_DEFAULTS.items():
        os.environ.setdefault(name, value)
    explain_mistakes(sys.argv[1:])
    _train()  # type: ignore[call-arg]  # Hydra passes the configuration


@hydra.main(version_base="1.3", config_path=CONFIG_PATH, config_name="config")
def _train(config: DictConfig) -> None:
    status = train(config)
    if status:
        sys.exit(status)  # what it means has been told, and Hydra would tell it by a traceback


@command(
    "tlr-train",
    wrong=(ConfigError, RunDirectoryError),
    interrupted="interrupted; continue with tlr-train resume=RUN_DIRECTORY",
)
def train(config: DictConfig) -> int:
    """One run, as Hydra's configuration says. 0: trained; 1: failed; 2: wrong; 130: interrupted."""
    if HydraConfig.get().mode == RunMode.MULTIRUN:
        raise ConfigError(OTHER_SWEEPER)
    settings = load_settings(config)
    if is_run(settings.resume):
        return _go_on_with(settings.resume, plain_config(config))
    uri = tracking_uri(settings)
    parts = check_inputs(settings)
    plain = with_absolute_paths(plain_config(config))
    settings.init_from = plain[INITIAL]
    method = HydraConfig.get().runtime.choices["optimizer"]
    run = open_run(settings, plain, method, go_on=settings.resume == "auto")
    if run.status == FINISHED:
        print(f"this configuration has been trained already: {run.path}")
        return 0
    with run.lock():
        outcome = train_in(run, settings, parts, uri)
    if outcome.status == FINISHED:
        advice = next_step(settings, run.metrics(), HydraConfig.get().overrides.task)
        if advice is not None:
            print(f"next             {advice}")
    return _how_it_ended(run, outcome)


def _go_on_with(path: str, asked: dict[str, Any]) -> int:
    """``resume=PATH``: train the rest of that run, by its own configuration."""
    run = run_to_resume(path)
    keys = overridden_keys(HydraConfig.get().overrides.task)
    with run.lock():
        try:
            found = resumption(run, keys, asked)
        except FinishedError as finished:
            print(finished)
            return 0
        settings = found.settings
        is_auto = settings.tracking_uri == "auto"
        uri = store_of_run(run) if is_auto else tracking_uri(settings)
        parts = check_inputs(settings)
        found.record()
        outcome = train_in(run, settings, parts, uri)
    return _how_it_ended(run, outcome)


def _how_it_ended(run: RunDirectory, outcome: Outcome) -> int:
    """The exit status; of a training that was stopped it is told how to go on."""
    if outcome.status == FINISHED:
        return 0
    print(f"continue         tlr-train resume={run.path}")
    return EXIT_INTERRUPTED


if __name__ == "__main__":
    main()
