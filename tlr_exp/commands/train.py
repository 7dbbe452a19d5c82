"""``tlr-train``: one run from the command line; it wires the parts.

Hydra hands many (``-m``) to the sweeper in ``hydra_plugins``: each of them is a process that uses
these parts.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
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
from tlr_exp.machine.terminal import refuse_without_docstrings, show_any_text
from tlr_exp.records.run_directory import FINISHED, RunDirectory, RunDirectoryError
from tlr_exp.records.storage import StorageError
from tlr_exp.training.next_scale import next_step
from tlr_exp.training.resuming import FinishedError, is_run, resumption, run_to_resume, store_of_run
from tlr_exp.training.run import (
    EXIT_CONFIG,
    EXIT_FAILED,
    EXIT_INTERRUPTED,
    check_inputs,
    explained_failures,
    open_run,
    print_error,
    tracking_uri,
    train_in,
)

if TYPE_CHECKING:
    from tlr_exp.training.loop import Outcome


def main() -> None:
    """Entry point of ``tlr-train``."""
    show_any_text()
    refuse_without_docstrings("tlr-train")
    for name, value in OPENMP_DEFAULTS.items():
        os.environ.setdefault(name, value)
    explain_mistakes(sys.argv[1:])
    _train()  # type: ignore[call-arg]  # Hydra passes the configuration


@hydra.main(version_base="1.3", config_path=CONFIG_PATH, config_name="config")
def _train(config: DictConfig) -> None:
    with _errors_for_people():
        if HydraConfig.get().mode == RunMode.MULTIRUN:
            raise ConfigError(OTHER_SWEEPER)
        settings = load_settings(config)
        if is_run(settings.resume):
            _go_on_with(settings.resume, plain_config(config))
            return
        uri = tracking_uri(settings)
        check_inputs(settings)
        plain = with_absolute_paths(plain_config(config))
        settings.init_from = plain[INITIAL]
        method = HydraConfig.get().runtime.choices["optimizer"]
        run = open_run(settings, plain, method, go_on=settings.resume == "auto")
        if run.status == FINISHED:
            print(f"this configuration has been trained already: {run.path}")
            return
        with run.lock():
            outcome = train_in(run, settings, uri)
        _leave_unless_finished(run, outcome)
        advice = next_step(settings, run.metrics(), HydraConfig.get().overrides.task)
        if advice is not None:
            print(f"next             {advice}")


def _go_on_with(path: str, asked: dict[str, Any]) -> None:
    """``resume=PATH``: train the rest of that run, by its own configuration."""
    run = run_to_resume(path)
    keys = overridden_keys(HydraConfig.get().overrides.task)
    with run.lock():
        try:
            found = resumption(run, keys, asked)
        except FinishedError as finished:
            print(finished)
            return
        settings = found.settings
        is_auto = settings.tracking_uri == "auto"
        uri = store_of_run(run) if is_auto else tracking_uri(settings)
        check_inputs(settings)
        found.record()
        outcome = train_in(run, settings, uri)
    _leave_unless_finished(run, outcome)


def _leave_unless_finished(run: RunDirectory, outcome: Outcome) -> None:
    if outcome.status != FINISHED:
        print(f"go on            tlr-train resume={run.path}")
        sys.exit(EXIT_INTERRUPTED)


@contextmanager
def _errors_for_people() -> Iterator[None]:
    """Errors that have an explanation are printed without a traceback."""
    try:
        yield
    except (ConfigError, RunDirectoryError) as error:
        print_error(error)
        sys.exit(EXIT_CONFIG)
    except KeyboardInterrupt:
        print("interrupted; go on by tlr-train resume=RUN_DIRECTORY", file=sys.stderr)
        sys.exit(EXIT_INTERRUPTED)
    except (StorageError, *explained_failures()) as error:
        print_error(error)
        sys.exit(EXIT_FAILED)


if __name__ == "__main__":
    main()
