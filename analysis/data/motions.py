"""A study on several motions: one study for each, with the same arms."""

from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

from analysis.data.check import checked
from analysis.data.runs import RunRecord
from analysis.data.study import Remedy, Study, StudyError


def motions_of(records: Sequence[RunRecord]) -> tuple[str, ...]:
    """The motions of the runs, in order of their names."""
    return tuple(sorted({record.motion for record in records}))


def checked_by_motion(
    records: Sequence[RunRecord], arm_keys: Sequence[str], **choices: Any
) -> dict[str, Study]:
    """A study for each motion of the runs, by the motion's short name; see ``check.checked``.

    Raises:
        StudyError: as ``checked``, or as ``with_the_same_arms``.
    """
    studies = {
        motion: checked(records, arm_keys, **{**choices, "motion": motion})
        for motion in motions_of(records)
    }
    return with_the_same_arms(studies)


def with_the_same_arms(studies: Mapping[str, Study]) -> dict[str, Study]:
    """The studies by the short names of their motions, "walk" for a file walk.npz.

    Raises:
        StudyError: a motion lacks an arm that another has, or has another baseline; or two motions
            have one short name.
    """
    named: dict[str, Study] = {}
    problems = []
    first = next(iter(studies))
    for motion, study in studies.items():
        name = PurePath(motion).stem
        if name in named:
            problems.append(f"two motions are called {name!r}: rename the file of one")
        named[name] = study
        if (study.arms, study.baseline) != (studies[first].arms, studies[first].baseline):
            problems.append(
                f"{motion} has the arms {', '.join(study.arms)}, but {first} has "
                f"{', '.join(studies[first].arms)}"
            )
    if problems:
        raise StudyError("\n".join(problems), Remedy.ONE_MOTION)
    return named
