"""What captions say of seeds, bands, scale and smoothing."""

from dataclasses import replace

import numpy as np
import pytest
from hand_values import flat_study, without
from studies import make_study

from analysis.figures import drawing
from analysis.figures.series import NotDrawnError, one_run_of_each_arm, pair_of, series_of
from tlr_exp import keys


def test_seeds_and_scale():
    study = flat_study(seeds=range(5), iterations=6, scale="laptop")
    caption = drawing.caption_of(study, "What.", band=True)
    assert caption.startswith("What. n = 5 seeds per arm (0 to 4). Lines and bands: mean ± 1 ")
    assert "laptop: 8 environments × 6 iterations" in caption  # noqa: RUF001
    assert caption.endswith("Smoothing: none.")


def test_one_seed_is_said_to_have_no_band():
    caption = drawing.caption_of(flat_study(seeds=[3]), "What.", band=True)
    assert "n = 1 seed per arm (3)." in caption
    assert "No band: one seed shows no spread." in caption
    assert "± 1 standard deviation" not in caption


def test_unequal_seeds_are_named():
    study = flat_study(seeds=[0, 1, 4])
    keep = (study.runs["arm"] == "fixed") | (study.runs["seed"] == 4)
    runs = study.runs[keep]
    study = replace(study, runs=runs, curves=study.curves[study.curves["run"].isin(runs.index)])
    caption = drawing.caption_of(study, "What.", band=True)
    assert "static 3 (0, 1, 4); two-layered (GWO) 1 (4)" in caption
    assert "no band for two-layered (GWO) (one seed)" in caption


def test_unfinished_runs_are_said_to_be():
    study = flat_study(iterations=9)
    late = (study.curves["arm"] == "gwo") & (study.curves["iteration"] > 5)
    runs = study.runs.assign(status="running")
    study = replace(study, runs=runs, curves=study.curves[~late])
    assert "(not finished: 5 to 9 of 9 iterations so far)" in drawing.scale_text(study)


def test_series_come_without_nan_and_say_what_is_missing():
    study = make_study(np.random.default_rng(0), iterations=20)
    evaluated = series_of(study, "eval/survival", "gwo")
    assert evaluated.iterations.tolist() == [10, 20]
    assert np.isfinite(evaluated.values).all()
    with pytest.raises(NotDrawnError, match=r"arm 'gwo' has no value of nothing/such"):
        series_of(study, "nothing/such", "gwo")
    curves = study.curves.copy()
    curves.loc[curves["arm"] == "gwo", keys.EPISODE_LENGTH] = np.nan
    with pytest.raises(NotDrawnError, match="arm 'gwo' has no value of train/episode_length"):
        series_of(replace(study, curves=curves), keys.EPISODE_LENGTH, "gwo")


def test_pairs_are_cut_to_common_iterations():
    study = flat_study(iterations=6)
    curves = study.curves.copy()
    early = (curves["arm"] == "gwo") & (curves["iteration"] < 3)
    curves.loc[early, keys.EPISODE_LENGTH] = np.nan
    first, second = pair_of(replace(study, curves=curves), keys.EPISODE_LENGTH, "gwo")
    assert first.iterations.tolist() == second.iterations.tolist() == [3, 4, 5, 6]
    assert first.values.shape == (2, 4)


def test_the_run_of_each_arm_is_of_a_shared_seed():
    study = flat_study(seeds=[0, 1, 2])
    dropped = (study.runs["arm"] == "gwo") & (study.runs["seed"] == 0)
    runs = study.runs[~dropped]
    study = replace(study, runs=runs, curves=study.curves[study.curves["run"].isin(runs.index)])
    single, seed = one_run_of_each_arm(study)
    assert seed == 1
    assert single.seeds("fixed") == single.seeds("gwo") == (1,)


def test_no_shared_seed():
    study = flat_study(seeds=[0, 1])
    keep = (study.runs["arm"] == "gwo") == (study.runs["seed"] == 0)
    runs = study.runs[keep]
    study = replace(study, runs=runs, curves=study.curves[study.curves["run"].isin(runs.index)])
    with pytest.raises(NotDrawnError, match="no seed was run in every arm"):
        one_run_of_each_arm(study)


def test_specs_name_what_is_missing():
    from analysis.figures.catalogue import ALL_FIGURES

    study = without(flat_study(), keys.EPISODE_LENGTH)
    (spec,) = [spec for spec in ALL_FIGURES if spec.paper == "Figure 6"]
    with pytest.raises(NotDrawnError, match="train/episode_length"):
        spec.draw(study)
