"""Runs without what names people and machines, for tables that others will read.

Machines are numbered, so that it still shows which runs shared one. Command lines and
configurations lose the places that they name (tlr_exp.records.places); models of processors stay.
"""

import re
from collections.abc import Iterable
from dataclasses import replace

from analysis.data.runs import RunRecord
from tlr_exp.records.places import plain_command, plain_text, plain_values

_NUMBERED = re.compile(r"machine \d+")


def publishable(records: Iterable[RunRecord]) -> list[RunRecord]:
    """The same runs with numbered hosts, and without places in commands, settings and motions."""
    records = list(records)
    hosts = sorted({record.host for record in records if record.host})
    # Those of an exported study have their numbers already.
    names = {host: host for host in hosts if _NUMBERED.fullmatch(host)}
    first = max((int(host.split()[1]) for host in names), default=0) + 1
    new = [host for host in hosts if host not in names]
    names |= {host: f"machine {number}" for number, host in enumerate(new, start=first)}
    return [
        replace(
            record,
            host=names.get(record.host, ""),
            command=plain_command(record.command),
            motion=plain_text(record.motion),
            config=plain_values(record.config),
        )
        for record in records
    ]
