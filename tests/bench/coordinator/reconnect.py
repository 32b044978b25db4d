#!/usr/bin/env python3
"""Time until all workers are back after a restart of the coordinator, and the CPU time this takes.

    reconnect.py --bin DIR --scratch DIR [--runs 3] [--plain] WORKERS...

Simulated workers over TLS on loopback, or with --plain over a Unix socket, each with its own
connection; they pause between attempts as real ones do. The server is killed and started again on its store three seconds later. The time counts
from its start. Its CPU time, and that of the simulated workers, is that of the same span.
"""

import argparse
import os
import resource
import shutil
import signal
import subprocess
import time
from pathlib import Path

PROCESSES = 4
TICKS = os.sysconf("SC_CLK_TCK")


def cpu_seconds(pid):
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


class Farm:
    def __init__(self, programs, folder, is_plain):
        self.programs, self.folder, self.is_plain = programs, folder, is_plain
        self.address = f"unix:{folder.resolve()}/s" if is_plain else "127.0.0.1:0"
        if not is_plain:
            self.run("init-certs", folder / "certs", "--host", "127.0.0.1")
            self.run("issue-cert", folder / "certs", "--role", "worker", "--name", "w")
        self.start()
        if not is_plain:
            self.run("tokens", "create", "--store", folder / "store", "--out", folder / "token")

    def run(self, *arguments):
        subprocess.run([self.programs / "tessera-server", *arguments], check=True, capture_output=True)

    def start(self):
        command = [self.programs / "tessera-server", "--listen", self.address, "--store",
                   self.folder / "store"]
        if self.is_plain:
            (self.folder / "s").unlink(missing_ok=True)
        else:
            command += ["--certs", self.folder / "certs"]
        with open(self.folder / "server.log", "a") as log:
            self.server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
        self.address = self.server.stdout.readline().strip()

    def kill(self):
        self.server.kill()
        self.server.wait()

    def simulate(self, count):
        command = [self.programs / "bench_simulated_workers", "--server", self.address, "--credits",
                   "4", "--reconnect", "--workers", str(count // PROCESSES)]
        if not self.is_plain:
            token = (self.folder / "token").read_text().strip()
            command += ["--certs", self.folder / "certs" / "worker-w", "--token", token]
        command.append("--name")
        self.workers = [subprocess.Popen(command + [f"sim{i}"], stdin=subprocess.PIPE,
                                         stdout=subprocess.PIPE, text=True)
                        for i in range(PROCESSES)]

    def wait_for_all(self):
        """Returns when the last worker connected, in seconds of the monotonic clock."""
        return max(int(worker.stdout.readline()) for worker in self.workers) * 1e-6

    def workers_cpu_seconds(self):
        return sum(cpu_seconds(worker.pid) for worker in self.workers)

    def end(self):
        for worker in self.workers:
            worker.send_signal(signal.SIGKILL)
            worker.wait()
        self.kill()


def measure(options, count):
    folder = Path(options.scratch) / f"reconnect{count}"
    folder.mkdir(mode=0o700)
    farm = Farm(Path(options.bin), folder, options.plain)
    farm.simulate(count)
    try:
        farm.wait_for_all()
        for _ in range(options.runs):
            time.sleep(3)
            farm.kill()
            time.sleep(3)
            workers_before = farm.workers_cpu_seconds()
            begun = time.monotonic()
            farm.start()
            seconds = farm.wait_for_all() - begun
            server = cpu_seconds(farm.server.pid)
            workers = farm.workers_cpu_seconds() - workers_before
            load = os.getloadavg()[0]
            print(f"{count} workers are back after {seconds:.2f} s; CPU seconds: server {server:.2f} "
                  f"({1e3 * server / count:.2f} ms each), workers {workers:.2f}; load average {load:.0f}",
                  flush=True)
    finally:
        farm.end()
        shutil.rmtree(folder)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bin", required=True)
    parser.add_argument("--scratch", required=True)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--plain", action="store_true")
    parser.add_argument("workers", type=int, nargs="+")
    options = parser.parse_args()
    limit = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (limit, limit))
    for count in options.workers:
        measure(options, count)


main()
