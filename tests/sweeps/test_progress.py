"""Progress and time left, by hand arithmetic and against a simulation."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tlr_exp.sweeps.progress import JobState, Pace, job_states, last_iteration, makespan


def state(num, status, done, total=10):
    return JobState(num, f"seed={num}", status, None, None, done, total)


def test_makespan_by_hand():
    assert makespan([], [], 2) == 0
    assert makespan([5, 3], [], 2) == 5
    # Two slots, free after 5 and 3: the first of 10 ends at 13, the second at 15.
    assert makespan([5, 3], [10, 10], 2) == 15
    assert makespan([], [4, 4, 4], 2) == 8
    assert makespan([], [4, 4, 4], 1) == 12
    assert makespan([2], [1], 3) == 2  # one slot stays free


@given(
    tasks=st.lists(st.integers(0, 9), max_size=8),
    running=st.lists(st.integers(0, 9), max_size=3),
    more=st.integers(0, 3),
)
def test_makespan_is_that_of_a_simulation_in_steps(tasks, running, more):
    slots = max(1, len(running) + more)
    busy, queue, time = list(running), list(tasks), 0
    while True:
        busy = [left for left in busy if left > 0]
        while queue and len(busy) < slots:
            if (task := queue.pop(0)) > 0:
                busy.append(task)
        if not busy and not queue:
            break
        busy = [left - 1 for left in busy]
        time += 1
    assert makespan(running, tasks, slots) == time


def test_pace_by_hand():
    pace = Pace(slots=2)
    pace.note([state(0, "running", 0), state(1, "running", 4), state(2, "waiting", 0)], 100.0)
    assert pace.seconds_per_iteration is None
    now = [state(0, "running", 3), state(1, "running", 6), state(2, "waiting", 0)]
    assert pace.eta_s(now) is None
    pace.note(now, 110.0)
    # 20 s of two jobs for 3 + 2 iterations: 4 s each.
    assert pace.seconds_per_iteration == 4.0
    # 7 and 4 are left; the third job takes 10 from 4 on: 14 iterations.
    assert pace.eta_s(now) == 56.0
    # A finished job keeps its share of the mean; one that failed is not counted on.
    later = [state(0, "finished", 10), state(1, "failed", 6), state(2, "running", 5)]
    pace.note(later, 120.0)
    assert pace.seconds_per_iteration == 20.0 / 5
    pace.note([*later[:2], state(2, "running", 8)], 126.0)
    # Job 2 made 3 iterations in 6 s.
    assert pace.seconds_per_iteration == pytest.approx((20.0 + 6.0) / (5 + 3))
    assert pace.eta_s([*later[:2], state(2, "running", 8)]) == pytest.approx(26.0 / 8 * 2)


def test_pace_of_a_resumed_job_does_not_count_what_is_dropped():
    pace = Pace(slots=1)
    pace.note([state(0, "running", 8)], 0.0)  # as the killed process left it
    pace.note([state(0, "running", 5)], 5.0)  # cut back to the checkpoint
    pace.note([state(0, "running", 7)], 10.0)
    assert pace.seconds_per_iteration == 5.0


def test_last_iteration_passes_over_a_torn_line(tmp_path):
    path = tmp_path / "metrics.jsonl"
    assert last_iteration(path) == 0
    path.write_bytes(b"")
    assert last_iteration(path) == 0
    path.write_bytes(b'{"iteration": 1}\n{"iteration": 2, "a": 1}\n{"iteration": 3, "a')
    assert last_iteration(path) == 2
    path.write_bytes((json.dumps({"iteration": 400, "x": "y" * 70}) + "\n").encode() * 2000)
    assert last_iteration(path) == 400


def test_states_are_what_stands_on_disk(plan, sweep, make_run):
    running, finished = make_run(1, "running", 4), make_run(2, "finished", 7)
    sweep.write_job(1, "running", run=running.path.name, run_id="x")
    sweep.write_job(2, "finished", run=finished.path.name, run_id="y")
    first, second, third = job_states(sweep, plan.jobs)
    assert (first.status, first.run, first.done, first.total) == ("waiting", None, 0, 10)
    assert (second.status, second.run, second.done) == ("running", running.path, 4)
    assert (third.status, third.done) == ("finished", 10)
