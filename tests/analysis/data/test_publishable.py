"""Tables for others name neither people nor machines."""

from dataclasses import replace

import numpy as np
from studies import make_study

from analysis.data.publishable import publishable
from analysis.data.runs import records_of


def test_hosts_are_numbered_and_stay_apart() -> None:
    study = make_study(np.random.default_rng(0), ("fixed",), range(4), iterations=2)
    hosts = ["zeus.lab", "ann-laptop", "zeus.lab", ""]
    runs = [replace(run, host=host) for run, host in zip(records_of(study), hosts, strict=True)]
    runs[0] = replace(runs[0], motion="/home/ann/walk.npz", command="tlr-train a=/home/ann/b")
    plain = publishable(runs)
    assert [run.host for run in plain] == ["machine 2", "machine 1", "machine 2", ""]
    assert (plain[0].motion, plain[0].command) == ("walk.npz", "tlr-train a=b")
    assert [run.host for run in publishable(plain)] == [run.host for run in plain]
    mixed = publishable([*plain[:2], replace(plain[2], host="new")])
    assert [run.host for run in mixed] == ["machine 2", "machine 1", "machine 3"]
