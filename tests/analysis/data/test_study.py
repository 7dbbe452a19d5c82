"""A study refuses frames that are none, and gives its curves as matrices."""

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest
from studies import ar1, config_of, expected, make_study, rise, standard_curves

from analysis.data.study import Study, StudyError, arm_order, pretty_arm
from tlr_exp import keys


def hand_made() -> tuple[pd.DataFrame, pd.DataFrame]:
    """Two arms of two seeds with three iterations; "b" is measured in the second and third."""
    runs, curves = [], []
    for arm, seed, first in (
        ("gwo", 7, 1.0),
        ("fixed", 2, 10.0),
        ("gwo", 3, 4.0),
        ("fixed", 1, 20),
    ):
        name = f"{arm}-{seed}"
        texts = ("run_id", "status", "scale", "motion", "device", "commit", "created_at")
        more = ("identity", "host", "cpu_model", "packages", "command", "config")
        numbers = {"num_envs": 8, "iterations": 3, "control_steps": 576}
        row = {"run": name, "arm": arm, "method": arm, "seed": seed, **numbers}
        runs.append({**dict.fromkeys((*texts, *more), "x"), **row, "status": "finished"})
        curves.append(
            pd.DataFrame(
                {
                    "run": name,
                    "arm": arm,
                    "seed": seed,
                    "iteration": [1, 2, 3],
                    "a": [first, first + 1, first + 2],
                    "b": [np.nan, -first, np.nan if name == "gwo-3" else 0.0],
                }
            )
        )
    return pd.DataFrame(runs).set_index("run"), pd.concat(curves, ignore_index=True)


def test_matrix_by_hand() -> None:
    study = Study(*hand_made())
    seeds, iterations, values = study.matrix("a", "gwo")
    assert seeds.tolist() == [3, 7]
    assert iterations.tolist() == [1, 2, 3]
    assert values.tolist() == [[4.0, 5.0, 6.0], [1.0, 2.0, 3.0]]
    # Seed 3 of gwo lacks b in the third iteration, all runs in the first.
    assert [part.tolist() for part in study.matrix("b", "gwo")] == [[3, 7], [2], [[-4.0], [-1.0]]]
    assert study.matrix("b", "fixed")[2].tolist() == [[-20.0, 0.0], [-10.0, 0.0]]


def test_matrix_does_not_depend_on_the_order_of_rows() -> None:
    runs, curves = hand_made()
    order = np.random.default_rng(0).permutation(len(curves))
    shuffled = Study(runs.iloc[[2, 0, 3, 1]], curves.iloc[order])
    for arm in ("fixed", "gwo"):
        for metric in ("a", "b"):
            in_order = Study(runs, curves).matrix(metric, arm)
            for part, wanted in zip(shuffled.matrix(metric, arm), in_order, strict=True):
                np.testing.assert_array_equal(part, wanted)


def test_matrix_is_a_copy() -> None:
    study = Study(*hand_made())
    study.matrix("a", "gwo")[2][:] = 0.0
    assert study.matrix("a", "gwo")[2].sum() == 21.0


def test_what_a_study_says_of_itself() -> None:
    study = Study(*hand_made())
    assert (study.arms, study.baseline) == (("fixed", "gwo"), "fixed")
    assert study.metric_names == ("a", "b")
    assert study.seeds("gwo") == (3, 7)
    assert (study.iterations, study.is_finished) == (3, True)
    assert Study(*hand_made(), baseline="gwo").arms == ("gwo", "fixed")


def test_wrong_questions_name_what_there_is() -> None:
    study = Study(*hand_made())
    with pytest.raises(StudyError, match=r"no arm 'gow'; arms: fixed, gwo$"):
        study.matrix("a", "gow")
    with pytest.raises(StudyError, match=r"no metric 'c'; metrics: a, b$"):
        study.matrix("c", "gwo")
    runs, curves = hand_made()
    never = Study(runs, curves.assign(b=np.nan))
    with pytest.raises(StudyError, match="b: no iteration in which all runs of arm 'gwo' have it"):
        never.matrix("b", "gwo")
    one = curves.assign(b=curves["b"].where(curves["run"] != runs.index[-1]))
    arm = str(runs["arm"].iloc[-1])
    with pytest.raises(StudyError, match=f"have it; never in {runs.index[-1]}$"):
        Study(runs, one).matrix("b", arm)
    with pytest.raises(StudyError, match=r"baseline 'static' is no arm; arms: fixed, gwo"):
        Study(*hand_made(), baseline="static")


def test_order_of_arms() -> None:
    labels = [
        "random",
        "gwo, threshold_share=0.5",
        "gwo, threshold_share=0.02",
        "gwo",
        "fixed, a=1",
    ]
    more = ["gwo, threshold_share=0.1", "gwo, lower=1e-05", "gwo, pack_size=30", "gwo, pack_size=5"]
    assert arm_order([*labels, *more, "gwo"]) == (
        "fixed, a=1",
        "gwo",
        "gwo, lower=1e-05",
        "gwo, pack_size=5",
        "gwo, pack_size=30",
        "gwo, threshold_share=0.02",
        "gwo, threshold_share=0.1",
        "gwo, threshold_share=0.5",
        "random",
    )


@pytest.mark.parametrize(
    ("arm", "pretty"),
    [
        ("fixed", "static"),
        ("gwo", "two-layered (GWO)"),
        ("gwo, threshold_share=0.02", "two-layered (GWO), threshold_share=0.02"),
        ("random", "random weights"),
        ("ospo", "ospo"),
    ],
)
def test_pretty_arm(arm: str, pretty: str) -> None:
    assert pretty_arm(arm) == pretty


# --- what is refused -------------------------------------------------------------------------
Frames = tuple[pd.DataFrame, pd.DataFrame]


def cell(column: str, row: int, value: object) -> Callable[[pd.DataFrame], pd.DataFrame]:
    def change(frame: pd.DataFrame) -> pd.DataFrame:
        frame = frame.copy()
        frame.iloc[row, list(frame.columns).index(column)] = value
        return frame

    return change


MALFORMED: dict[str, tuple[Callable[[pd.DataFrame, pd.DataFrame], Frames], str]] = {
    "no index": (lambda r, c: (r.reset_index(), c), "runs: the index is called None"),
    "no arm": (lambda r, c: (r.drop(columns="arm"), c), "runs: the column arm is missing"),
    "no iteration": (lambda r, c: (r, c.drop(columns="iteration")), "the column iteration is miss"),
    "no metric": (lambda r, c: (r, c.drop(columns=["a", "b"])), "curves: there is no metric"),
    "seeds as text": (lambda r, c: (r.assign(seed="1"), c), "seed is str; it must be an integer"),
    "metric as text": (lambda r, c: (r, c.assign(a="1")), "column a is str; it must be a float"),
    "numbers as text": (lambda r, c: (r.assign(host=3), c), "host is int64; it must be text"),
    "empty text": (lambda r, c: (cell("host", 1, None)(r), c), "runs: the column host lacks 1 val"),
    "twice a metric": (
        lambda r, c: (r, pd.concat([c, c[["a"]]], axis=1)),
        "curves: there are two columns a",
    ),
    "no run": (lambda r, c: (r.iloc[:0], c.iloc[:0]), "there is no run"),
    "twice a name": (
        lambda r, c: (pd.concat([r, r.iloc[:1]]), c),
        "gwo-7: there are 2 runs of this name",
    ),
    "twice a seed": (
        lambda r, c: (cell("seed", 0, 3)(r), c.assign(seed=c.seed.replace(7, 3))),
        "arm 'gwo' has seed 3 2 times: gwo-7, gwo-3",
    ),
    "odd status": (lambda r, c: (cell("status", 0, "done")(r), c), "gwo-7: status 'done'; it must"),
    "other length": (
        lambda r, c: (cell("iterations", 0, 4)(r), c),
        "gwo-7: configured for 4 iterations, other runs for 3",
    ),
    "no curve": (lambda r, c: (r, c[c.run != "gwo-3"]), "gwo-3: has no curve"),
    "a curve too many": (
        lambda r, c: (r.drop(index="gwo-3"), c),
        "gwo-3: has a curve, but is not among the runs",
    ),
    "another arm": (lambda r, c: (r, cell("arm", 0, "fixed")(c)), "gwo-7: arm in its curve is not"),
    "an iteration twice": (
        lambda r, c: (r, pd.concat([c, c.iloc[:1]])),
        "gwo-7: has iteration 1 more than once",
    ),
    "an iteration lacks": (
        lambda r, c: (r, c.drop(index=1)),
        "gwo-7: finished, with 1 of 3 iterations missing: 2",
    ),
    "from zero": (
        lambda r, c: (r, c.assign(iteration=c.iteration - 1)),
        "gwo-7: finished, with 1 of 3 iterations missing: 3",
    ),
    "too long": (
        lambda r, c: (r.assign(iterations=2), c),
        "gwo-7: has iteration 3, outside 1 to 2",
    ),
    "infinite": (lambda r, c: (r, cell("a", 4, np.inf)(c)), "fixed-2: a is infinite; allowed"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed_frames_are_refused(case: str) -> None:
    change, message = MALFORMED[case]
    with pytest.raises(StudyError) as caught:
        Study(*change(*hand_made()))
    assert any(message in line for line in str(caught.value).splitlines()), str(caught.value)


def test_all_problems_are_named_at_once() -> None:
    runs, curves = hand_made()
    with pytest.raises(StudyError) as caught:
        Study(cell("status", 1, "done")(runs), curves.drop(index=[0, 1]))
    lines = str(caught.value).splitlines()
    assert len(lines) == 2
    assert lines[0].startswith("fixed-2: status 'done'")
    assert lines[1] == "gwo-7: finished, with 2 of 3 iterations missing: 1, 2"


def test_an_unfinished_run_may_be_shorter_but_has_no_gaps() -> None:
    runs, curves = hand_made()
    running = cell("status", 0, "running")(runs)
    study = Study(running, curves.drop(index=[2]))
    assert study.matrix("a", "gwo")[1].tolist() == [1, 2]
    assert not study.is_finished
    with pytest.raises(StudyError, match="gwo-7: running, with 1 of 2 iterations missing: 2"):
        Study(running, curves.drop(index=[1]))


# --- synthetic studies -----------------------------------------------------------------------
def test_synthetic_noise_is_stationary_and_autocorrelated() -> None:
    noise = ar1(np.random.default_rng(1), 4000, 50, rho=0.8, std=2.0)
    # Standard errors with 4000 runs: 2 / sqrt(8000) = 0.022 of the deviation, 0.006 of rho.
    np.testing.assert_allclose(noise.std(axis=0), 2.0, atol=0.12)
    correlation = [np.corrcoef(noise[:, t], noise[:, t + 1])[0, 1] for t in range(49)]
    np.testing.assert_allclose(correlation, 0.8, atol=0.035)


def test_synthetic_studies_have_the_curves_that_they_say() -> None:
    generator = np.random.default_rng(2)
    own = {keys.TRAIN_UPPER_BODY_ERROR: rise(0.5, 0.1)}
    study = make_study(generator, {"fixed": own, "gwo": {}}, range(400), iterations=12, effect=0.2)
    for arm, curve in (("fixed", own), ("gwo", standard_curves(0.2, adaptive=True))):
        mean = study.matrix(keys.TRAIN_UPPER_BODY_ERROR, arm)[2].mean(axis=0)
        wanted = expected(curve[keys.TRAIN_UPPER_BODY_ERROR], 12)
        # sqrt(0.03² + 0.05²) of the scale / sqrt(400) = 0.003 of it; four of these.
        np.testing.assert_allclose(mean, wanted, atol=0.012 * wanted.max())


def test_synthetic_studies_repeat_and_evaluate_now_and_then() -> None:
    first, second = (make_study(np.random.default_rng(3), iterations=25) for _ in range(2))
    pd.testing.assert_frame_equal(first.curves, second.curves)
    assert first.matrix("eval/survival", "gwo")[1].tolist() == [10, 20, 25]
    assert first.arms == ("fixed", "gwo")
    assert config_of("gwo, threshold_share=0.02", 0, 9)["reward"]["objective"] == {
        "threshold_share": 0.02
    }
