#!/usr/bin/env python3
"""Compares Tessera as a queue with Slurm: tasks that do nothing, a killed worker, and long lists.

    run.py [--tasks 1000] [--listed 10000] [--wait 240] [slurm|tessera]…     default: both

Each system has a controller and three workers with two slots on this host. A task of Slurm is an element of a job
array that runs `true`; one of Tessera is a frame of 8 x 8 pixels with one sample, whose image is stored. Needs root and
Debian's packages slurm-wlm and munge. TESSERA_BIN: directory of the programs (build/dev/bin). Prints a table;
figures: docs/notes/coordinator.md.
"""

import argparse
import ctypes
import json
import os
import resource
import shutil
import signal
import sqlite3
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
BIN = Path(os.environ.get("TESSERA_BIN", ROOT / "build/dev/bin"))
SCENE = str(ROOT / "tests/scenes/lit_square.gltf")
NODES, SLOTS = 3, 2
SINGLES = 50  # jobs submitted one by one
PR_SET_CHILD_SUBREAPER = 36
CONF = """ClusterName=peer
SlurmctldHost=localhost
AuthType=auth/munge
AuthInfo=socket={folder}/munge-run/munge.socket
CryptoType=crypto/munge
SlurmUser=root
SlurmdUser=root
SlurmctldPort=27817
SlurmctldPidFile={folder}/run/slurmctld.pid
SlurmdPidFile={folder}/run/slurmd.%n.pid
SlurmdSpoolDir={folder}/spool/%n
StateSaveLocation={folder}/state
SlurmctldLogFile={folder}/log/slurmctld.log
SlurmdLogFile={folder}/log/slurmd.%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
ReturnToService=2
MaxArraySize=20001
MaxJobCount=40000
MinJobAge=300
SchedulerParameters=sched_interval=2,bf_interval=2
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SlurmdTimeout=10
KillWait=5
SlurmdParameters=config_overrides
NodeName=n[1-{nodes}] NodeHostname=localhost NodeAddr=127.0.0.1 Port=[27821-2782{nodes}] CPUs={slots} RealMemory=1000 State=UNKNOWN
PartitionName=render Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def run(*command, **more):
    return subprocess.run([str(part) for part in command], check=True, capture_output=True, text=True,
                          stdin=subprocess.DEVNULL, **more).stdout.strip()


def seconds_of(work):
    begin = time.monotonic()
    work()
    return time.monotonic() - begin


def fastest(work):
    return min(seconds_of(work) for _ in range(5))


def wait(seconds, what, condition, period=0.05):
    """Returns the seconds until the condition holds, or None after `seconds`."""
    begin = time.monotonic()
    while not condition():
        if time.monotonic() - begin > seconds:
            print(f"after {seconds} s still not: {what}", flush=True)
            return None
        time.sleep(period)
    return time.monotonic() - begin


def cpu_of(pid):
    """Returns the CPU seconds of a process, without its children."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def cpu_of_ended():
    """Reaps the orphans that this process has adopted. Returns the CPU seconds of all ended children."""
    try:
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass
    except ChildProcessError:
        pass
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def descendants(of):
    """Returns the processes that have `of`, as bytes, in their environment."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            try:
                if of in (entry / "environ").read_bytes().split(b"\0"):
                    found.append(int(entry.name))
            except OSError:
                pass
    return found


class Slurm:
    NAME = "Slurm"

    def __init__(self):
        self.folder = Path(tempfile.mkdtemp(prefix="tessera-peer."))
        self.folder.chmod(0o755)
        for name, mode in (("run", 0o755), ("state", 0o755), ("log", 0o755), ("spool", 0o755), ("munge-run", 0o755),
                           ("munge", 0o700)):
            (self.folder / name).mkdir(mode=mode)
        (self.folder / "munge/key").write_bytes(os.urandom(1024))
        (self.folder / "munge/key").chmod(0o400)
        run("chown", "-R", "munge:munge", self.folder / "munge", self.folder / "munge-run")
        conf = self.folder / "slurm.conf"
        conf.write_text(CONF.format(folder=self.folder, nodes=NODES, slots=SLOTS))
        os.environ["SLURM_CONF"] = str(conf)
        self.mark = f"SLURM_CONF={conf}".encode()
        munge = self.folder / "munge-run"
        run("runuser", "-u", "munge", "--", "munged", f"--key-file={self.folder}/munge/key",
            f"--socket={munge}/munge.socket", f"--pid-file={munge}/munged.pid", f"--log-file={self.folder}/munge/log",
            f"--seed-file={self.folder}/munge/seed", "--force")
        self.munged = int((munge / "munged.pid").read_text())
        run("slurmctld", "-f", conf, "-c")
        for node in range(1, NODES + 1):
            run("slurmd", "-f", conf, "-N", f"n{node}")
        wait(60, "the nodes are idle", lambda: "idle" in run("sinfo", "--noheader", "--format=%t"))
        self.version = run("sinfo", "--version")

    def submit(self, tasks, *options):
        return run("sbatch", "--parsable", f"--array=0-{tasks - 1}", "--output=/dev/null", *options, "--wrap=true",
                   cwd="/")

    def submit_one(self):
        run("sbatch", "--parsable", "--output=/dev/null", "--wrap=true", cwd="/")

    def is_idle(self):
        return not run("squeue", "--noheader")

    def is_done(self, job):
        return not run("squeue", "--noheader", f"--jobs={job}", "--states=PD,R,CF,CG", "--format=%i")

    def server_pids(self):
        return [int((self.folder / "run/slurmctld.pid").read_text())]

    def worker_pids(self):
        return [int((self.folder / f"run/slurmd.n{node}.pid").read_text()) for node in range(1, NODES + 1)]

    def time_to_replace(self, limit):
        job = run("sbatch", "--parsable", "--requeue", "--output=/dev/null", "--wrap=sleep 600", cwd="/")
        state = lambda: run("squeue", "--noheader", f"--jobs={job}", "--format=%t %N").split()
        wait(60, "the task runs", lambda: state()[0] == "R")
        node = state()[1]
        steps = [pid for pid in descendants(self.mark) if f"slurmstepd: [{job}." in
                 Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")]
        victim = int((self.folder / f"run/slurmd.{node}.pid").read_text())
        for pid in [victim, *steps]:
            os.kill(pid, signal.SIGKILL)

        def runs_elsewhere():
            now = state()
            return len(now) == 2 and now[0] == "R" and now[1] != node
        return wait(limit, "the task runs elsewhere", runs_elsewhere, 0.2)

    def list_times(self, count):
        """Returns the seconds of a list of all, and of what users see first, and what these are."""
        self.submit(count, "--hold")
        return (fastest(lambda: run("squeue", "--array")), "`squeue --array`",
                fastest(lambda: run("squeue")), "`squeue`, arrays as one line")

    def close(self):
        for number in (signal.SIGTERM, signal.SIGKILL):
            for pid in [*descendants(self.mark), self.munged]:
                try:
                    os.kill(pid, number)
                except ProcessLookupError:
                    pass
            time.sleep(1)
        shutil.rmtree(self.folder, ignore_errors=True)


class Tessera:
    NAME = "Tessera"

    def __init__(self):
        self.folder = Path(tempfile.mkdtemp(prefix="tessera-peer."))
        self.server = f"unix:{self.folder}/server.sock"
        self.version = run(BIN / "tessera", "--version").splitlines()[0]
        self.processes, self.server_process = [], None
        self.start_server()
        self.workers = [self.start_worker(f"w{number}") for number in range(NODES)]
        wait(60, "the workers are there", lambda: len(json.loads(self.call("workers", "--json"))["workers"]) == NODES)

    def start(self, *command):
        log = open(self.folder / "log", "a", encoding="utf-8")  # closed with this process
        self.processes.append(subprocess.Popen([str(part) for part in command], stdin=subprocess.DEVNULL,
                                               stdout=log, stderr=log))
        return self.processes[-1]

    def start_server(self):
        (self.folder / "server.sock").unlink(missing_ok=True)
        self.server_process = self.start(BIN / "tessera-server", "--listen", self.server, "--store",
                                         self.folder / "store")
        wait(60, "the server listens", (self.folder / "server.sock").exists)

    def start_worker(self, name):
        return self.start(BIN / "tessera-worker", "--server", self.server, "--name", name, "--threads", SLOTS,
                          "--cache", self.folder / f"cache-{name}", "--unit-log", self.folder / f"{name}.units")

    def call(self, command, *arguments):
        return run(BIN / "tessera", command, "--server", self.server, *arguments)

    def submit(self, tasks, *options):
        return self.call("submit", SCENE, "--size", "8x8", "--spp", "1", "--frames", f"0-{tasks - 1}", *options)

    def submit_one(self):
        self.call("submit", SCENE, "--size", "8x8", "--spp", "1")

    def is_idle(self):
        jobs = json.loads(self.call("list", "--limit", "0", "--json"))["jobs"]
        return all(job["state"] == "done" for job in jobs)

    def is_done(self, job):
        return json.loads(self.call("status", job, "--json"))["state"] == "done"

    def server_pids(self):
        return [self.server_process.pid]

    def worker_pids(self):
        agents = [worker.pid for worker in self.workers]
        renderers = []
        for pid in agents:
            for task in Path(f"/proc/{pid}/task").iterdir():
                renderers += [int(child) for child in (task / "children").read_text().split()]
        return agents + renderers

    def units(self, name, *events):
        path = self.folder / f"{name}.units"
        lines = [line.split() for line in path.read_text().splitlines()] if path.exists() else []
        return {tuple(line[1:5]) for line in lines if line[0] in events}

    def time_to_replace(self, limit):
        job = self.call("submit", SCENE, "--size", "256x256", "--spp", "2000", "--tile-size", "64")
        ours = lambda name, *events: {unit for unit in self.units(name, *events) if unit[0] == job}
        wait(60, "a task runs", lambda: ours("w0", "started") - ours("w0", "finished"), 0.01)
        pids = [self.workers[0].pid] + [int(pid) for task in Path(f"/proc/{self.workers[0].pid}/task").iterdir()
                                        for pid in (task / "children").read_text().split()]
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        begun = ours("w0", "started") - ours("w0", "finished", "COMMITTED")
        taken = wait(limit, "its units run elsewhere",
                     lambda: begun <= ours("w1", "started") | ours("w2", "started"), 0.01)
        self.call("cancel", job)
        return taken

    def list_times(self, count):
        job = self.call("submit", SCENE, "--size", "64x64", "--spp", "4", "--require-tag", "nobody")
        self.server_process.terminate()
        self.server_process.wait()
        with sqlite3.connect(self.folder / "store/store.db") as rows:
            columns = [row[1] for row in rows.execute("PRAGMA table_info(jobs)")
                       if row[1] not in ("sequence", "id", "request_id", "name")]
            template = rows.execute(f"SELECT {', '.join(columns)} FROM jobs WHERE id = ?", (job,)).fetchone()
            rows.executemany(f"INSERT INTO jobs(id, request_id, name, {', '.join(columns)}) "
                             f"VALUES(?, ?, ?, {', '.join('?' * len(columns))})",
                             ((f"q{i:07d}", f"r{i}", f"shot-{i}", *template) for i in range(count)))
        self.start_server()
        self.call("list")
        return (fastest(lambda: self.call("list", "--limit", "0")), "`tessera list --limit 0`",
                fastest(lambda: self.call("list")), "`tessera list`, the first 100")

    def close(self):
        for process in self.processes:  # renderers end with their agents
            process.kill()
        for process in self.processes:
            process.wait()
        shutil.rmtree(self.folder, ignore_errors=True)


def measure(kind, options):
    """Returns the rows of a system's column."""
    farm = kind()
    try:
        cpu = lambda pids: sum(cpu_of(pid) for pid in pids)
        singles = [seconds_of(farm.submit_one) for _ in range(SINGLES)]
        wait(options.wait, "these are done", farm.is_idle, 0.5)
        before = cpu(farm.server_pids()), cpu(farm.worker_pids()), cpu_of_ended()
        begin = time.monotonic()
        job = farm.submit(options.tasks)
        submitted = time.monotonic() - begin
        clients = cpu_of_ended()
        wait(options.wait, "the tasks are done", lambda: farm.is_done(job), 0.5)
        done = time.monotonic() - begin
        server, workers = cpu(farm.server_pids()) - before[0], cpu(farm.worker_pids()) - before[1]
        polls = cpu_of_ended() - clients
        steps = f" and at most {1e3 * polls / options.tasks:.1f} of its steps" if kind is Slurm else ""
        everything, all_command, first, first_command = farm.list_times(options.listed)
        replaced = farm.time_to_replace(options.wait)
        return {
            "version": farm.version,
            "submit of one task, median of 50": f"{1e3 * statistics.median(singles):.0f} ms",
            f"submit of {options.tasks} tasks in one command": f"{1e3 * submitted:.0f} ms",
            "tasks a second, from the submit to the end of the last": f"{options.tasks / done:.1f}",
            "CPU of the controller, a task": f"{1e3 * server / options.tasks:.2f} ms",
            "CPU of the workers, a task": f"{1e3 * workers / options.tasks:.2f} ms{steps}",
            f"list of {options.listed} waiting jobs": f"{1e3 * everything:.0f} ms ({all_command})",
            "list as users see it first": f"{1e3 * first:.0f} ms ({first_command})",
            "a worker is killed: until its task runs elsewhere":
                f"{replaced:.1f} s" if replaced else f"not within {options.wait} s",
        }
    finally:
        farm.close()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", type=int, default=1000)
    parser.add_argument("--listed", type=int, default=10000)
    parser.add_argument("--wait", type=int, default=240, help="seconds")
    parser.add_argument("systems", nargs="*", default=["tessera", "slurm"])
    options = parser.parse_args()
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)  # Slurm's steps become children of this process
    kinds = {"slurm": Slurm, "tessera": Tessera}
    columns = [measure(kinds[name], options) for name in options.systems]
    print(f"\nload average {os.getloadavg()[0]:.0f}\n")
    print("| |" + "".join(f" {column.pop('version')} |" for column in columns))
    print("|---|" + "---|" * len(columns))
    for row in columns[0]:
        print(f"| {row} |" + "".join(f" {column[row]} |" for column in columns))


if __name__ == "__main__":
    main()
