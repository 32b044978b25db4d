"""A farm of real processes for one round of chaos, and the checks after the round."""

import collections
import contextlib
import json
import os
import pathlib
import re
import select
import shutil
import signal
import subprocess
import tempfile
import threading
import time
import uuid

from control import Control
from link import Link
from wide_area import WideAreaLine

BIN = pathlib.Path(os.environ["TESSERA_BIN"])
FAULTS = pathlib.Path(os.environ["TESSERA_FAULTS"])
SCENES = pathlib.Path(__file__).resolve().parents[2] / "scenes"
WORKERS = 4
SMALL_DISK = 64 << 20  # bytes
UNIT_TIMEOUT = 8  # seconds, for workers whose renderers are made to hang
# name: scene and options. Small units, several passes, several frames, and one job with a target error.
JOBS = {
    "passes": ("same_bits.gltf", ["--size", "64x64", "--tile-size", "8", "--spp", "250"]),
    "frames": ("same_bits.gltf", ["--size", "48x48", "--tile-size", "16", "--spp", "60", "--frames", "0-5", "--seed", "3"]),
    "error": ("lit_square.gltf", ["--size", "64x64", "--tile-size", "8", "--error", "0.1"]),
}


class Wrong(Exception):
    """A check failed."""


def run(*command, check=True, timeout=120):
    done = subprocess.run([BIN / command[0], *map(str, command[1:])], stdin=subprocess.DEVNULL,
                          capture_output=True, text=True, timeout=timeout)
    if check and done.returncode != 0:
        raise Wrong(f"{' '.join(map(str, command))}: {done.returncode}: {done.stderr[-2000:]}")
    return done


def undisturbed(jobs=None):
    """Returns pixels and number of units of each job, rendered by one undisturbed worker."""
    pixels = {}
    with tempfile.TemporaryDirectory(prefix="tessera-chaos.") as folder:
        for name, (scene, options) in (jobs or JOBS).items():
            run("tessera", "render", SCENES / scene, "-o", f"{folder}/{name}.exr", *options,
                "--max-depth", 5, "--report", f"{folder}/{name}.json", "--workers", 2, "--threads", 1)
            report = json.loads(pathlib.Path(f"{folder}/{name}.json").read_text())
            pixels[name] = ([f["pixels_sha256"] for f in report["frames"]], report["units"]["total"])
    return pixels


class FaultsControl(Control):
    """Memory shared with faults.cpp."""
    FIELDS = ("clock_offset_s", "sync_us", "disk_full", "clock_answers", "slow_syncs",
              "full_answers", "steps")


class Worker:
    def __init__(self, slot, identity, process, log, units):
        self.slot, self.id, self.process, self.log, self.units = slot, identity, process, log, units

    def renderer(self):
        """Returns the pid of its renderer, or None."""
        for entry in pathlib.Path("/proc").iterdir():
            if entry.name.isdigit():
                try:
                    status = (entry / "stat").read_text()
                except OSError:
                    continue
                if int(status.rsplit(")", 1)[1].split()[1]) == self.process.pid:
                    return int(entry.name)
        return None

    def signal(self, number):
        """Sends a signal to agent and renderer."""
        for pid in filter(None, (self.process.pid, self.renderer())):
            try:
                os.kill(pid, number)
            except ProcessLookupError:
                pass

    def text(self):
        return self.log.read_text(errors="replace") if self.log.exists() else ""

    def await_drain(self, seconds):
        """Waits for its end after SIGTERM. A program that was only just started and does not handle SIGTERM yet
        dies of it, which takes nothing from the farm."""
        status = self.process.wait(seconds)
        if status != 0 and not (status == -signal.SIGTERM and not self.text()):
            raise Wrong(f"{self.id} ended with {status} on SIGTERM")


class Farm:
    """One client with a few jobs, on a Unix socket."""
    TEMPLATES = JOBS
    FURTHER = "passes"  # template of further jobs, while a fault needs the round to last
    LEAST_OPEN = 1  # number of unfinished jobs at which a further one is submitted
    LOOK_EVERY = 0.2  # seconds between looks at the states of the jobs
    unit_pause_ms = 0  # time that workers sleep before each unit

    def __init__(self, kinds):
        self.audit = "1" if "faulty_worker" in kinds else "0.01"  # finds a faulty worker before its pixels are used
        self.work = pathlib.Path(tempfile.mkdtemp(prefix="tessera-chaos."))
        self.mark = f"TESSERA_CHAOS_ROUND={uuid.uuid4()}"
        self.socket = self.work / "server.sock"
        self.disk = self.work / "disk"  # of the store
        self.disk.mkdir()
        self.is_small = "small_disk" in kinds
        if self.is_small:  # in the mount namespace of this process, with which it disappears at the latest
            subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={SMALL_DISK}", "tessera-chaos",
                            self.disk], check=True)
        self.store = self.disk / "store"
        self.control = FaultsControl(self.work / "server.control")
        self.server_lock = threading.RLock()  # held by the fault that disturbs the server
        self.workers_lock = threading.Lock()
        self.free = collections.deque()  # slots that no fault is disturbing
        self.server = None
        self.workers = {}
        self.all_workers = []
        self.jobs = {}
        self.states_by_id = {}  # as the last states() saw them
        self.started_at = 0.0  # time at which the server was started
        self.log_start = 0  # length of the log of earlier servers
        self.over = False
        self.is_alone = kinds == ["kill_worker"]  # no other fault: times can be measured
        self.times = None  # seconds from death to loss, and from loss until its units run again
        self.found_faulty = False  # a faulty worker was found
        self.links = self.make_links()
        for link in self.links:
            link.start()
        self.line = None  # created when it is first needed
        self.has_room = True  # false while a fault fills the disk
        self.in_need = 0  # number of unfinished faults, for which the round must last
        self.more = 0  # further jobs
        self.disturbed = threading.local()  # .processes: those that this thread's fault disturbs

    # Addresses, which farms with certificates override ----------------------------------------------

    def make_links(self):
        """Returns one link per worker, through which it reaches the server."""
        return [Link(str(self.work / f"w{slot}.sock"), str(self.socket)) for slot in range(WORKERS)]

    def server_options(self):
        self.socket.unlink(missing_ok=True)
        return ["--listen", f"unix:{self.socket}"]

    def worker_options(self, slot, identity):
        """Returns how the worker with this ID reaches the server."""
        return ["--server", f"unix:{self.links[slot].path}"]

    def call(self, command, *arguments, check=True, job=None):
        """Runs a command of `tessera` on this farm, as the owner of the job with this name if given."""
        return run("tessera", command, *arguments, "--server", f"unix:{self.socket}", check=check)

    def template(self, name):
        """Returns the template of the job with this name."""
        return name.split("+")[0]

    # Processes ------------------------------------------------------------------------------------

    def environment(self, control, **more):
        name, value = self.mark.split("=")
        return {**os.environ, name: value, "LD_PRELOAD": str(FAULTS), "FAULTS_CONTROL": control.path,
                **more}

    def start_server(self, cut_at=0):
        """Returns whether it listens; with `cut_at` the power cut may come before that."""
        environment = self.environment(self.control, FAULTS_STORE=str(self.store),
                                       FAULTS_LOG=str(self.work / "cuts.log"), FAULTS_CUT_AT=str(cut_at))
        with open(self.work / "server.log", "a") as log:
            self.log_start = log.tell()
            self.server = subprocess.Popen(
                [BIN / "tessera-server", *self.server_options(), "--store", self.store,
                 "--audit-fraction", self.audit], env=environment, stdout=subprocess.PIPE, stderr=log)
        if not select.select([self.server.stdout], [], [], 60)[0]:
            raise Wrong("after 60 s the server still does not listen")
        listens = bool(self.server.stdout.readline())
        self.started_at = time.monotonic()
        return listens

    def kill_server(self):
        self.server.kill()
        self.server.wait()

    def inspect_dead_store(self):
        """Checks that all acknowledged units are in the store of a server that died, before any repair."""
        if (self.store / "store.db").exists():
            found = run("tessera-server", "check", self.store, check=False)
            # A store whose first start did not end has no rows yet.
            if found.returncode != 0 and "has schema 0" not in found.stderr:
                raise Wrong(f"the store is damaged:\n{found.stdout}{found.stderr}")

    def restart_server(self, cut_at=0):
        self.inspect_dead_store()
        return self.start_server(cut_at)

    def start_worker(self, slot, *faults):
        identity = f"w{slot}-{len(self.all_workers)}"
        control = FaultsControl(self.work / f"{identity}.control")
        options = ["--unit-timeout", str(UNIT_TIMEOUT)] if slot == 0 else []
        options += ["--fault-deliver-twice"] if slot == 1 else []
        options += ["--fault-pause", str(self.unit_pause_ms)] if self.unit_pause_ms else []
        options += faults
        log, units = self.work / f"{identity}.log", self.work / f"{identity}.units"
        with open(log, "a") as file:
            process = subprocess.Popen(
                [BIN / "tessera-worker-faults", *self.worker_options(slot, identity), "--id", identity,
                 "--name", identity, "--threads", "1", "--cache", self.work / f"cache{slot}",
                 "--unit-log", units, *options],
                env=self.environment(control), stdin=subprocess.DEVNULL, stdout=file, stderr=file)
        worker = Worker(slot, identity, process, log, units)
        worker.control = control
        self.workers[slot] = worker
        self.all_workers.append(worker)
        return worker

    def start(self):
        if not self.start_server():
            raise Wrong("the server does not start")
        for slot in range(WORKERS):
            self.start_worker(slot)
            self.free.append(slot)

    def submit(self):
        for name in JOBS:
            self.jobs[name] = self.submit_one(name, name).stdout.strip()

    def submit_one(self, template, name, check=True):
        scene, options = self.TEMPLATES[template]
        return self.call("submit", SCENES / scene, *options, "--max-depth", 5, "--name", name, check=check,
                         job=name)

    def submit_further(self):
        self.more += 1  # no name is used twice, because a call without an answer may have created the job
        self.submit_one(self.FURTHER, f"{self.FURTHER}+{self.more}", check=False)

    @contextlib.contextmanager
    def time_needed(self):
        """Keeps the round going: while the context is active, the farm gets further jobs."""
        with self.workers_lock:
            self.in_need += 1
        try:
            yield
        finally:
            with self.workers_lock:
                self.in_need -= 1

    def open_line(self):
        self.line = WideAreaLine(self.work, str(self.socket), self.environment(self.control, LD_PRELOAD=""))
        return self.line

    def close_line(self):
        if self.line:
            self.line.close()
            self.line = None

    def note_disturbed(self, name, **pids):
        """Records as evidence that the calling thread's fault disturbs these processes."""
        self.disturbed.processes.append({"name": name, **pids})

    def snapshot(self):
        """Returns the state of the farm, for the evidence."""
        acks = self.acknowledgements()
        return {"units_committed": sum(n for (event, _), n in acks.items() if event == "COMMITTED"),
                "units_held": {worker.id: len(self.held_by(worker)) for worker in self.workers.values()},
                "server_pid": self.server.pid if self.server and self.server.poll() is None else None,
                "workers": {worker.id: worker.process.pid for worker in self.workers.values()
                            if worker.process.poll() is None}}

    # Observation ----------------------------------------------------------------------------------

    def log(self):
        return (self.work / "server.log").read_text(errors="replace")

    def has_seen(self, worker):
        """Returns whether the worker has connected to the server since the server was started."""
        log = (self.work / "server.log").read_bytes()[self.log_start:]
        return f"worker {worker.id} connected".encode() in log

    def acknowledgements(self):
        """Returns a counter of (acknowledgement, unit) over all workers."""
        counts = collections.Counter()
        for worker in self.all_workers:
            if worker.units.exists():
                for line in worker.units.read_text().splitlines():
                    event, *unit = line.split()[:5]
                    if event.isupper() and len(unit) == 4:
                        counts[event, tuple(unit)] += 1
        return counts

    def committed(self):
        return sum(n for (event, _), n in self.acknowledgements().items() if event == "COMMITTED")

    def settled(self):
        """Returns the acknowledged units."""
        return {unit for _, unit in self.acknowledgements()}

    def started(self, dead):
        """Returns the units that a worker other than the dead one has started."""
        return {tuple(line.split()[1:5]) for worker in self.all_workers if worker is not dead
                for line in (worker.units.read_text().splitlines() if worker.units.exists() else [])
                if line.startswith("started")}

    def held_by(self, worker):
        """Returns the units that a worker has started and that are not acknowledged."""
        held = set()
        if worker.units.exists():
            for line in worker.units.read_text().splitlines():
                event, *unit = line.split()[:5]
                if event in ("started", "finished"):
                    held.add(tuple(unit))
                elif len(unit) == 4:
                    held.discard(tuple(unit))
        return held

    def unfinished_by(self, worker):
        """Returns the units that a worker has started and not finished, and so not delivered."""
        events = [line.split() for line in worker.units.read_text().splitlines()] if worker.units.exists() else []
        return {tuple(event[1:5]) for event in events if event[0] == "started"} - {
            tuple(event[1:5]) for event in events if event[0] != "started"}

    def wait(self, seconds, what, condition):
        """Waits until the condition holds. Returns None if the round ends before."""
        end = time.monotonic() + seconds
        while True:
            value = condition()
            if value or self.over:
                return value
            if time.monotonic() > end:
                raise Wrong(f"after {seconds} s still not: {what}")
            time.sleep(0.02)

    def report(self, name):
        return json.loads(self.call("report", name, "--json", job=name).stdout)

    def duplicated(self):
        """Returns the number of duplicated blocks of the jobs that the server knows."""
        reports = [self.call("report", name, "--json", check=False, job=name) for name in list(self.jobs)]
        return sum(json.loads(report.stdout)["units"]["duplicated"]
                   for report in reports if report.returncode == 0)

    def states(self):
        """Returns state and reason of each job, or None while the server does not answer."""
        done = self.call("list", "--limit", 0, "--json", check=False)
        if done.returncode != 0:
            return None
        jobs = json.loads(done.stdout)["jobs"]
        self.states_by_id = {job["id"]: job["state"] for job in jobs}
        return {job["name"]: ("failed" if job["paused_by"] == "failures" else job["state"], job["reason"])
                for job in jobs}

    def is_submitted(self, states):
        """Returns whether all jobs of the round have been submitted."""
        return set(self.TEMPLATES) <= set(states)

    def may_resume(self):
        """Returns whether jobs that a full disk has paused may be resumed by their owner now."""
        return self.has_room

    def finish(self, seconds):
        """Waits until all jobs are done; resumes jobs that a full disk has paused."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            states = self.states()
            if states and self.is_submitted(states):
                if any(state in ("failed", "cancelled") for state, _ in states.values()):
                    raise Wrong(f"a job ended badly: {states}")
                open_jobs = sum(state != "done" for state, _ in states.values())
                if open_jobs == 0 and not self.in_need:
                    self.over = True
                    return
                if open_jobs <= self.LEAST_OPEN and self.in_need:
                    self.submit_further()
                for name, (state, reason) in states.items():
                    if state == "paused" and "store full" in reason and self.may_resume():
                        self.call("resume", name, check=False, job=name)
            time.sleep(self.LOOK_EVERY)
        raise Wrong(f"not done after {seconds} s: {self.states()}")

    # Checks after the round -----------------------------------------------------------------------

    def check_results(self, expected):
        """Checks that every job has the expected pixels and units. Returns the hashes by job."""
        hashes = {}
        for name in self.states():
            pixels, units = expected[self.template(name)]
            report = self.report(name)
            found = [frame["pixels_sha256"] for frame in report["frames"]]
            hashes[name] = {"pixels_sha256": found, "expected_sha256": pixels}
            if found != pixels:
                raise Wrong(f"job {name}: pixels differ from the undisturbed run's")
            if report["units"]["total"] != units or report["units"]["committed"] != units:
                raise Wrong(f"job {name}: units {report['units']}, undisturbed {units}")
            if not self.found_faulty and (report["units"]["mismatched"] or report["units"]["redone"]):
                raise Wrong(f"job {name}: units {report['units']}")
        if self.found_faulty:
            return hashes  # units of the faulty worker were rendered again
        twice = [unit for (event, unit), n in self.acknowledgements().items() if event == "COMMITTED" and n > 1]
        if twice:
            raise Wrong(f"acknowledged and rendered again: {twice}")
        return hashes

    def evidence(self):
        """Returns what the evidence of a round says beside its faults and frames."""
        return {}

    def stop(self):
        """Stops all processes and checks that nothing is left behind."""
        for worker in self.workers.values():
            worker.process.terminate()
        for worker in self.workers.values():
            worker.await_drain(30)
        self.server.terminate()
        if self.server.wait(30) != 0:
            raise Wrong(f"the server ended with {self.server.returncode} on SIGTERM")
        for link in self.links:
            link.stopping = True
            link.join()
        self.close_line()
        self.inspect_dead_store()
        left = self.processes()
        if left:
            raise Wrong(f"processes left behind: {left}")
        # A listening socket has flag 00010000; none may be left in our directory.
        for line in pathlib.Path("/proc/net/unix").read_text().splitlines():
            if str(self.work) in line and line.split()[3] == "00010000":
                raise Wrong(f"a socket is left behind: {line}")
        known = re.compile(r"disk|cuts\.log|line\.(control|sock)|server\.(log|control|sock)|cache\d"
                           r"|w\d(-\d+)?\.(sock|log|units|control)|certs")
        extra = [entry.name for entry in self.work.iterdir() if not known.fullmatch(entry.name)]
        extra += [entry.name for entry in self.disk.iterdir()
                  if not re.fullmatch(r"store|store\.lost\.\d+", entry.name)]
        extra += [str(part) for part in self.work.glob("cache*/**/*.part")]
        if extra:
            raise Wrong(f"files left behind: {extra}")

    def processes(self):
        found = []
        for entry in pathlib.Path("/proc").iterdir():
            if entry.name.isdigit() and int(entry.name) != os.getpid():
                try:
                    if self.mark.encode() in (entry / "environ").read_bytes().split(b"\0"):
                        found.append(int(entry.name))
                except OSError:
                    pass
        return found

    def close(self, keep=False):
        """Kills and removes everything, however the round ended."""
        self.over = True
        for pid in self.processes():
            for number in (signal.SIGCONT, signal.SIGKILL):
                try:
                    os.kill(pid, number)
                except ProcessLookupError:
                    pass
        for process in [self.server, *(worker.process for worker in self.all_workers)]:
            if process:
                process.wait()
        for link in self.links:
            link.stopping = True
        self.close_line()
        if keep:
            return
        if self.is_small:
            subprocess.run(["umount", self.disk], check=False)
        shutil.rmtree(self.work, ignore_errors=True)
