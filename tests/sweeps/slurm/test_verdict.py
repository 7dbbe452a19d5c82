"""What becomes of a job: its run says that it is trained, the queue whether it goes on."""

import pytest

from tlr_exp.sweeps.progress import HELD, QUEUED_AGAIN, Remark
from tlr_exp.sweeps.slurm.commands import ENDED, Element
from tlr_exp.sweeps.slurm.verdict import KEEP, Facts, in_the_queue, verdict

RUNNING, PENDING, GONE = Element("RUNNING"), Element("PENDING", restarts=1), None


def seen(record="running", run="running", live=False, element=RUNNING):
    return verdict(Facts(record, run, live, element))


@pytest.mark.parametrize("element", [RUNNING, PENDING, GONE, *map(Element, sorted(ENDED))])
def test_a_trained_run_is_trained_whatever_the_queue_says(element):
    found = seen(run="finished", element=element)
    assert (found.status, found.error, found.ended) == ("finished", None, True)


def test_only_a_run_that_is_let_go_is_trained():
    assert seen(run="finished", live=True) is None


def test_what_runs_or_waits_for_the_first_time_goes_on():
    assert seen() is None
    assert seen(record="interrupted", run="interrupted") is None  # about to be queued again
    assert seen(record="waiting", run=None, element=Element("PENDING")) is None


@pytest.mark.parametrize("record", ["running", "interrupted", "failed"])
def test_what_is_queued_again_waits(record):
    found = seen(record=record, run=record, element=PENDING)
    assert (found.status, found.ended) == ("waiting", False)
    assert seen(record=record, run=record, live=True, element=PENDING) is None


@pytest.mark.parametrize("record", ["interrupted", "failed"])
def test_what_told_of_its_end_before_it_was_forgotten_keeps_its_word(record):
    found = seen(record=record, run=record, element=GONE)
    assert (found.status, found.error, found.ended) == (record, KEEP, True)


def test_what_was_left_to_others_waits():
    found = seen(record="waiting", run=None, element=Element("COMPLETED"))
    assert (found.status, found.error, found.ended) == ("waiting", None, True)


@pytest.mark.parametrize(
    ("record", "element"),
    [
        *((record, GONE) for record in ("waiting", "running")),
        *(
            (record, Element("CANCELLED"))
            for record in ("waiting", "running", "interrupted", "failed")
        ),
    ],
)
def test_what_was_taken_out_is_cancelled(record, element):
    found = seen(record=record, run=None if record == "waiting" else record, element=element)
    assert (found.status, found.ended) == ("cancelled", True)


@pytest.mark.parametrize(
    ("state", "status", "words"),
    [
        ("TIMEOUT", "interrupted", "hydra.launcher.signal_delay_s"),
        ("NODE_FAIL", "failed", "its node failed"),
        ("OUT_OF_MEMORY", "failed", "hydra.launcher.mem_gb"),
        ("FAILED", "failed", "SLURM says FAILED"),
        ("COMPLETED", "failed", "SLURM says COMPLETED"),
    ],
)
def test_an_end_without_a_word_is_told_in_slurms(state, status, words):
    found = seen(element=Element(state))
    assert (found.status, found.ended) == (status, True)
    assert words in found.error


def test_what_a_job_said_itself_stays():
    found = seen(record="failed", run="failed", element=Element("FAILED"))
    assert (found.status, found.error, found.ended) == ("failed", KEEP, True)
    found = seen(record="interrupted", run="interrupted", element=Element("FAILED"))
    assert (found.status, found.error) == ("interrupted", KEEP)


@pytest.mark.parametrize(
    ("element", "expected"),
    [
        (None, None),
        (RUNNING, None),
        (Element("PENDING", "Priority"), Remark("waiting", "", False)),
        (Element("PENDING", "QOSMaxJobsPerUserLimit"), Remark("waiting", "", False)),
        (
            Element("PENDING", "QOSMaxCpuPerJobLimit"),
            Remark("waiting", "QOSMaxCpuPerJobLimit", True),
        ),
        (Element("PENDING", "PartitionConfig"), Remark("waiting", "PartitionConfig", True)),
        (Element("PENDING", "BeginTime", 1), Remark(QUEUED_AGAIN, "BeginTime", False)),
        (Element("PENDING", "JobHeldUser", 1), Remark(HELD, "JobHeldUser", True)),
    ],
)
def test_what_waits_is_called_what_it_is(element, expected):
    assert in_the_queue(element) == expected
