"""The kinds of faults. Each is a function (farm, rng) that returns its effect, or None if it took none."""

import contextlib
import os
import re
import signal
import subprocess
import threading
import time

import wide_area as wide_area_line

SILENCE = 5.0  # seconds after which a worker is lost and its units are leased again
LONGER = SILENCE + 1.5


def may_mount():
    return os.geteuid() == 0 and subprocess.run(
        ["unshare", "--mount", "mount", "-t", "tmpfs", "none", "/mnt"], check=False,
        stderr=subprocess.DEVNULL).returncode == 0


class Pulse(threading.Thread):
    """Measures in a context the maximum delay of a timer, in seconds: how long the machine held up this
    process, and so perhaps the farm."""
    EVERY = 0.05

    def __init__(self):
        super().__init__(daemon=True)
        self.late, self.over = 0.0, threading.Event()

    def run(self):
        due = time.monotonic() + self.EVERY
        while not self.over.wait(max(0.0, due - time.monotonic())):
            self.late = max(self.late, time.monotonic() - due)
            due = time.monotonic() + self.EVERY

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.over.set()
        self.join()


@contextlib.contextmanager
def a_worker(farm, slot=None):
    """Returns a worker that no other fault disturbs; the one in `slot` if given."""
    taken = None
    while taken is None and not farm.over:
        with farm.workers_lock:
            if farm.free and slot is None:
                taken = farm.free.popleft()
            elif slot in farm.free:
                farm.free.remove(slot)
                taken = slot
        if taken is None:
            time.sleep(0.05)
    try:
        worker = farm.workers[taken] if taken is not None else None
        if worker:
            farm.note_disturbed(worker.id, agent_pid=worker.process.pid, renderer_pid=worker.renderer())
        yield worker
    finally:
        if taken is not None:
            with farm.workers_lock:
                farm.free.append(taken)


@contextlib.contextmanager
def the_server(farm):
    """Returns the coordinator, which no other fault may disturb meanwhile."""
    with farm.server_lock:
        farm.note_disturbed("server", pid=farm.server.pid)
        yield


def holding(farm, worker):
    """Waits until the worker holds units. Returns their number, or None."""
    return worker and farm.wait(60, f"{worker.id} holds units", lambda: len(farm.held_by(worker)))


def held_by_all(farm):
    """Returns the number of units that the workers hold."""
    return sum(len(farm.held_by(worker)) for worker in farm.workers.values())


def loss_of(farm, worker):
    """Returns a function that tells whether the worker was lost since this call. A server that was
    started a moment ago has not seen the worker and gives it up after the same silence."""
    count = lambda: farm.log().count(f"worker {worker.id} is lost")
    before = count()

    def is_lost():
        is_given_up = not farm.has_seen(worker) and time.monotonic() - farm.started_at > LONGER
        return count() > before or is_given_up
    return is_lost


def kill_worker(farm, rng):
    """kill -9 of agent and renderer; another worker joins in its place."""
    with a_worker(farm) as worker:
        held = holding(farm, worker)
        if not held:
            return None
        is_lost = loss_of(farm, worker)
        worker.signal(signal.SIGKILL)
        killed = time.monotonic()
        worker.process.wait()
        units = farm.unfinished_by(worker) - farm.settled()
        pause = rng.uniform(0, 1)
        if not farm.is_alone:
            time.sleep(pause)
        elif units:
            with Pulse() as pulse:
                farm.wait(60, "the dead worker is lost", is_lost)
            lost = time.monotonic()
            farm.wait(60, "its units run elsewhere",
                      lambda: units <= farm.settled() | farm.started(worker))
            again = time.monotonic()
            if pulse.late < 0.3:  # otherwise the server may have been held up too and waits longer on purpose
                farm.times = (lost - killed, again - lost)
        farm.start_worker(worker.slot)
        if farm.is_alone and not farm.times:
            return None  # it had finished all its units, or the machine stalled
        return f"{worker.id} held {held} units" + (
            f", lost after {farm.times[0]:.2f} s, running elsewhere {farm.times[1]:.2f} s later"
            if farm.times else "")


def kill_renderer(farm, rng):
    """kill -9 of the renderer during a unit, which must only be a failure of this unit."""
    with a_worker(farm) as worker:
        if not holding(farm, worker):
            return None
        renderer = worker.renderer()
        if renderer is None:
            return None
        os.kill(renderer, signal.SIGKILL)
        farm.wait(30, "the agent notices", lambda: "renderer process died" in worker.text())
        return f"of {worker.id}" if "renderer process died" in worker.text() else None


def stop_worker(farm, rng):
    """SIGSTOP for longer than the time-out, then SIGCONT: late results get an acknowledgement."""
    with a_worker(farm) as worker:
        held = holding(farm, worker)
        if not held:
            return None
        is_lost = loss_of(farm, worker)
        worker.signal(signal.SIGSTOP)
        try:
            farm.wait(60, "the stopped worker is lost", is_lost)
        finally:
            worker.signal(signal.SIGCONT)
        return f"{worker.id} held {held} units and was lost" if is_lost() else None


def stop_during_a_unit(farm, worker):
    """Stops the renderer of a worker while it renders a unit. Returns its process ID, None if it could not."""
    is_rendering = lambda: farm.unfinished_by(worker)
    while farm.wait(120, f"{worker.id} renders", is_rendering):
        renderer = worker.renderer()
        with contextlib.suppress(ProcessLookupError):  # the agent may replace it at any time
            if renderer is not None:
                os.kill(renderer, signal.SIGSTOP)
        time.sleep(0.2)  # a unit that was finished just before is written to the log meanwhile
        if is_rendering() and renderer is not None and renderer == worker.renderer():
            return renderer
        resume(renderer)
    return None


def resume(renderer):
    """SIGCONT, if there is such a process."""
    with contextlib.suppress(ProcessLookupError):
        if renderer is not None:
            os.kill(renderer, signal.SIGCONT)


def hang(farm, rng):
    """A renderer is stopped; its agent kills it after --unit-timeout. It may be between two units by then."""
    with a_worker(farm, slot=0) as worker:
        if not worker:
            return None
        renderer = stop_during_a_unit(farm, worker)
        if renderer is None:
            return None
        is_killed = lambda: re.search("timed out; killing the renderer|does not respond; killing it", worker.text())
        try:
            farm.wait(60, "the agent notices", is_killed)
        finally:
            resume(renderer)
        return f"the renderer of {worker.id} was killed" if is_killed() else None


def slow_worker(farm, rng):
    """A renderer gets a tenth of the time: it is stopped for 90 of every 100 ms."""
    with a_worker(farm) as worker:
        if not holding(farm, worker):
            return None
        renderer = worker.renderer()
        if renderer is None:
            return None
        stops, end = 0, time.monotonic() + 4
        with contextlib.suppress(ProcessLookupError):
            while time.monotonic() < end and not farm.over:
                os.kill(renderer, signal.SIGSTOP)
                time.sleep(0.09)
                os.kill(renderer, signal.SIGCONT)
                time.sleep(0.01)
                stops += 1
        return f"{worker.id} was stopped {stops} times" if stops >= 10 else None


def drain_worker(farm, rng):
    """SIGTERM to agent and renderer, as Slurm and systemd send it: the worker finishes or returns its
    units within --grace and exits with 0, no unit fails, and another worker joins."""
    with a_worker(farm) as worker:
        held = holding(farm, worker)
        if not held:
            return None
        renderer = worker.renderer()
        if renderer is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(renderer, signal.SIGTERM)
        worker.process.terminate()
        worker.await_drain(30)
        if "killed by SIGTERM" in worker.text():
            raise AssertionError(f"the renderer of {worker.id} died of SIGTERM")
        farm.start_worker(worker.slot)
        return f"{worker.id} held {held} units, {len(farm.held_by(worker))} at its end"


def cut_message(farm, rng):
    """The connection breaks within a message, after a random number of bytes."""
    with a_worker(farm) as worker:
        if not worker:
            return None
        link = farm.links[worker.slot]
        before = len(link.cuts)
        link.cut_in = rng.randrange(1, 40000)
        try:
            farm.wait(60, "bytes flow", lambda: len(link.cuts) > before)
        finally:
            link.cut_in = None
        if len(link.cuts) == before:
            return None
        passed, lost = link.cuts[-1]
        return f"of {worker.id}: {passed} bytes of a read passed, {lost} did not"


def partition(farm, rng):
    """Network partition for longer than the time-out: nothing is transmitted and nothing refused."""
    with a_worker(farm) as worker:
        held = holding(farm, worker)
        if not held:
            return None
        link, is_lost = farm.links[worker.slot], loss_of(farm, worker)
        link.held_bytes, link.held = 0, True
        try:
            farm.wait(60, "the worker behind it is lost", is_lost)
            time.sleep(rng.uniform(0, 1))
        finally:
            link.held = False
        if not is_lost() or not link.held_bytes:
            return None
        return f"{worker.id} was lost with {held} units, {link.held_bytes} bytes waited"


def late_delivery(farm, rng):
    """Bytes from a worker arrive seconds late, in order."""
    with a_worker(farm) as worker:
        if not holding(farm, worker):
            return None
        link = farm.links[worker.slot]
        before = link.late_bytes
        link.delay = rng.uniform(1, SILENCE - 1)
        time.sleep(2)
        link.delay = 0.0
        late = link.late_bytes - before
        return f"{late} bytes of {worker.id}" if late > 1000 else None


def duplicate(farm, rng):
    """The worker in slot 1 delivers every block twice; the second ones must be acknowledged as duplicates."""
    farm.note_disturbed(farm.workers[1].id, agent_pid=farm.workers[1].process.pid)
    count = farm.wait(60, "blocks come again", farm.duplicated)
    return f"{count} blocks came again" if count else None


def replaced(farm, worker, *faults):
    """Replaces this worker by one with the given fault options."""
    worker.process.terminate()
    worker.process.wait(30)
    return farm.start_worker(worker.slot, *faults)


def faulty_worker(farm, rng):
    """A worker flips a bit in every third of its blocks. All units of the round are audited."""
    with a_worker(farm) as worker:
        if not worker:
            return None
        faulty = replaced(farm, worker, "--fault-corrupt-every", "3")
        found = f"worker {faulty.id} quarantined"
        farm.found_faulty = True
        farm.wait(120, "the faulty worker is found", lambda: found in farm.log())
        replaced(farm, faulty)
        farm.found_faulty = found in farm.log()
        return found if farm.found_faulty else None


def forger(farm, rng):
    """Before each block, a worker delivers a forged one with an attempt that it was not granted."""
    with a_worker(farm) as worker:
        if not worker:
            return None
        faulty = replaced(farm, worker, "--fault-forge")
        rejected = lambda: sum("REJECTED" in line and "seal" in line
                               for line in faulty.units.read_text().splitlines()
                               ) if faulty.units.exists() else 0
        farm.wait(60, "forged blocks are rejected", rejected)
        replaced(farm, faulty)
        return f"{rejected()} forged blocks rejected" if rejected() else None


def kill_server(farm, rng):
    """kill -9 of the coordinator; workers keep their units and results."""
    with the_server(farm):
        if not farm.wait(60, "units are held", lambda: held_by_all(farm)):
            return None
        farm.kill_server()
        time.sleep(rng.uniform(0, 1))
        held = held_by_all(farm)
        farm.restart_server()
        return f"{held} units were held"


def stop_server(farm, rng):
    """SIGSTOP of the coordinator for longer than the time-out; no worker may be lost because of it."""
    with the_server(farm):
        if farm.over:
            return None
        farm.server.send_signal(signal.SIGSTOP)
        try:
            time.sleep(LONGER)
        finally:
            farm.server.send_signal(signal.SIGCONT)
        gone = [worker for worker in farm.all_workers if "connection lost" in worker.text()]
        return f"{len(gone)} workers connected again" if gone else None


def power_cut(farm, rng, steps=(1, 250)):
    """Power cut at a random step of the journal: everything that was not synced is lost."""
    with the_server(farm):
        if farm.over:
            return None
        farm.kill_server()
        if farm.restart_server(cut_at=rng.randrange(*steps)):
            end = time.monotonic() + 30
            while farm.server.poll() is None and time.monotonic() < end and not farm.over:
                time.sleep(0.02)
            if farm.server.poll() is None:  # prevents a later power cut outside this fault
                farm.kill_server()
                farm.restart_server()
                return None
        farm.server.wait()
        farm.restart_server()
        lines = (farm.work / "cuts.log").read_text().splitlines()
        return lines[-1]


def power_cut_at_start(farm, rng):
    """Power cut while the coordinator starts."""
    return power_cut(farm, rng, steps=(1, 9))


def slow_disk(farm, rng):
    """Each fsync takes 0.2 s longer."""
    with the_server(farm):
        if farm.over:
            return None
        before = farm.control.slow_syncs
        farm.control.sync_us = 200_000
        time.sleep(2)
        farm.control.sync_us = 0
        slow = farm.control.slow_syncs - before
        return f"{slow} syncs were slow" if slow else None


def full_jobs(farm):
    """Returns the jobs that are paused because the disk is full."""
    return [name for name, (state, reason) in (farm.states() or {}).items()
            if state == "paused" and "store full" in reason]


def full_disk(farm, rng):
    """No write succeeds until a job has paused; then there is space again and the job continues."""
    with the_server(farm):
        if not farm.wait(60, "units are held", lambda: held_by_all(farm)):
            return None
        before = farm.control.full_answers
        farm.control.disk_full, farm.has_room = 1, False
        try:
            jobs = farm.wait(60, "a job pauses", lambda: full_jobs(farm))
        finally:
            farm.control.disk_full, farm.has_room = 0, True
        refused = farm.control.full_answers - before
        return f"{refused} writes refused, {len(jobs)} jobs paused" if jobs and refused else None


def small_disk(farm, rng):
    """The store is on a small file system. A large file takes all of the free space until a job has
    paused."""
    with the_server(farm):
        if not farm.wait(60, "units are held", lambda: held_by_all(farm)):
            return None
        ballast = farm.disk / "ballast"
        farm.has_room = False
        try:
            with open(ballast, "wb", buffering=0) as file, contextlib.suppress(OSError):
                while not farm.over:
                    file.write(bytes(1 << 16))
            taken = ballast.stat().st_size
            jobs = farm.wait(60, "a job pauses", lambda: full_jobs(farm))
        finally:
            ballast.unlink()
            farm.has_room = True
        return f"the last {taken} bytes were taken, {len(jobs)} jobs paused" if jobs else None


def wide_area(farm, rng):
    """A worker is moved behind a link of 100 Mbit/s with 20 ms each way that loses 1 % of the packets; the
    link is cut for longer than the time-out."""
    with a_worker(farm) as worker:
        if not worker or farm.over:
            return None
        line = farm.open_line()
        link = farm.links[worker.slot]
        link.move(line.path)
        try:
            farm.wait(120, "packets are lost",
                      lambda: line.control.lost and line.control.passed > 300 and farm.held_by(worker))
            held, is_lost = len(farm.held_by(worker)), loss_of(farm, worker)
            line.control.is_cut = 1
            farm.wait(60, "the worker behind it is lost", is_lost)
            line.control.is_cut = 0
            passed = line.control.passed
            healed = farm.wait(60, "packets pass again", lambda: line.control.passed > passed + 100)
        finally:
            link.move(str(farm.socket))
        if not is_lost() or not line.control.lost or not healed:
            return None
        return (f"{worker.id} was lost with {held} units; of its packets {line.control.passed} passed, "
                f"{line.control.lost} were lost, {line.control.cut} cut off")


def clock_jump(farm, rng):
    """The wall clocks of the coordinator and of a worker jump forwards and backwards by days."""
    with a_worker(farm) as worker:
        if not worker:
            return None
        farm.note_disturbed("server", pid=farm.server.pid)
        controls = (farm.control, worker.control)
        before = [control.clock_answers for control in controls]
        for control in controls:
            control.clock_offset_s = rng.choice((-1, 1)) * rng.randrange(3600, 40 * 86400)
        time.sleep(2)
        for control in controls:
            control.clock_offset_s = 0
        answers = [control.clock_answers - b for control, b in zip(controls, before)]
        return f"{answers} false answers" if all(answers) else None


KINDS = {kind.__name__: kind for kind in (
    kill_worker, kill_renderer, stop_worker, hang, slow_worker, drain_worker, cut_message, partition,
    late_delivery, duplicate, faulty_worker, forger, kill_server, stop_server, power_cut, power_cut_at_start, slow_disk,
    full_disk, small_disk, wide_area, clock_jump)}

# Kinds that need privileges.
if not may_mount():
    print("left out: small_disk, which takes the right to mount")
    del KINDS["small_disk"]
if not wide_area_line.is_possible():
    print("left out: wide_area, which takes the rights to make network namespaces and /dev/net/tun")
    del KINDS["wide_area"]
