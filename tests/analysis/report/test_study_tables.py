"""Tables of a study: the lower layer as it was configured, and a sweep where runs lack a metric."""

import json
from dataclasses import replace

import numpy as np
import pytest
from studies import make_study

from analysis.data.study import StudyError
from analysis.measures.swept import sweep_of
from analysis.report.study_tables import metrics_of, table_1, values_table
from tlr_exp import keys
from tlr_exp.env.terms import PAPER_LOWER_LAYER, TERMS

STATIC, LAYERED = "static", "two-layered (GWO)"


def configured(study, changes):
    """The study with ``changes[arm]`` put into the configuration of the arm."""
    configs = []
    for _, run in study.runs.iterrows():
        config = json.loads(run["config"])
        config["reward"] |= changes[run["arm"]]
        configs.append(json.dumps(config))
    return replace(study, runs=study.runs.assign(config=configs))


def two_arms():
    return make_study(np.random.default_rng(0), ("fixed", "gwo"), [0, 1], 4)


LAYER = {
    "optimizing": {"base_height": -10.0, "dof_pos_limits": -10.0, "torques": -1e-6},
    "parameters": {"dof_pos_limits": {"margin": 0.1}},
}


def test_table_1_comes_from_the_configuration():
    rows = table_1(configured(two_arms(), {"fixed": LAYER, "gwo": LAYER}))
    assert [row.name for row in rows] == ["base_height", "dof_pos_limits", "torques"]
    height, limits, torques = rows
    assert (height.coefficient, height.constants, height.arms) == (-10.0, "", ())
    assert height.formula == "(h_base - h_des)²"
    assert limits.constants == "ε = 0.1"
    assert limits.in_paper
    assert not torques.in_paper


def test_table_1_names_arms_that_differ():
    other = {"optimizing": LAYER["optimizing"] | {"base_height": -5.0}}
    study = configured(two_arms(), {"fixed": LAYER, "gwo": LAYER | other})
    heights = [row for row in table_1(study) if row.name == "base_height"]
    assert [(row.coefficient, row.arms) for row in heights] == [
        (-10.0, (STATIC,)),
        (-5.0, (LAYERED,)),
    ]


def test_table_1_has_a_formula_and_a_unit_for_every_term_and_none_for_one_it_does_not_know():
    layer = {"optimizing": dict.fromkeys((*TERMS, "of_another_version"), -1.0)}
    *known, unknown = table_1(configured(two_arms(), {"fixed": layer, "gwo": layer}))
    assert all(row.formula and row.unit for row in known)
    assert (unknown.formula, unknown.unit, unknown.in_paper) == ("", "", False)
    assert {row.name for row in known if row.in_paper} == set(PAPER_LOWER_LAYER)


def test_table_1_without_a_lower_layer():
    empty = {"optimizing": {}}
    with pytest.raises(StudyError, match=r"reward\.optimizing"):
        table_1(configured(two_arms(), {"fixed": empty, "gwo": empty}))


def test_a_metric_that_one_arm_lacks_is_left_out():
    arms = ("gwo, threshold_share=0.1", "gwo, threshold_share=0.5")
    study = make_study(np.random.default_rng(0), arms, seeds=[0, 1], iterations=5)
    curves = study.curves.copy()
    curves.loc[curves["arm"] == arms[1], keys.EPISODE_LENGTH] = np.nan
    study = replace(study, curves=curves)
    assert metrics_of(study) == (keys.TRAIN_UPPER_BODY_ERROR, keys.TRAIN_LOWER_BODY_ERROR)
    sweep = sweep_of(study)
    assert sweep is not None
    assert len(values_table(study, sweep).header) == 4
