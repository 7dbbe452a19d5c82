"""Which element is which job: arrays, ranges, names, the record."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tlr_exp.records.sweep_directory import SweepDirectoryError
from tlr_exp.sweeps.slurm.elements import (
    arrays,
    in_short,
    index_list,
    read_elements,
    record_path,
    short_name,
    write_elements,
)


@given(nums=st.sets(st.integers(0, 50)), size=st.integers(1, 20))
def test_arrays_have_every_job_once_at_an_index_that_there_may_be(nums, size):
    split = arrays(nums, size)
    assert sorted(num for part in split.values() for num in part) == sorted(nums)
    for base, part in split.items():
        assert all(0 <= num - base < size for num in part)


@given(indices=st.sets(st.integers(0, 30), min_size=1))
def test_ranges_are_read_back(indices):
    found = set()
    for part in index_list(sorted(indices)).split(","):
        first, _, last = part.partition("-")
        found |= set(range(int(first), int(last or first) + 1))
    assert found == indices


def test_elements_are_written_as_one_types_them():
    assert index_list([0, 1, 2, 5, 7, 8]) == "0-2,5,7-8"
    assert in_short(["12_0", "12_2", "12_1", "7_3"]) == "7_3 12_[0-2]"
    assert in_short(["12_0", "12_5"]) == "12_[0,5]"


@pytest.mark.parametrize(
    ("label", "expected"),
    [
        ("optimizer=gwo seed=1", "gwo-seed1 tlr"),
        ("as configured", "as-configured tlr"),
        ("ppo.hidden_sizes=[1,2]", "[1;2] tlr"),
        ("x=" + "a" * 100, "a" * 60 + " tlr"),
    ],
)
def test_names_tell_elements_apart(label, expected):
    assert short_name(label, "tlr") == expected


def test_the_record_is_read_back_and_a_damaged_one_is_named(tmp_path):
    assert read_elements(tmp_path) == {}
    write_elements(tmp_path, {10: "5_0", 2: "4_2"})
    assert read_elements(tmp_path) == {2: "4_2", 10: "5_0"}
    record_path(tmp_path).write_text("[")
    with pytest.raises(SweepDirectoryError, match=r"launcher/slurm\.json"):
        read_elements(tmp_path)
