"""A Slurm of one node on the loopback address, for the time of a test: own configuration, ports and folder, no munge."""

import ctypes
import getpass
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import time

PROGRAMS = ("slurmctld", "slurmd", "sbatch", "squeue", "scontrol", "scancel")
PATH = os.environ.get("PATH", "") + ":/usr/local/sbin:/usr/sbin:/sbin"


def missing_programs():
    return [name for name in PROGRAMS if not shutil.which(name, path=PATH)]


def wait_for(condition, what, seconds=120.0):
    """What `condition` returns once that is true; AssertionError if it is not within the time."""
    end = time.monotonic() + seconds
    while True:
        value = condition()
        if value:
            return value
        if time.monotonic() > end:
            raise AssertionError(f"{what}: not within {seconds:g} s")
        time.sleep(0.1)


def free_ports(count):
    sockets = [socket.socket() for _ in range(count)]
    for s in sockets:
        s.bind(("127.0.0.1", 0))
    ports = [s.getsockname()[1] for s in sockets]
    for s in sockets:
        s.close()
    return ports


def die_with_parent():
    """The daemons end with the test even where that is killed."""
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG


class Cluster:
    def __init__(self, folder, cpus=2):
        self.folder = pathlib.Path(folder)
        self.daemons = []
        for name in ("state", "spool"):
            (self.folder / name).mkdir(parents=True)
        host, user = socket.gethostname(), getpass.getuser()
        ports = free_ports(2)
        # cred_expire: requeued jobs wait for the credentials of their first run to end, by default two minutes.
        (self.folder / "slurm.conf").write_text(f"""ClusterName=fieldtrace
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
AuthType=auth/none
CredType=cred/none
AuthInfo=cred_expire=5
SlurmUser={user}
SlurmdUser={user}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
SwitchType=switch/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=sched_interval=1,bf_interval=1,batch_sched_delay=1
KillWait=2
ReturnToService=2
NodeName=node1 NodeHostname={host} NodeAddr=127.0.0.1 CPUs={cpus} State=UNKNOWN
PartitionName=all Nodes=node1 Default=YES State=UP
""")
        self.environment = {**os.environ, "PATH": PATH, "SLURM_CONF": str(self.folder / "slurm.conf")}
        try:
            self.start("slurmctld", "-D")
            self.start("slurmd", "-D", "-N", "node1")
            wait_for(lambda: "State=IDLE" in self.run("scontrol", "show", "node", "node1").stdout, "an idle node", 60)
        except BaseException:
            self.stop()
            raise

    def start(self, *command):
        with open(self.folder / f"{command[0]}.log", "w") as log:
            daemon = subprocess.Popen(command, env=self.environment, stdout=log, stderr=log, preexec_fn=die_with_parent)
        self.daemons.append(daemon)

    def run(self, *command, **more):
        return subprocess.run(command, env=self.environment, capture_output=True, text=True, timeout=60, **more)

    def logs(self):
        return "\n".join(f"{p.name}:\n{p.read_text()[-2000:]}" for p in sorted(self.folder.glob("*.log")))

    def stop(self):
        if len(self.daemons) == 2 and all(d.poll() is None for d in self.daemons):
            try:
                self.run("scancel", "--user", getpass.getuser())
                wait_for(lambda: not self.run("squeue", "--noheader").stdout, "no job", 30)
            except (AssertionError, subprocess.TimeoutExpired):
                pass
        for daemon in reversed(self.daemons):
            daemon.terminate()
        for daemon in reversed(self.daemons):
            try:
                daemon.wait(10)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()
        self.daemons = []

    def job(self, number):
        """What `scontrol` says of a job or of a task of an array ("5_2"), by keys."""
        text = self.run("scontrol", "--oneliner", "show", "job", str(number)).stdout
        return dict(word.split("=", 1) for word in text.split() if "=" in word)

    def state(self, number):
        return self.job(number).get("JobState", "")

    def states(self, number, count):
        """Of an array's tasks."""
        return [self.state(f"{number}_{k}") for k in range(1, count + 1)]

    def wait(self, number, states=("COMPLETED",)):
        wait_for(lambda: self.state(number) in states, f"job {number} in {states}, was {self.state(number)}")


def processes_of(marks):
    """Numbers of the processes whose command lines have all these words."""
    found = []
    for entry in pathlib.Path("/proc").iterdir():
        try:
            words = (entry / "cmdline").read_bytes().decode(errors="replace").split("\0")
        except (OSError, ValueError):
            continue
        if entry.name.isdigit() and all(mark in words for mark in marks):
            found.append(int(entry.name))
    return found
