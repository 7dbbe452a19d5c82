"""A SLURM of one node on loopback: its own controller, node, accounts and keys in one folder.

Needs what `make cluster-tools` installs, and root, because a node starts jobs as their users.
"""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path

TOOLS = ("slurmctld", "slurmd", "slurmdbd", "munged", "mariadbd", "mariadb-install-db")
# A limit that only a hang reaches: a busy machine may take its time.
HANG_S = 600.0

CONF = """
ClusterName=tiny
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.sock
CredType=cred/munge
SlurmctldPort={ctld}
SlurmdPort={slurmd}
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/{proctrack}
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/slurmdbd
AccountingStorageHost=localhost
AccountingStoragePort={dbd}
AccountingStoragePass={folder}/munge.sock
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=batch_sched_delay=0,sched_interval=2,sched_min_interval=0
ReturnToService=2
MaxArraySize=4
MinJobAge=20
KillWait=120
NodeName=node1 NodeHostname={host} NodeAddr=127.0.0.1 CPUs=2 RealMemory=6000 State=UNKNOWN
PartitionName=main Nodes=node1 Default=YES MaxTime=INFINITE State=UP
PartitionName=empty State=UP
"""
DBD = """
AuthType=auth/munge
AuthInfo=socket={folder}/munge.sock
DbdHost=localhost
DbdPort={dbd}
SlurmUser=root
LogFile={folder}/slurmdbd.log
PidFile={folder}/slurmdbd.pid
StorageType=accounting_storage/mysql
StorageHost=localhost
StorageUser=root
StorageLoc=accounts
"""
LOCAL_ROOT = "--auth-root-authentication-method=normal"
CGROUP = "CgroupPlugin=cgroup/v1\nCgroupMountpoint=/sys/fs/cgroup\nCgroupAutomount=no\n"


def missing() -> list[str]:
    """Of what is needed, what is not installed."""
    return [tool for tool in TOOLS if shutil.which(tool) is None]


class Slurm:
    """A context: the cluster is up inside, and all of its processes have ended outside."""

    def __init__(self, folder: Path, proctrack: str = "linuxproc") -> None:
        self.folder = folder
        ports = {name: _free_port() for name in ("ctld", "slurmd", "dbd")}
        names = {"folder": folder, "host": socket.gethostname(), "proctrack": proctrack, **ports}
        (folder / "slurm.conf").write_text(CONF.format(**names))
        (folder / "slurmdbd.conf").write_text(DBD.format(**names))
        (folder / "slurmdbd.conf").chmod(0o600)
        (folder / "cgroup.conf").write_text(CGROUP)
        (folder / "munge.key").write_bytes(os.urandom(1024))
        (folder / "munge.key").chmod(0o400)
        self.environment = {
            "SLURM_CONF": str(folder / "slurm.conf"),
            "MYSQL_UNIX_PORT": str(folder / "db.sock"),
        }
        self.before: set[str] = set()
        self._daemons: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> Slurm:
        try:
            self._start()
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _start(self) -> None:
        folder = self.folder
        for name in ("state", "spool", "db"):
            (folder / name).mkdir()
        files = {"key": "key", "socket": "sock", "pid": "pid", "log": "log", "seed": "seed"}
        munge = [
            f"--{option}{'' if option in ('socket',) else '-file'}={folder}/munge.{suffix}"
            for option, suffix in files.items()
        ]
        self._daemon("munged", "--foreground", "--force", *munge)
        data = [f"--datadir={folder}/db", "--user=root"]
        subprocess.run(
            ["mariadb-install-db", "--no-defaults", *data, "--skip-test-db", LOCAL_ROOT],
            check=True,
            capture_output=True,
        )
        self._daemon(
            *("mariadbd", "--no-defaults", *data, f"--socket={folder}/db.sock"),
            *("--skip-networking", f"--pid-file={folder}/db.pid"),
        )
        self.wait(lambda: (folder / "db.sock").exists() and (folder / "munge.sock").exists())
        self._daemon("slurmdbd", "-D")
        self.wait(lambda: self.call("sacctmgr", "-i", "add", "cluster", "tiny").returncode == 0)
        self._daemon("slurmctld", "-D", "-i")
        self._daemon("slurmd", "-D", "-N", "node1")
        self.wait(lambda: "idle" in self.call("sinfo", "-h", "-o", "%T").stdout)

    def _daemon(self, *command: str) -> None:
        with open(self.folder / f"{command[0]}.out", "ab") as log:
            process = subprocess.Popen(
                command,
                env={**os.environ, **self.environment},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        self._daemons.append(process)

    def stop(self) -> None:
        """End all jobs, then the daemons, the last started first."""
        if len(self._daemons) > 3:
            self.clear()
        for process in reversed(self._daemons):
            process.terminate()
            try:
                process.wait(30)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._daemons.clear()

    def clear(self) -> None:
        """End all jobs and see them gone."""
        self.call("scancel", "--user=root", "--signal=KILL", "--full")
        self.call("scancel", "--user=root")
        deadline = time.monotonic() + 60
        while self.call("squeue", "-h").stdout.strip() and time.monotonic() < deadline:
            time.sleep(0.2)
        # The controller knows ended jobs for minutes, which are no concern of the next test.
        self.before = set(self._states())

    # --- for tests -----------------------------------------------------------------------------
    def call(self, *command: str) -> subprocess.CompletedProcess[str]:
        """A command of SLURM, whatever comes of it."""
        environment = {**os.environ, **self.environment}
        return subprocess.run(command, env=environment, capture_output=True, text=True)

    def ask(self, *command: str) -> str:
        """What a command of SLURM says."""
        done = self.call(*command)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def states(self) -> dict[str, str]:
        """The elements submitted since `clear`, by id, with their states."""
        known = self._states().items()
        return {element: state for element, state in known if element not in self.before}

    def _states(self) -> dict[str, str]:
        text = self.ask("squeue", "-h", "--array", "--states=all", "-O", "JobArrayID:20,State:20")
        return {line[:20].strip(): line[20:].strip() for line in text.splitlines()}

    def accounts(self, *ids: str) -> list[str]:
        """Of elements, ``State|JobName`` by the accounts."""
        listed = ["--format=State,JobName%60", f"--jobs={','.join(ids)}"]
        return self.ask("sacct", "--noheader", "--parsable2", "--allocations", *listed).splitlines()

    @staticmethod
    def wait(condition: Callable[[], object], alive: Sequence[subprocess.Popen] = ()) -> None:
        """Until the condition holds."""
        deadline = time.monotonic() + HANG_S
        while not condition():
            for process in alive:
                assert process.poll() is None, process.communicate()[0]
            assert time.monotonic() < deadline, "waited in vain"
            time.sleep(0.1)


def _free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]
