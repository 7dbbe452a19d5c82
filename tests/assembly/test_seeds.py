"""The random streams of a run: independent, and the same in every version."""

import dataclasses

import numpy as np

from tlr_exp.assembly.seeds import Seeds


def test_later_streams_leave_the_numbers_of_the_first_five_as_they_were():
    for seed in (0, 7, 2**40):
        first = np.random.SeedSequence(seed).generate_state(5, np.uint64) >> np.uint64(1)
        assert dataclasses.astuple(Seeds.of(seed))[:5] == tuple(map(int, first))


def test_all_streams_differ_between_one_another_and_between_seeds():
    found = [number for seed in range(20) for number in dataclasses.astuple(Seeds.of(seed))]
    assert len(set(found)) == len(found)
    assert all(0 <= number < 2**63 for number in found)
