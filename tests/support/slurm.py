"""A Slurm cluster with two nodes on this machine, from what install_slurm.sh installed into a folder."""

import getpass
import os
import socket
import subprocess
import time
from pathlib import Path

CONFIGURATION = """
ClusterName=tests
SlurmctldHost={host}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/none
CredType=cred/none
SlurmctldPort={ports[0]}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/%n.log
PluginDir={plugins}
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=batch_sched_delay=0,sched_min_interval=10000
SlurmdParameters=config_overrides
MailProg=/bin/true
NodeName=one NodeHostname={host} NodeAddr=127.0.0.1 Port={ports[1]} CPUs=1
NodeName=two NodeHostname={host} NodeAddr=127.0.0.1 Port={ports[2]} CPUs=1
PartitionName=main Nodes=ALL Default=YES State=UP
"""


def _free_ports(count: int) -> list[int]:
    sockets = [socket.socket() for _ in range(count)]
    for s in sockets:
        s.bind(("127.0.0.1", 0))
    ports = [s.getsockname()[1] for s in sockets]
    for s in sockets:
        s.close()
    return ports


class Cluster:
    """Controller and nodes, which run as long as the context lasts."""

    def __init__(self, installed: Path, folder: Path, path: Path) -> None:
        """`installed`: the folder of install_slurm.sh. `folder`: a new folder for configuration, state and logs.

        `path`: a folder of commands that jobs can find.
        """
        libraries = installed / "usr" / "lib" / "x86_64-linux-gnu"
        self._binaries, self._folder = installed / "usr" / "sbin", folder
        (folder / "state").mkdir()
        (folder / "slurm.conf").write_text(CONFIGURATION.format(
            host=socket.gethostname().split(".")[0], user=getpass.getuser(), ports=_free_ports(3), folder=folder,
            plugins=libraries / "slurm-wlm"))
        self.environment = os.environ | {
            "SLURM_CONF": str(folder / "slurm.conf"), "LD_LIBRARY_PATH": f"{libraries}:{libraries / 'slurm-wlm'}",
            "PATH": os.pathsep.join(map(str, [path, installed / "usr" / "bin", os.environ["PATH"]]))}
        self._processes: list[subprocess.Popen] = []

    def __enter__(self) -> "Cluster":
        self._start("slurmctld-wlm")
        for node in ("one", "two"):
            (self._folder / node).mkdir()
            self._start("slurmd-wlm", "-N", node, "-d", self._binaries / "slurmstepd-wlm")
        end = time.monotonic() + 60
        while self.run("sinfo", "--noheader", "--format=%t", check=False).stdout.split() != ["idle"]:
            assert time.monotonic() < end, self.logs()
            time.sleep(0.2)
        return self

    def __exit__(self, *_) -> None:
        for process in reversed(self._processes):
            process.terminate()
        for process in self._processes:
            process.wait(30)

    def _start(self, name: str, *arguments) -> None:
        self._processes.append(subprocess.Popen(
            [self._binaries / name, "-D", *arguments], env=self.environment, stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))

    def run(self, *command, check: bool = True) -> subprocess.CompletedProcess:
        """Run one of Slurm's commands."""
        done = subprocess.run([*map(str, command)], env=self.environment, text=True, capture_output=True, timeout=60,
                              cwd=self._folder)
        assert done.returncode == 0 or not check, done.stdout + done.stderr + self.logs()
        return done

    def array(self, *arguments) -> dict[int, tuple[str, str, str]]:
        """Submit an array and wait until it has ended: task → state, exit code, node."""
        number = self.run("sbatch", "--parsable", *arguments).stdout.strip()
        end = time.monotonic() + 180
        while self.run("squeue", "--noheader", "--jobs", number, check=False).stdout.strip():
            assert time.monotonic() < end, self.logs()
            time.sleep(0.2)
        told = self.run("scontrol", "--oneliner", "show", "job", number).stdout.splitlines()
        jobs = [dict(word.split("=", 1) for word in line.split() if "=" in word) for line in told]
        return {int(j["ArrayTaskId"]): (j["JobState"], j["ExitCode"], j["NodeList"]) for j in jobs}

    def logs(self) -> str:
        """Return the logs of the daemons."""
        return "\n".join(log.read_text()[-3000:] for log in self._folder.glob("*.log"))
