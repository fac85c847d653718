#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A fleet on Slurm: 40 simulated rigs at two dates, calibrated on one machine and on a cluster whose node dies in the middle.

    python3 -m venv V && V/bin/pip install snakemake snakemake-executor-plugin-cluster-generic
    sudo V/bin/python bench/install/fleet.py [--rigs 40] [--keep FOLDER]

The cluster is Debian's slurm-wlm: a controller and two nodes on this machine, each node in its own network namespace and with
its own host name. Checks: both runs end; the files of all calibrations and trials are equal, byte for byte; no step was done
twice but those that the dying node had begun; the rig that cannot be calibrated and those that have drifted stand on the
overview. Without Slurm, root or Snakemake it says so and ends with status 0.
"""
import contextlib
import hashlib
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from common import run

PROGRAM = pathlib.Path(os.environ.get("PLENOCAL", common.BUILD / "apps/plenocal"))
NODES = {"fleet1": "10.77.0.11", "fleet2": "10.77.0.12"}
CONTROLLER = "10.77.0.1"
SNAKEMAKE = pathlib.Path(sys.executable).parent / "snakemake"

SPEC = """plenocal: 1
target: board.yaml
seed: {seed}
poses: {{frames: 12, distance: [0.3, 0.6]}}
target_error: 0.0
cameras:
  left:
    model: pinhole-radial3
    image_size: [320, 240]
    parameters: {{f_x: {f}, f_y: {f}, c_x: 160, c_y: 120, A_0: -0.1}}
"""

BOARD = "plenocal: 1\ntype: chessboard\ncolumns: 8\nrows: 5\nsquare: 30 mm\n"

CONF = """ClusterName=fleet
SlurmctldHost={host}({controller})
AuthType=auth/none
CryptoType=crypto/none
CredType=cred/none
SlurmUser=root
SlurmdUser=root
MpiDefault=none
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SwitchType=switch/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ReturnToService=2
SlurmdTimeout=10
MinJobAge=3600
JobRequeue=1
StateSaveLocation={work}/state
SlurmdSpoolDir={work}/spool_%n
SlurmctldPidFile={work}/slurmctld.pid
SlurmdPidFile={work}/slurmd_%n.pid
SlurmctldLogFile={work}/slurmctld.log
SlurmdLogFile={work}/slurmd_%n.log
NodeName=fleet1 NodeAddr={fleet1} CPUs=2 State=UNKNOWN
NodeName=fleet2 NodeAddr={fleet2} CPUs=2 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def skip(reason):
    print(f"bench/install/fleet.py: skipped: {reason}")
    sys.exit(0)


class Cluster:
    """Controller in this network namespace, each node in its own."""

    def __init__(self, work):
        self.work, self.processes = work, {}
        for folder in ["state", *[f"spool_{node}" for node in NODES]]:
            (work / folder).mkdir(parents=True)
        self.conf = work / "slurm.conf"
        self.conf.write_text(CONF.format(host=os.uname().nodename, controller=CONTROLLER, work=work, **NODES))
        self.environment = {**os.environ, "SLURM_CONF": str(self.conf)}

    def __enter__(self):
        run("ip", "link", "add", "fleet0", "type", "bridge")
        run("ip", "addr", "add", f"{CONTROLLER}/24", "dev", "fleet0")
        run("ip", "link", "set", "fleet0", "up")
        for node, address in NODES.items():
            run("ip", "netns", "add", node)
            run("ip", "link", "add", f"v{node}", "type", "veth", "peer", "name", "eth0", "netns", node)
            run("ip", "link", "set", f"v{node}", "master", "fleet0", "up")
            run("ip", "-n", node, "addr", "add", f"{address}/24", "dev", "eth0")
            run("ip", "-n", node, "link", "set", "eth0", "up")
            run("ip", "-n", node, "link", "set", "lo", "up")
        self.start("controller", ["slurmctld", "-D", "-f", str(self.conf)])
        for node in NODES:
            self.start_node(node)
        for _ in range(60):
            time.sleep(0.5)
            states = self.ask("sinfo", "-h", "-N", "-o", "%T").split()
            if states == ["idle", "idle"]:
                return self
        self.__exit__()
        raise RuntimeError(f"the nodes are {states}; see {self.work}/*.log")

    def start(self, name, command):
        with open(self.work / f"{name}.out", "ab") as log:
            self.processes[name] = subprocess.Popen(command, env=self.environment, stdout=log, stderr=log,
                                                    start_new_session=True)

    def start_node(self, node):
        # Not `ip netns exec`, which would hide the control groups that slurmd needs.
        self.start(node, ["nsenter", f"--net=/run/netns/{node}", "unshare", "--uts", "bash", "-c",
                          f"hostname {node}; exec slurmd -D -f {self.conf}"])

    def ask(self, *command):
        return subprocess.run(command, env=self.environment, capture_output=True, text=True).stdout

    def kill_node(self, node):
        """All that runs in its namespace, as a power cut does."""
        for pid in run("ip", "netns", "pids", node).stdout.split():
            with contextlib.suppress(ProcessLookupError):
                os.kill(int(pid), signal.SIGKILL)

    def __exit__(self, *_):
        for node in NODES:
            self.kill_node(node)
        for process in self.processes.values():
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            process.wait()
        for node in NODES:
            subprocess.run(["ip", "netns", "del", node])
        subprocess.run(["ip", "link", "del", "fleet0"])


STATUS = """#!/bin/sh
# State of a job for Snakemake; a job of a dead node is requeued by Slurm and goes on.
state=$(scontrol -o show job "$1" | sed 's/.*JobState=\\([A-Z_]*\\).*/\\1/')
case $state in
  COMPLETED) echo success;;
  FAILED|CANCELLED|TIMEOUT|OUT_OF_MEMORY|BOOT_FAIL|DEADLINE) echo failed;;
  *) echo running;;
esac
"""


def simulate(work, rigs):
    plan = "plenocal: 1\nshards: 2\nmodels: [pinhole-radial3, pinhole-radtan]\nrigs:\n"
    for rig in range(rigs):
        name = f"rig{rig:02}"
        plan += f"  {name}: {{sessions: sets/{name}/*/session.yaml}}\n"
        for date in ("2026-01", "2026-02"):
            folder = work / "sets" / name / date
            if (folder / "session.yaml").exists():
                continue  # of an earlier run
            folder.mkdir(parents=True, exist_ok=True)
            focal = 300 + rig + (0 if date == "2026-01" or rig % 8 else 3)  # every eighth rig has drifted
            (folder / "spec.yaml").write_text(SPEC.format(seed=100 * rig + int(date[-1]), f=focal))
            (folder / "board.yaml").write_text(BOARD)
            run(PROGRAM, "simulate", folder / "spec.yaml", "-o", folder)
    # One rig whose images show nothing.
    broken = work / "sets/rig00/2026-02/session.yaml"
    broken.write_text(broken.read_text().replace("target.yaml", "chessboard:11x10:30mm"))
    (work / "plan.yaml").write_text(plan)


def workflow(work, name, *options, environment=None):
    results = work / name
    run(PROGRAM, "fleet", work / "plan.yaml", "-o", results)
    command = [SNAKEMAKE, "--keep-going", "--rerun-incomplete", "--directory", results, "-s", results / "Snakefile", *options]
    return subprocess.Popen([str(part) for part in command], env=environment, stdout=open(work / f"{name}.log", "w"),
                            stderr=subprocess.STDOUT)


def steps_done(cluster):
    """Of each step of the workflow the number of its jobs that were completed, and of all jobs those that Slurm began again."""
    completed, begun_again = {}, 0
    for job in cluster.ask("scontrol", "-o", "show", "jobs").splitlines():
        fields = dict(field.split("=", 1) for field in job.split() if "=" in field)
        begun_again += int(fields["Restarts"]) > 0
        if fields["JobState"] == "COMPLETED":
            completed[fields["JobName"]] = completed.get(fields["JobName"], 0) + 1
    return completed, begun_again


def digests(results):
    """Of all files of the calibrations but those that hold paths of the run."""
    found = {}
    for file in sorted([*results.glob("*/*/result/*"), *results.glob("*/*/trial/*")]):
        if file.is_file() and file.suffix in (".csv", ".jpg"):
            found[str(file.relative_to(results))] = hashlib.sha256(file.read_bytes()).hexdigest()
        elif file.name == "calibration.yaml":
            lines = [line for line in file.read_text().splitlines() if str(results) not in line and "plenocal" not in line]
            found[str(file.relative_to(results))] = hashlib.sha256("\n".join(lines).encode()).hexdigest()
    return found


def main():
    parser = common.parser(__doc__, plenocal=None)
    parser.add_argument("--rigs", type=int, default=40)
    parser.add_argument("--keep", type=pathlib.Path, help="folder for the files, kept")
    args = parser.parse_args()
    if not SNAKEMAKE.exists():
        skip("no snakemake beside this Python (pip install snakemake snakemake-executor-plugin-cluster-generic)")
    for tool in ("slurmctld", "slurmd", "sbatch", "ip"):
        if shutil.which(tool) is None:
            skip(f"{tool} is not installed (apt-get install slurm-wlm iproute2)")
    if os.geteuid() != 0:
        skip("network namespaces need root")
    work = args.keep or pathlib.Path(tempfile.mkdtemp())
    work = work.resolve()
    work.mkdir(parents=True, exist_ok=True)
    simulate(work, args.rigs)
    begin = time.time()
    if workflow(work, "one", "--cores", "2").wait() != 0:
        sys.exit(f"one machine: failed, see {work}/one.log")
    print(f"one machine: {2 * args.rigs} calibrations in {time.time() - begin:.0f} s")
    with Cluster(work / "slurm") as cluster:
        status = work / "status.sh"
        status.write_text(STATUS)
        status.chmod(0o755)
        begin = time.time()
        job = workflow(work, "many", "--executor", "cluster-generic", "--jobs", "8",
                       "--cluster-generic-submit-cmd", f"sbatch --parsable --requeue -o {work}/slurm/job_%j.out",
                       "--cluster-generic-status-cmd", str(status), environment=cluster.environment)
        while not list((work / "many").glob("*/*/status.txt")) and job.poll() is None:
            time.sleep(0.5)
        done = len(list((work / "many").glob("*/*/status.txt")))
        cluster.kill_node("fleet2")
        print(f"node fleet2 killed after {done} calibrations")
        time.sleep(15)
        cluster.start_node("fleet2")
        if job.wait() != 0:
            sys.exit(f"Slurm: failed, see {work}/many.log")
        print(f"Slurm: finished in {time.time() - begin:.0f} s")
        completed, begun_again = steps_done(cluster)
    twice = [name for name, jobs in completed.items() if jobs > 1]
    print(f"{len(completed)} steps, completed twice: {len(twice)}; begun again after the node's end: {begun_again}")
    one, many = digests(work / "one"), digests(work / "many")
    same = one == many and len(one) > 0
    print(f"{len(one)} files: {'equal, byte for byte' if same else 'DIFFER'}")
    page = (work / "many/overview.html").read_text()
    to_do = set(re.findall(r"<td>(rig\d+)</td>(?:(?!</tr>).)*(?:record again|use the new calibration)", page))
    expected = {f"rig{rig:02}" for rig in range(0, args.rigs, 8)}  # the one that fails, and those that have drifted
    named = expected <= to_do and "1 failed" in page
    print(f"the rigs that fail or have drifted are on the overview: {'yes' if named else 'NO'}; "
          f"others that are listed to act on: {len(to_do - expected)}")
    if not (same and named and completed and not twice):
        print(f"see {work}")
        return 1
    if not args.keep:
        shutil.rmtree(work)
    return 0


if __name__ == "__main__":
    sys.exit(main())
