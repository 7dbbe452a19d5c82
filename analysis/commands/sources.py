"""Arguments that say which runs make a study, shared by commands, and the study they ask for."""

import argparse
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from analysis.data.check import checked, rechecked
from analysis.data.disturbed import disturbed_runs, read_disturbed
from analysis.data.motions import checked_by_motion, with_the_same_arms
from analysis.data.publishable import publishable
from analysis.data.run_directories import arms_of_sweep, from_run_directories
from analysis.data.runs import RunRecord, records_of
from analysis.data.settings import OPTIMIZER
from analysis.data.starts import of_runs, read_starts, starts_beside
from analysis.data.study import Remedy, Study, StudyError
from analysis.data.tables import exported_in, from_tables, is_exported
from tlr_exp.config.input_files import MOTION
from tlr_exp.config.nested import covers
from tlr_exp.machine import variables
from tlr_exp.mlflow_sync.tracking_uri import STORE, default_tracking_uri
from tlr_exp.records.places import plain_text

RUNS_DIR = Path("runs")  # where the store is looked for unless a URI is given


def load_studies(
    sources: Iterable[str | Path] = (),
    experiment: str | None = None,
    tracking_uri: str | None = None,
    sweep: str | None = None,
    arm_keys: Sequence[str] | None = None,
    starts: str | Path | None = None,
    **choices: Any,
) -> dict[str, Study]:
    """The study of the runs in `sources`, or of an MLflow experiment in their place, by motion.

    A source is a run directory, a folder with runs, the directory of a sweep, an exported study, or
    a folder with one of each motion. Exported studies without `arm_keys` or `choices` keep their
    arms (`check.rechecked` says what is refused); all else is checked (`check.checked`, which
    explains the `choices`). Without `arm_keys`, the arms are those of the sweep, or the optimizers.
    There is a study for each motion of the runs, but one where a motion is chosen or may differ.
    Hosts and paths are made publishable. Roll-outs are those of the CSV ``starts``, else of the
    exported studies and of a CSV that lies beside the runs.

    Raises:
        StudyError: one line for each problem.
    """
    paths = [each for source in sources for each in exported_in(Path(source))]
    if paths and all(map(is_exported, paths)) and arm_keys is None and not any(choices.values()):
        studies = [_as_exported(path, starts) for path in paths]
        motions = [study.runs["motion"].iloc[0] for study in studies]
        if len(set(motions)) == len(studies):
            return with_the_same_arms(dict(zip(motions, studies, strict=True)))
    unfinished = bool(choices.get("allow_unfinished"))
    found = _found(paths, experiment, tracking_uri, sweep, unfinished)
    arms = arm_keys or found.arm_keys
    may_differ = covers([*arms, *choices.get("ignore", ())], MOTION)
    if choices.get("motion") or may_differ or not found.records:
        study = found.with_all(checked(found.records, arms, **choices), starts)
        return {study.runs["motion"].iloc[0]: study}
    studies = checked_by_motion(found.records, arms, **choices)
    return {motion: found.with_all(study, starts) for motion, study in studies.items()}


def _as_exported(path: Path, starts: str | Path | None) -> Study:
    study = rechecked(from_tables(path))
    return study if starts is None else _with_starts(study, [read_starts(Path(starts))])


@dataclass(frozen=True)
class _Found:
    """What lies in the sources, before it is a study; the arms are those of the sweep, if any."""

    records: list[RunRecord]
    arm_keys: tuple[str, ...]
    exported: list[Study]
    folders: list[Path]

    def with_all(self, study: Study, starts: str | Path | None) -> Study:
        """A study of these runs, with the notes of earlier exports, which hold still; roll-outs."""
        notes = [note for each in self.exported for note in each.notes]
        study = replace(study, notes=tuple(dict.fromkeys([*notes, *study.notes])))
        beside = dict.fromkeys(filter(None, (starts_beside(f, "disturbed") for f in self.folders)))
        tables = [read_disturbed(path) for path in beside]
        disturbed, said = disturbed_runs(tables, list(study.runs.index))
        notes = tuple(dict.fromkeys([*study.notes, *said]))
        study = replace(study, disturbed=disturbed, notes=notes)
        return _with_starts(study, _roll_outs(self.exported, self.folders, starts))


def _found(
    paths: Sequence[Path],
    experiment: str | None,
    tracking_uri: str | None,
    sweep: str | None,
    allow_unfinished: bool,
) -> _Found:
    if bool(paths) == bool(experiment):
        raise StudyError("give either sources or an experiment")
    exported = [from_tables(path) for path in paths if is_exported(path)]
    folders = [path for path in paths if not is_exported(path)]
    records = [record for study in exported for record in records_of(study)]
    if experiment:
        from analysis.data.load import from_mlflow  # MLflow takes seconds to import

        records += from_mlflow(tracking_uri or default_tracking_uri(RUNS_DIR), experiment, sweep)
    if folders:
        records += from_run_directories(folders, allow_unfinished)
    told = dict.fromkeys(key for folder in folders for key in arms_of_sweep(folder))
    arm_keys = tuple(key for key in told if not covers([key], MOTION))
    return _Found(publishable(records), arm_keys or (OPTIMIZER,), exported, folders)


def _roll_outs(
    exported: Sequence[Study], folders: Sequence[Path], starts: str | Path | None
) -> list[pd.DataFrame]:
    """Those in the CSV `starts`; without one, those of exported studies, and beside runs."""
    if starts is not None:
        return [read_starts(Path(starts))]
    beside = dict.fromkeys(filter(None, map(starts_beside, folders)))
    return [
        *(study.starts for study in exported if len(study.starts)),
        *(read_starts(path) for path in beside),
    ]


def _with_starts(study: Study, tables: Sequence[pd.DataFrame]) -> Study:
    """The study with the roll-outs of its runs that are in `tables`, and notes on them."""
    starts, said = of_runs(tables, list(study.runs.index))
    return replace(study, starts=starts, notes=tuple(dict.fromkeys([*study.notes, *said])))


def add_sources(parser: argparse.ArgumentParser) -> None:
    """Arguments that say where the runs are."""
    parser.add_argument(
        "sources",
        nargs="*",
        metavar="SOURCE",
        help="a run directory, a folder of runs (runs/STUDY), a sweep directory "
        "(runs/STUDY/sweeps/NAME-ID), or an exported study",
    )
    parser.add_argument(
        "--experiment", metavar="NAME", help="the runs of an MLflow experiment instead of SOURCE"
    )
    parser.add_argument(
        "--sweep", metavar="NAME-ID", help="only the experiment's runs in this sweep"
    )
    parser.add_argument(
        "--tracking-uri",
        metavar="URI",
        help="http://HOST:PORT or sqlite:///FILE (default: the variable "
        f"{variables.TRACKING_URI}, else sqlite:///{RUNS_DIR / STORE})",
    )
    parser.add_argument(
        "--starts",
        metavar="CSV",
        type=Path,
        help="the runs' roll-outs, as written by tlr-evaluate FOLDER --starts N (default: the "
        "starts-N.csv beside the runs)",
    )


def add_selection(parser: argparse.ArgumentParser) -> None:
    """Arguments that say which runs make the study, and what its arms are."""
    parser.add_argument(
        "--arms",
        metavar="KEYS",
        default="",
        help="configuration keys in which the arms differ, separated by commas (default: those of "
        f"the sweep, or {OPTIMIZER}; e.g. {OPTIMIZER},reward.objective.threshold_share)",
    )
    parser.add_argument("--baseline", metavar="ARM", default="", help="default: fixed, else first")
    parser.add_argument(
        "--allow-unfinished", action="store_true", help="use runs as far as they have got"
    )
    parser.add_argument(
        "--seeds",
        choices=["all", "common"],
        help="common: leave out the seeds that not every arm has finished (default: all)",
    )
    parser.add_argument(
        "--duplicates",
        choices=["refuse", "newest"],
        help="newest: if an arm and seed has several runs, take the newest finished one "
        "(default: refuse)",
    )
    parser.add_argument(
        "--ignore",
        metavar="KEYS",
        default="",
        help="further configuration keys that may differ, separated by commas",
    )
    parser.add_argument(
        "--motion", metavar="NAME", default="", help="take only the runs of this motion"
    )


def check_sources(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Exit with status 2 where the arguments of `add_sources` do not go together."""
    if bool(options.sources) == bool(options.experiment):
        parser.error("give either SOURCE or --experiment")
    if options.experiment is None and (options.tracking_uri or options.sweep):
        parser.error("--tracking-uri and --sweep need --experiment")


def studies_of(options: argparse.Namespace) -> dict[str, Study]:
    """The studies, by motion, that the arguments of `add_sources` and `add_selection` ask for.

    Raises:
        StudyError: names everything that speaks against it.
    """
    chosen = {
        "allow_unfinished": options.allow_unfinished,
        "seeds": options.seeds,
        "duplicates": options.duplicates,
        "ignore": _keys(options.ignore),
        "motion": options.motion,
        "baseline": options.baseline,
    }
    return load_studies(
        options.sources,
        options.experiment,
        options.tracking_uri,
        options.sweep,
        _keys(options.arms) or None,
        options.starts,
        **{name: value for name, value in chosen.items() if value},
    )


def source_names(options: argparse.Namespace) -> list[str]:
    """What the arguments of `add_sources` name, without places."""
    if options.experiment is None:
        return [plain_text(str(path)) for path in options.sources]
    sweep = f", sweep {options.sweep}" if options.sweep else ""
    return [f"MLflow experiment {options.experiment}{sweep}"]


def _keys(text: str) -> list[str]:
    return [key.strip() for key in text.split(",") if key.strip()]


_ADVICE = {
    Remedy.UNFINISHED: "--allow-unfinished uses runs as far as they have got",
    Remedy.WITHOUT_RUN: "--allow-unfinished leaves out jobs without a run",
    Remedy.COMMON_SEEDS: "--seeds common leaves out what not every arm has finished",
    Remedy.NEWEST: "--duplicates newest takes the newest finished run",
    Remedy.KEYS: "--arms compares runs by such a key, --ignore ignores it",
    Remedy.ONE_MOTION: "--motion NAME takes the runs of one motion",
    Remedy.REPLACE: "--force replaces the tables in it",
}


@contextmanager
def advice() -> Iterator[None]:
    """Problems of a study are told with the arguments that would take such runs all the same.

    Raises:
        StudyError: as the body, with the advice.
    """
    try:
        yield
    except StudyError as error:
        hints = [hint for remedy, hint in _ADVICE.items() if remedy in error.remedies]
        problems = "\n".join([str(error), *(f"({hint})" for hint in hints)])
        raise StudyError(problems, *error.remedies) from error
