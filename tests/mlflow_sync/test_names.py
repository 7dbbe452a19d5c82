"""Names, parameters, tags and batches within the limits of MLflow."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tlr_exp.mlflow_sync import upload_run as tracking
from tlr_exp.mlflow_sync.names import flat_parameters, mlflow_status, plain_name, run_tags

rows = st.lists(
    st.dictionaries(
        st.text(st.characters(codec="ascii", categories=["L", "N"]), min_size=1),
        st.floats(allow_nan=False),
        max_size=30,
    ),
    max_size=12,
)


@given(rows=rows, limit=st.integers(2, 40))
def test_batches_hold_every_point_once_and_end_lines_with_their_marker(
    rows: list[dict[str, float]], limit: int
) -> None:
    lines = [
        {"iteration": step, "wall_time": 1.5 + step, **{f"m/{n}": v for n, v in row.items()}}
        for step, row in enumerate(rows)
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tracking, "MAX_METRICS", limit)
        batches = list(tracking._batches(lines))
    assert all(0 < len(batch) <= limit for batch in batches)
    points = [(point.key, point.step, point.value) for batch in batches for point in batch]
    expected = [
        (name, step, value)
        for step, line in enumerate(lines)
        for name, value in [*list(line.items())[2:], ("iteration", step)]
    ]
    assert points == expected
    for batch in batches:
        assert all(point.timestamp == 1500 + 1000 * point.step for point in batch)
        # Only a line that is too long for one call is cut, and no other line follows the cut.
        assert batch[-1].key == "iteration" or len(lines[batch[-1].step]) - 1 > limit


@pytest.mark.parametrize(
    ("name", "plain"),
    [
        ("reward_term/ang_vel_xy", "reward_term/ang_vel_xy"),
        ("weight[3]", "weight_3_"),
        ("a%b(c)", "a_b_c_"),
        ("x" * 300, "x" * 250),
    ],
)
def test_names_that_mlflow_takes(name: str, plain: str) -> None:
    assert plain_name(name) == plain


def test_flat_parameters() -> None:
    config = {"a": {"b": {"c": 1.5}, "d": {}}, "e": [1, {"f": None}], "g": True, "h": "x" * 7000}
    flat = flat_parameters(config)
    assert flat.pop("h") == "x" * 6000
    assert flat == {"a.b.c": "1.5", "a.d": "{}", "e": '[1, {"f": null}]', "g": "true"}


def test_tags_of_an_old_or_foreign_manifest() -> None:
    assert run_tags({"run_id": "1"}, "finished") == {
        "tlr_exp.run_id": "1",
        "tlr_exp.status": "finished",
        "kind": "run",
    }
    tags = run_tags({"run_id": "1", "git": {"commit": "abc", "dirty": True}}, "failed")
    assert (tags["git_commit"], tags["git_dirty"]) == ("abc", "true")
    assert mlflow_status("interrupted") == "KILLED"


def test_source_is_the_program_alone() -> None:
    tags = run_tags({"run_id": "1", "command": "tlr-train env.motion=a/b.npz"}, "finished")
    assert tags["mlflow.source.name"] == "tlr-train"
    assert tags["command"] == "tlr-train env.motion=a/b.npz"
    assert "mlflow.source.name" not in run_tags({"run_id": "1", "command": " "}, "finished")
