"""Exported tables are held to what tlr-export would have refused, whoever made them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from studies import load_study, make_study

from analysis.data.check import checked, rechecked
from analysis.data.runs import RunRecord, records_of
from analysis.data.study import Study, StudyError
from analysis.data.tables import write_tables


def study_of(*arms: str) -> Study:
    return make_study(np.random.default_rng(0), arms or ("fixed", "gwo"), range(3), iterations=4)


def with_config(study: Study, run: str, **changes: object) -> Study:
    """The study with keys of group `ppo` changed in the configuration of a run."""
    runs = study.runs.copy()
    config = json.loads(str(runs.loc[run, "config"]))
    config["ppo"] |= changes
    runs.loc[run, "config"] = json.dumps(config)
    return replace(study, runs=runs)


def lines_of(study: Study) -> list[str]:
    with pytest.raises(StudyError) as error:
        rechecked(study)
    return str(error.value).splitlines()


@pytest.mark.parametrize(
    "arms",
    [
        ("fixed", "gwo"),
        ("gwo, threshold_share=0.02", "gwo, threshold_share=0.5"),
        ("fixed", "gwo, pack_size=10, threshold_share=0.1", "gwo, pack_size=10"),
    ],
)
def test_sound_tables_stay_as_they_are(arms: tuple[str, ...], tmp_path: Path) -> None:
    study = study_of(*arms)
    write_tables(study, tmp_path / "tables")
    found = load_study([tmp_path / "tables"])
    assert (found.arms, found.notes) == (study.arms, ())


def test_a_setting_beside_the_arms_is_refused_by_run_and_key() -> None:
    study = study_of()
    first, *_, last = study.runs.index
    (line,) = lines_of(with_config(study, last, gamma=0.9))
    assert line == f"{last}: ppo.gamma is 0.9, but 0.99 in {first} and 4 more"


def test_an_arm_that_differs_in_more_than_its_name_says_is_refused() -> None:
    study = study_of()
    for run in study.runs.index[3:]:
        study = with_config(study, run, gamma=0.9)
    assert [line.split(": ")[0] for line in lines_of(study)] == list(study.runs.index[3:])


def test_an_unfinished_run_is_refused_unless_it_is_noted() -> None:
    records = records_of(study_of())
    records[5] = replace(records[5], status="running", curve=records[5].curve.iloc[:2])
    study = checked(records, allow_unfinished=True)
    assert rechecked(study).notes == study.notes
    (line,) = lines_of(replace(study, notes=()))
    assert line == f"{records[5].name}: still running, or was killed, after 2 of 4 iterations"


def test_settings_that_were_passed_over_at_the_export_are_no_news() -> None:
    def changed(run: RunRecord) -> RunRecord:
        return replace(run, config={**run.config, "ppo": {**run.config["ppo"], "gamma": 0.9}})

    records = records_of(study_of())
    study = checked([changed(records[0]), *records[1:]], ignore=["ppo.gamma"])
    assert [note for note in study.notes if note.startswith("ppo.gamma differs: ")]
    assert rechecked(study).notes == study.notes


def test_unequal_seeds_are_noted() -> None:
    study = study_of()
    last = study.runs.index[-1]
    curves = study.curves.set_index("run").drop(index=last).reset_index()
    found = rechecked(Study(study.runs.drop(index=last), curves))
    assert found.notes == ("arm 'gwo' lacks seed 2, which 'fixed' has",)


def test_a_configuration_that_is_none_is_named() -> None:
    study = study_of()
    runs = study.runs.copy()
    runs.loc[runs.index[0], "config"] = '{"ppo": '
    (line,) = lines_of(replace(study, runs=runs))
    assert line == f"""{runs.index[0]}: its config is '{{"ppo": '; it must be a JSON object"""
