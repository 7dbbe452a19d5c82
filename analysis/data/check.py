"""From runs as they were found to a study: refuse what cannot be compared, note what differs."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any, Literal

from analysis.data.runs import DIRTY, RunRecord, records_of, study_from
from analysis.data.settings import (
    OPTIMIZER,
    TOLD,
    arm_labels,
    differences,
    labelled_keys,
    spread,
    told_differences,
    unknown_keys,
)
from analysis.data.study import (
    Remedy,
    Study,
    StudyError,
    arm_order,
    iteration_problems,
)
from tlr_exp.config.identity import NOT_IDENTITY
from tlr_exp.config.input_files import MOTION
from tlr_exp.config.nested import covers, flat
from tlr_exp.keys import ITERATION
from tlr_exp.records.directory import FINISHED, RUNNING, STATUSES

Labelled = tuple[str, RunRecord]  # with the label of its arm


def checked(
    records: Sequence[RunRecord],
    arm_keys: Sequence[str] = (OPTIMIZER,),
    *,
    allow_unfinished: bool = False,
    seeds: Literal["all", "common"] = "all",
    duplicates: Literal["refuse", "newest"] = "refuse",
    ignore: Sequence[str] = (),
    motion: str = "",
    baseline: str = "",
) -> Study:
    """The study of `records`, whose arms differ in the configuration keys `arm_keys`.

    Refused are runs of several motions, since errors on one motion are none on another
    (`motions.py` makes a study of each); and all at once: unfinished runs and finished ones that
    lack iterations; seeds that one arm has and another lacks; two runs of one arm and seed;
    settings that differ beyond the arm keys, the seed, and the keys that do not change what is
    learned (`identity.NOT_IDENTITY`).
    Different commits, versions and machines are not refused but become notes of the study.

    allow_unfinished: take unfinished runs as far as they have come (those without any iteration are
        left out, and noted).
    seeds: "common" leaves out what not every arm has finished, and notes it.
    duplicates: "newest" keeps the newest finished run of an arm and seed, and notes the others.
    ignore: further keys or groups that may differ; differences are noted.
    motion: take the runs of this motion alone.
    baseline: the arm that others are compared with (see Study).

    Raises:
        StudyError: one line per problem, with the run's name.
    """
    if not records:
        raise StudyError("there is no run")
    records = _of_one_motion(records, motion, ignore)
    problems = [*_name_problems(records), *unknown_keys(records, [*arm_keys, *ignore])]
    if problems:
        raise StudyError("\n".join(problems))
    found: list[Labelled] = list(zip(arm_labels(records, arm_keys), records, strict=True))
    runs, notes = _chosen(found, allow_unfinished, seeds, duplicates)
    more = not (allow_unfinished or all(map(is_finished, records)))
    nothing = [] if runs else ["no run is left to compare", *notes]
    differ = differences([run for _, run in runs], arm_keys, [*NOT_IDENTITY, *ignore])
    _refuse(
        [
            (Remedy.UNFINISHED if more else None, nothing),
            (Remedy.UNFINISHED, [] if allow_unfinished else _unfinished_problems(runs)),
            (None, _damaged_problems(runs, allow_unfinished)),
            (Remedy.NEWEST, _duplicate_problems(runs)),
            (Remedy.COMMON_SEEDS, _seed_problems(runs)),
            (Remedy.KEYS, differ),
        ]
    )
    notes += [*_notes([run for _, run in runs], ignore)]
    order = arm_order([arm for arm, _ in runs])
    runs.sort(key=lambda labelled: (order.index(labelled[0]), labelled[1].seed))
    return study_from(runs, baseline=baseline, notes=tuple(notes))


def _refuse(found: Iterable[tuple[Remedy | None, Iterable[str]]]) -> None:
    """Raise all problems at once, if there are any, with what would take such runs all the same."""
    listed = [(remedy, [*problems]) for remedy, problems in found]
    lines = [line for _, problems in listed for line in problems]
    if lines:
        remedies = [remedy for remedy, problems in listed if remedy and problems]
        raise StudyError("\n".join(lines), *remedies)


def _of_one_motion(
    records: Sequence[RunRecord], motion: str, ignore: Sequence[str]
) -> Sequence[RunRecord]:
    """The runs of `motion`, or all where they have one, or where it may differ.

    Raises:
        StudyError: no run of this motion, or runs of several motions; names those there are.
    """
    motions = sorted({record.motion for record in records})
    if motion and motion not in motions:
        raise StudyError(f"no run has the motion {motion!r}; there are {', '.join(motions)}")
    if not motion and len(motions) > 1 and not covers(ignore, MOTION):
        raise StudyError(
            f"runs of several motions cannot be compared: {', '.join(motions)}", Remedy.ONE_MOTION
        )
    return [record for record in records if not motion or record.motion == motion]


def rechecked(study: Study) -> Study:
    """An exported study as it is, if it says of itself what tlr-export would have said.

    Its tables may have been made or joined by other means. Refused are unfinished runs, and
    settings that differ beyond the arms, unless the study's notes name them; seeds that one arm has
    and another lacks become notes.

    Raises:
        StudyError: one line per problem, with the run's name.
    """
    records = records_of(study)
    keys = {key for record in records for key in flat(record.comparable)}
    noted = [key for key in keys if any(note.startswith(f"{key} differs") for note in study.notes)]
    unfinished = [
        f"{run.name}: {_state(run)}"
        for run in records
        if not is_finished(run) and not any(n.startswith(f"{run.name} is ") for n in study.notes)
    ]
    arms = labelled_keys(records, study.arms)
    differ = differences(records, arms, [*NOT_IDENTITY, *noted])
    _refuse([(Remedy.UNFINISHED, unfinished), (Remedy.KEYS, differ)])
    seeds = [*_seed_problems([*zip(study.runs["arm"], records, strict=True)])]
    return replace(study, notes=tuple(dict.fromkeys([*study.notes, *seeds])))


def is_finished(run: RunRecord) -> bool:
    return run.status == FINISHED


# --- what is left out on request -------------------------------------------------------------
def _chosen(
    runs: list[Labelled], allow_unfinished: bool, seeds: str, duplicates: str
) -> tuple[list[Labelled], list[str]]:
    """The runs that the caller wants of those found, with a sentence on each that is left out."""
    notes: list[str] = []
    if duplicates == "newest":
        runs, said = _newest(runs)
        notes += said
    if allow_unfinished:
        runs, said = _with_iterations(runs)
        notes += said
    if seeds == "common" and runs:
        runs, said = _common(runs, allow_unfinished)
        notes += said
    return runs, notes


def _newest(runs: Sequence[Labelled]) -> tuple[list[Labelled], list[str]]:
    kept: dict[tuple[str, int], Labelled] = {}
    for labelled in sorted(runs, key=lambda each: (is_finished(each[1]), each[1].created_at)):
        kept[labelled[0], labelled[1].seed] = labelled
    notes = [
        f"{run.name} ({run.status}) was left out: {kept[arm, run.seed][1].name} is the newest "
        f"finished run of arm {arm!r} with seed {run.seed}"
        if is_finished(kept[arm, run.seed][1])
        else f"{run.name} ({run.status}) was left out: {kept[arm, run.seed][1].name} is newer"
        for arm, run in runs
        if kept[arm, run.seed][1] is not run
    ]
    return [each for each in runs if kept[each[0], each[1].seed][1] is each[1]], notes


def _with_iterations(runs: Sequence[Labelled]) -> tuple[list[Labelled], list[str]]:
    empty = [run for _, run in runs if len(run.curve) == 0 and not is_finished(run)]
    notes = [f"{run.name} ({run.status}) was left out: it has no iteration yet" for run in empty]
    unfinished = [run for _, run in runs if len(run.curve) and not is_finished(run)]
    notes += [
        f"{run.name} is {_state(run)}: statements on it are preliminary" for run in unfinished
    ]
    return [labelled for labelled in runs if labelled[1] not in empty], notes


def _common(runs: Sequence[Labelled], allow_unfinished: bool) -> tuple[list[Labelled], list[str]]:
    """The runs whose seeds every arm has, with the sentences on the others."""
    usable = [each for each in runs if allow_unfinished or is_finished(each[1])]
    seeds = _seeds(runs)
    for arm in seeds:
        seeds[arm] = {run.seed for label, run in usable if label == arm}
    common = set.intersection(*seeds.values())
    notes = []
    for _, run in runs:
        if not allow_unfinished and not is_finished(run):
            notes.append(f"{run.name} was left out: it is {_state(run)}")
        elif run.seed not in common:
            lacking = ", ".join(repr(other) for other in seeds if run.seed not in seeds[other])
            notes.append(f"{run.name} was left out: arm {lacking} has not finished seed {run.seed}")
    return [each for each in usable if each[1].seed in common], notes


# --- what is refused -------------------------------------------------------------------------
def _name_problems(records: Sequence[RunRecord]) -> Iterator[str]:
    """Two runs of one name, which would be one run in the frames."""
    by_name: dict[str, list[RunRecord]] = defaultdict(list)
    for record in records:
        by_name[record.name].append(record)
    for name, runs in by_name.items():
        if len(runs) > 1 and len({run.run_id for run in runs}) == 1:
            yield f"{name}: was given {len(runs)} times"
        elif len(runs) > 1:
            ids = ", ".join(f"{run.run_id} of {run.created_at}" for run in runs)
            yield f"{name}: {len(runs)} different runs have this name: {ids}"


def _unfinished_problems(runs: Sequence[Labelled]) -> Iterator[str]:
    for _, run in runs:
        if run.status in STATUSES and not is_finished(run):
            yield f"{run.name}: {_state(run)}"


def _damaged_problems(runs: Sequence[Labelled], allow_unfinished: bool) -> Iterator[str]:
    for _, run in runs:
        if run.status not in STATUSES:
            yield f"{run.name}: status {run.status!r}; known are {', '.join(STATUSES)}"
        elif allow_unfinished or is_finished(run):
            found = run.curve[ITERATION].to_numpy()
            yield from iteration_problems(run.name, found, run.iterations, run.status)


def _state(run: RunRecord) -> str:
    words = {RUNNING: "still running, or was killed,"}
    done = f"after {len(run.curve)} of {run.iterations} iterations"
    return f"{words.get(run.status, run.status)} {done}"


def _duplicate_problems(runs: Sequence[Labelled]) -> Iterator[str]:
    same: dict[tuple[str, int], list[str]] = defaultdict(list)
    for arm, run in runs:
        same[arm, run.seed].append(f"{run.name} ({run.status}, {run.created_at[:19]})")
    for (arm, seed), names in same.items():
        if len(names) > 1:
            yield f"arm {arm!r} has seed {seed} {len(names)} times: {', '.join(names)}"


def _seed_problems(runs: Sequence[Labelled]) -> Iterator[str]:
    seeds = _seeds(runs)
    for seed in sorted(set().union(*seeds.values())):
        having = [arm for arm in seeds if seed in seeds[arm]]
        for arm in seeds:
            if arm not in having:
                yield f"arm {arm!r} lacks seed {seed}, which {', '.join(map(repr, having))} has"


def _seeds(runs: Sequence[Labelled]) -> dict[str, set[int]]:
    seeds: dict[str, set[int]] = defaultdict(set)
    for arm, run in runs:
        seeds[arm].add(run.seed)
    return dict(seeds)


# --- what is noted ---------------------------------------------------------------------------
def _notes(records: Sequence[RunRecord], ignore: Sequence[str]) -> Iterator[str]:
    """Sentences on what differs between runs without making them incomparable."""
    names = [record.name for record in records]

    def differing(what: str, values: Sequence[Any]) -> Iterator[str]:
        yield from spread(what, [str(value) for value in values], names)

    yield from differing("source revisions differ", [record.commit[:12] for record in records])
    dirty = [record.name for record in records if record.commit.endswith(DIRTY)]
    if dirty:
        yield f"made with local changes to the source: {', '.join(dirty)}"
    for package in sorted({name for record in records for name in record.packages}):
        versions = [record.packages.get(package, "none") for record in records]
        yield from differing(f"versions of {package} differ", versions)
    machines = [f"{record.host} ({record.cpu_model})" for record in records]
    for note in differing("machines differ", machines):
        yield f"{note}; wall-clock times of different machines cannot be compared"
    yield from told_differences(records, [*TOLD, *ignore])
