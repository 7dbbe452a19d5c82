"""Tables of a sweep where the runs of an arm lack a metric."""

from dataclasses import replace

import numpy as np
from studies import make_study

from analysis.measures.swept import sweep_of
from analysis.report.sweep_tables import metrics_of, values_table
from tlr_exp import keys


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
