"""Runs of several motions, from run directories to tables to a report on all and one on each."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from studies import make_study, with_starts, write_run_directories

from analysis.commands import export, report
from analysis.commands.sources import load_studies
from analysis.data.motions import with_the_same_arms
from analysis.data.study import Remedy, Study, StudyError
from analysis.measures.motions import over_motions
from analysis.report.motions import gather_motions
from tlr_exp import keys


def on_motion(study: Study, motion: str) -> Study:
    """The study as if its runs were of another motion."""
    names = {name: f"{motion}-{name}" for name in study.runs.index}
    configs = []
    for text in study.runs["config"]:
        config = json.loads(text)
        configs.append(json.dumps({**config, "env": {**config["env"], "motion": motion}}))
    starts = study.starts
    if len(starts):
        starts = starts.assign(run=starts["run"].map(names))
    return replace(
        study,
        runs=study.runs.rename(index=names).assign(motion=motion, config=configs),
        curves=study.curves.assign(run=study.curves["run"].map(names)),
        starts=starts,
    )


def two_motions(effects: dict[str, float], **arguments) -> dict[str, Study]:
    random = np.random.default_rng(0)
    return {
        motion: on_motion(
            make_study(random, seeds=range(4), iterations=20, effect=effect, **arguments), motion
        )
        for motion, effect in effects.items()
    }


def test_measures_are_taken_motion_by_motion():
    studies = two_motions({"walk": 0.1, "run": 0.1})
    found = {each.measure: each for each in over_motions(studies, "gwo")}
    upper = found[keys.TRAIN_UPPER_BODY_ERROR]
    assert list(upper.baseline) == ["walk", "run"]
    _, _, curves = studies["run"].matrix(keys.TRAIN_UPPER_BODY_ERROR, "gwo")
    np.testing.assert_allclose(upper.treatment["run"], curves[:, 16:].mean(axis=1))


def test_a_measure_that_one_motion_lacks_is_left_out():
    studies = two_motions({"walk": 0.1, "run": 0.1})
    without = studies["run"].curves.drop(columns=keys.TRAIN_LOWER_BODY_ERROR)
    studies["run"] = replace(studies["run"], curves=without)
    measures = {each.measure for each in over_motions(studies, "gwo")}
    assert keys.TRAIN_UPPER_BODY_ERROR in measures
    assert keys.TRAIN_LOWER_BODY_ERROR not in measures


def test_the_answer_says_where_it_is_better_and_where_worse():
    studies = two_motions({"walk": 0.4, "run": -0.4}, seed_spread=0.005, noise=0.01)
    told = gather_motions(studies, ["tlr-train"], {name: f"{name}.html" for name in studies})
    assert told.banner.startswith("A run of this scale")  # demo is evidence for nothing
    assert "Over 2 motions" in told.answer[0]
    assert "better on walk" in told.answer[1]
    assert "worse on run" in told.answer[1]
    pooled = next(
        each for each in told.numbers["motions"] if each["measure"] == keys.TRAIN_UPPER_BODY_ERROR
    )
    # The ratios are 0.6 and 1.4; their geometric mean is 0.917.
    assert pooled["pooled"]["improvement"]["estimate"] == pytest.approx(1 - 0.917, abs=0.03)


def test_what_was_measured_without_noise_is_told_first():
    random = np.random.default_rng(1)
    studies = {
        motion: with_starts(study, random, factor={"upper_body_error_m": 0.5})
        for motion, study in two_motions({"walk": 0.0, "run": 0.0}).items()
    }
    told = gather_motions(studies, ["tlr-train"], {name: f"{name}.html" for name in studies})
    assert "without exploration noise" in told.answer[0]
    assert "better in one body" in told.answer[0]


def test_motions_must_have_the_same_arms():
    studies = two_motions({"walk": 0.1})
    other = make_study(np.random.default_rng(0), ("fixed", "zero"), [0, 1], 10)
    with pytest.raises(
        StudyError, match="run has the arms fixed, zero, but walk has fixed, gwo"
    ) as error:
        with_the_same_arms({**studies, "run": on_motion(other, "run")})
    assert error.value.remedies == (Remedy.ONE_MOTION,)


def test_two_files_of_one_name_are_refused():
    study = two_motions({"walk": 0.1})["walk"]
    with pytest.raises(StudyError, match="two motions are called 'walk'"):
        with_the_same_arms({"walk": study, "mine/walk.npz": study})


def test_from_run_directories_to_tables_and_a_report(tmp_path: Path, capsys):
    for study in two_motions({"walk": 0.2, "run": 0.1}).values():
        write_run_directories(study, tmp_path / "runs")
    results = tmp_path / "results"
    assert export.main([str(tmp_path / "runs"), "-o", str(results)]) == 0
    assert {each.name for each in results.iterdir()} == {"walk", "run", "motions.json"}
    assert set(load_studies([results])) == {"walk", "run"}
    assert set(load_studies([tmp_path / "runs"], motion="walk")) == {"walk"}
    capsys.readouterr()
    page = tmp_path / "report"
    assert report.main([str(results), "-o", str(page)]) == 0
    assert (page / "walk" / "report.html").is_file()
    assert (page / "run" / "report.html").is_file()
    text = (page / "report.md").read_text(encoding="utf-8")
    assert "two-layered (GWO) against static, 2 motions" in text
    assert "walk/report.html" in text
    assert (page / "figures" / "motions.png").is_file()
    assert (page / "figures" / "profiles.png").is_file()
    latex = (page / "comparison.tex").read_text(encoding="utf-8")
    assert latex.count("begin{tabular}") == 1
    assert "Upper-body error (m), last 20 \\%" in latex


def test_nothing_is_replaced_where_one_of_the_reports_has_no_place(tmp_path: Path, capsys):
    for study in two_motions({"walk": 0.2, "run": 0.1}).values():
        write_run_directories(study, tmp_path / "runs")
    page = tmp_path / "report"
    (page / "run").mkdir(parents=True)
    (page / "run" / "notes.txt").touch()
    (page / "report.html").write_text("of before")
    assert report.main([str(tmp_path / "runs"), "-o", str(page), "--force"]) == 1
    assert f"{page / 'run'} holds no report, so it is not replaced" in capsys.readouterr().err
    assert (page / "report.html").read_text() == "of before"
    assert not (page / "walk").exists()
