"""The real Slurm on this machine's loopback address: munged, slurmctld and one slurmd, in a folder
of their own.
"""

import contextlib
import getpass
import os
import secrets
import shutil
import socket
import subprocess
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from patience import patience

# how long an example takes is up to what else the machine does
settings.register_profile("untimed", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("untimed")

TOOLS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scancel", "sinfo")
CONFIGURATION = """\
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
SwitchType=switch/none
SchedulerParameters=sched_interval=1,batch_sched_delay=0
ReturnToService=2
SlurmdTimeout=10
KillWait=5
MinJobAge=300
MaxArraySize=21
RequeueExit=99
NodeName={host} NodeAddr=127.0.0.1 CPUs={cores} RealMemory=8000 State=UNKNOWN
PartitionName=short Nodes={host} Default=YES MaxTime=30:00 State=UP
"""


class SlurmCluster:
    """One node. `environment` is what its commands need."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.processes = folder, {}
        self.environment = {**os.environ, "SLURM_CONF": str(folder / "slurm.conf")}
        for name in ("state", "spool"):
            (folder / name).mkdir()
        key = folder / "munge.key"
        key.write_bytes(secrets.token_bytes(128))
        key.chmod(0o600)
        values = {
            "host": socket.gethostname().split(".")[0],
            "user": getpass.getuser(),
            "folder": folder,
        }
        cores = len(os.sched_getaffinity(0))
        (folder / "slurm.conf").write_text(
            CONFIGURATION.format(**values, cores=cores, ports=_free_ports(2))
        )

    def start(self) -> None:
        f = self.folder
        self._run(
            "munged", "-F", "--force", f"--key-file={f}/munge.key", f"--socket={f}/munge.socket", f"--pid-file={f}/munged.pid",
            f"--seed-file={f}/munge.seed", f"--log-file={f}/munged.log",
        )  # fmt: skip
        _wait(lambda: (f / "munge.socket").exists(), "munged")
        self._run("slurmctld", "-D")
        self.start_node()

    def start_node(self) -> None:
        self._run("slurmd", "-D")
        _wait(
            lambda: self.call("sinfo", "-h", "-o", "%T") in ("idle", "mixed", "allocated"),
            "slurmd",
            self.folder,
        )

    def kill_node(self) -> None:
        """As when power fails: the daemon, and the steps it looked after go on or die as they like."""
        self.processes["slurmd"].kill()
        self.processes.pop("slurmd").wait()

    def lose_node(self) -> None:
        """Power fails for good: nothing of its jobs lives on."""
        psutil = pytest.importorskip("psutil", reason="finds what ran on the node")
        self.kill_node()
        for process in psutil.process_iter(["name"]):
            with contextlib.suppress(psutil.Error):
                if process.info["name"].startswith("slurmstepd") and str(self.folder) in str(
                    process.environ()
                ):
                    for one in [process, *process.children(recursive=True)]:
                        one.kill()

    def call(self, *command: str) -> str:
        done = subprocess.run(
            command, env=self.environment, capture_output=True, text=True, timeout=patience(30)
        )
        return done.stdout.strip()

    def stop(self) -> None:
        self.call("scancel", "--user", getpass.getuser())
        time.sleep(0.5)
        for process in reversed(self.processes.values()):
            process.terminate()
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()

    def _run(self, name: str, *options: str) -> None:
        with open(self.folder / f"{name}.out", "ab") as output:
            self.processes[name] = subprocess.Popen(
                [name, *options], env=self.environment, stdout=output, stderr=output
            )


def _free_ports(count):
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


def _wait(condition, what, folder=None, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            logs = "".join(p.read_text()[-600:] for p in folder.glob("*.log")) if folder else ""
            pytest.skip(f"{what} does not start here: {logs}")
        time.sleep(0.1)


@pytest.fixture(scope="session")
def slurm(tmp_path_factory):
    """A running Slurm; skips, saying so, where its programs are absent."""
    os.environ["PATH"] += ":/usr/sbin:/sbin"
    absent = [tool for tool in TOOLS if shutil.which(tool) is None]
    if absent:
        pytest.skip(
            f"no Slurm here: {', '.join(absent)} absent (Debian: slurmctld slurmd slurm-client munge)"
        )
    cluster = SlurmCluster(tmp_path_factory.mktemp("slurm"))
    try:
        cluster.start()
        yield cluster
    finally:
        cluster.stop()
