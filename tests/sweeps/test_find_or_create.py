"""Many processes that look for the same run at once make one."""

import subprocess
import sys

from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.runs import find_or_create_run

ASK = """
import sys
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.runs import find_or_create_run, next_run_path
root, identity = sys.argv[1:]
def create():
    return RunDirectory.create(next_run_path(root, "gwo"), {"seed": 0}, {}, identity)
sys.stdin.read()
print(find_or_create_run(root, identity, create).manifest["run_id"])
"""


def test_eight_processes_at_once_agree_on_one_run_for_each_identity(tmp_path):
    root, pipe = tmp_path / "new" / "tlr", subprocess.PIPE
    identities = ["aaaaaaaa", "bbbbbbbb"] * 4
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", ASK, str(root), identity], stdin=pipe, stdout=pipe, text=True
        )
        for identity in identities
    ]
    for process in processes:  # all wait for this with their imports done
        assert process.stdin is not None
        process.stdin.close()
    answers = []
    for process in processes:
        assert process.stdout is not None
        with process.stdout:
            answers.append(process.stdout.read().strip())
        assert process.wait() == 0
    assert len(set(zip(identities, answers, strict=True))) == 2
    found = {run.manifest["run_id"]: run.manifest["identity"] for run in RunDirectory.find(root)}
    assert found == dict(zip(answers, identities, strict=True))


def test_a_run_is_made_only_where_none_is_found(tmp_path):
    def create() -> RunDirectory:
        made.append(RunDirectory.create(tmp_path / f"run{len(made)}", {}, {}, "aa"))
        return made[-1]

    made: list[RunDirectory] = []
    first = find_or_create_run(tmp_path, "aa", create)
    assert find_or_create_run(tmp_path, "aa", create).path == first.path
    assert find_or_create_run(tmp_path, "bb", create).path == tmp_path / "run1"
    assert len(made) == 2


def test_a_finished_run_goes_first_where_that_is_asked_for(tmp_path):
    old = RunDirectory.create(tmp_path / "old", {}, {}, "aa")
    new = RunDirectory.create(tmp_path / "new", {}, {}, "aa")
    old.set_status("finished")

    def never() -> RunDirectory:
        raise AssertionError

    assert find_or_create_run(tmp_path, "aa", never).path == new.path
    assert find_or_create_run(tmp_path, "aa", never, prefer_finished=True).path == old.path
