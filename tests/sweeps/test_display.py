"""The line of a sweep, its rhythm, and the table at the end."""

import itertools
import time
from pathlib import Path

import pytest
from rich.console import Console

from tlr_exp.sweeps import display
from tlr_exp.sweeps.display import (
    LiveSweepDisplay,
    PlainSweepDisplay,
    print_table,
    progress_line,
)
from tlr_exp.sweeps.progress import JobState, Pace

RUN = Path("/runs/tlr/demo-gwo-seed1-abc")


def states(done=3):
    return [
        JobState(0, "optimizer=fixed", "finished", RUN, None, 10, 10),
        JobState(1, "optimizer=gwo [x]", "running", RUN, None, done, 10),
        JobState(2, "optimizer=random", "failed", RUN, "ValueError: [no]", 2, 10),
        JobState(3, "optimizer=pso", "waiting", None, None, 0, 10),
    ]


def test_line_says_all_in_one():
    pace = Pace(1)
    pace.note(states(1), 0.0)
    line = progress_line(states(1), pace)
    assert line == "ETA …  1/4 jobs done  1 running  1 failed  1 waiting  iteration 13/40"
    pace.note(states(3), 20.0)
    # 10 s an iteration; 7 of the running job and 10 of the waiting one are left.
    line = progress_line(states(3), pace, "note")
    assert line.startswith("ETA 2:50  1/4 jobs done")
    assert line.endswith("iteration 15/40  note")
    ended = [state for state in states() if state.status in ("finished", "failed")]
    assert progress_line(ended, pace) == "1/2 jobs done  1 failed  iteration 12/20"


def test_plain_lines_come_at_changes_and_otherwise_seldom(capsys, monkeypatch):
    clock = itertools.count(0.0, 10.0)
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    shown = PlainSweepDisplay("five_seeds", Pace(1), interval_s=30.0)
    for done in range(6):  # at 0, 10, …, 50 s
        shown.show(states(done), "")
    shown.show(states(6), "stopping")
    lines = capsys.readouterr().out.splitlines()
    assert [line.split("iteration ")[1].split("/")[0] for line in lines] == ["12", "15", "18"]
    assert all(line.startswith("five_seeds: ") for line in lines)


def test_live_line_is_one_line_and_takes_words_as_they_are(capsys):
    console = Console(force_terminal=True, width=200)
    live = LiveSweepDisplay("five_seeds", Pace(1), console)
    live.say("job 1 (optimizer=gwo [red]x) runs")
    live.show(states(), "2 trained by others")
    live.close()
    printed = capsys.readouterr().out
    assert "optimizer=gwo [red]x" in printed
    assert "1/4 jobs done" in printed
    assert "2 trained by others" in printed


def test_live_line_stays_one_line_on_a_narrow_terminal(capsys):
    live = LiveSweepDisplay("five_seeds", Pace(1), Console(force_terminal=True, width=60))
    live.show(states(), "a note that has no room")
    live.close()
    last = capsys.readouterr().out.split("five_seeds")[-1]
    assert last.split("\x1b[?25h")[0].strip().count("\n") == 0
    assert "ETA" in last


@pytest.mark.parametrize("width", [80, 160])
def test_table_names_failures_with_reason_and_log(width, capsys, monkeypatch):
    monkeypatch.setattr(display, "LOGS_WIDTH", width)
    print_table(states(), [None, None, Path("runs/tlr/x/train.log"), None])
    printed = capsys.readouterr().out
    assert "optimizer=gwo [x]" in printed
    assert "failed at 2 of 10" in printed
    assert "job 2 failed: ValueError: [no]" in printed
    assert "log runs/tlr/x/train.log" in printed
    assert printed.count("demo-gwo-seed1-abc") == 3
