#!/usr/bin/env python3
"""Measures how much one tenant at its limits slows down another: the p99 of CreateJob and of a small
ListJobs of a steady client, alone and beside a greedy client that does all its quotas refuse.

    tests/bench/tenants/run.py [--bin build/dev/bin] [--rounds 12] [--seconds 5]

A real tessera-server with certificates, over loopback TCP; the clients are other processes. There
are three kinds of rounds, which take turns so that changes of the load affect all: the steady client
alone; with the greedy client on another server of the same machine; and with both on one server. The
second kind has the cost of a machine that both share: the greedy client's own CPU time, and that of
the second server. Each round has its p99; the median over the rounds counts, and the quartiles show
how far the load moves it. The greedy client begins when the steady one is at work, with the calls
that it has saved up: in short rounds this burst decides the p99, in rounds of 20 s the time at its
quotas does. Target: less than 20 % more on one server than alone.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median, quantiles

ROOT = Path(__file__).resolve().parents[3]
GREEDY_START_S = 0.5
CONNECT_S = 0.7


def percentile(values, part):
    values = sorted(values)
    return values[min(len(values) - 1, int(part * len(values)))]


def spread(values):
    first, middle, third = quantiles(values, n=4)
    return f"{middle:.2f} ({first:.2f} to {third:.2f})"


def tenant(arguments, name, certs, address, *more, nice=0):
    return subprocess.Popen(
        [str(arguments.bin / "bench_tenant"), "--server", address, "--certs",
         str(certs / f"client-{name}"), *map(str, more)],
        stdout=subprocess.PIPE, text=True, preexec_fn=lambda: os.nice(nice))


def start_server(arguments, folder, number, servers):
    """Starts a server and returns its address."""
    servers.append(subprocess.Popen(
        [str(arguments.bin / "tessera-server"), "--listen", "127.0.0.1:0", "--store",
         str(folder / f"store{number}"), "--certs", str(folder / "certs"), "--log-level", "error",
         "--client-quota", f"greedy:jobs=100,calls={arguments.greedy_calls}", "--client-quota",
         "steady:jobs=0", *arguments.server_option],
        stdout=subprocess.PIPE, text=True))
    return servers[-1].stdout.readline().strip()


def one_round(arguments, certs, address, greedy_address):
    """Returns the steady client's times, and how often the greedy one was served and refused."""
    greedy = None
    if greedy_address:
        # It connects before the steady client starts: a process that starts and four TLS handshakes take CPU time,
        # which no quota limits. The steady client is at work when the greedy one begins to call.
        greedy = tenant(arguments, "greedy", certs, greedy_address, "--greedy", "--delay", CONNECT_S + GREEDY_START_S,
                        "--seconds", arguments.seconds - GREEDY_START_S, nice=arguments.greedy_nice)
    time.sleep(CONNECT_S)
    steady = tenant(arguments, "steady", certs, address, "--seconds", arguments.seconds)
    lines = steady.communicate()[0].splitlines()
    if steady.returncode != 0:
        raise RuntimeError("the steady client failed")
    rows = [[float(word) for word in line.split()] for line in lines]
    counts = [int(word) for word in greedy.communicate()[0].split()] if greedy else [0, 0]
    return {"CreateJob": [row[0] for row in rows], "ListJobs": [row[1] for row in rows]}, counts


def measure(arguments, folder, servers):
    """Returns the steady client's times by kind and call, and the greedy one's counts by kind."""
    steady_server, other_server = (start_server(arguments, folder, number, servers) for number in range(2))
    greedy_addresses = {"alone": None, "another server": other_server, "one server": steady_server}
    times = {kind: {"CreateJob": [], "ListJobs": []} for kind in greedy_addresses}
    counts = {kind: [0, 0] for kind in greedy_addresses}
    one_round(arguments, folder / "certs", steady_server, None)  # warms up
    for number in range(arguments.rounds):
        for kind in list(greedy_addresses)[::-1 if number % 2 else 1]:
            measured, count = one_round(arguments, folder / "certs", steady_server, greedy_addresses[kind])
            for call, values in measured.items():
                times[kind][call].append(values)
            counts[kind] = [sum(pair) for pair in zip(counts[kind], count)]
    return times, counts


def report(arguments, times, counts):
    """Prints the figures and returns whether the target is met."""
    seconds = arguments.rounds * arguments.seconds
    worst = 0
    for kind, (served, refused) in counts.items():
        if kind != "alone":
            print(f"{kind}: the greedy client was served {served / seconds:.0f} and refused {refused / seconds:.0f} "
                  "times a second")
    for call in ("CreateJob", "ListJobs"):
        p99 = {kind: [percentile(values, .99) for values in times[kind][call]] for kind in times}
        change = {kind: median(p99[kind]) / median(p99["alone"]) - 1 for kind in times}
        worst = max(worst, change["one server"])
        for kind in times:
            p50 = median(percentile(values, .5) for values in times[kind][call])
            print(f"{call}, {kind}: p50 {p50:.2f} ms, p99 {spread(p99[kind])} ms ({100 * change[kind]:+.0f} %, "
                  f"{sum(map(len, times[kind][call]))} calls)")
    print("target: less than +20 %:", "met" if worst < .2 else "missed")
    return worst < .2


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--bin", type=Path, default=ROOT / "build/dev/bin")
    parser.add_argument("--rounds", type=int, default=12, help="of each kind")
    parser.add_argument("--seconds", type=float, default=5)
    parser.add_argument("--greedy-calls", type=int, default=50, help="its quota of calls per second")
    parser.add_argument("--greedy-nice", type=int, default=0)
    parser.add_argument("--server-option", action="append", default=[], help="such as --client-calls=50")
    arguments = parser.parse_args()
    arguments.bin = arguments.bin.resolve()
    with tempfile.TemporaryDirectory(prefix="tenants-") as name:
        folder = Path(name)
        program = str(arguments.bin / "tessera-server")
        subprocess.run([program, "init-certs", folder / "certs", "--host", "127.0.0.1"], check=True,
                       stderr=subprocess.DEVNULL)
        for client in ("steady", "greedy"):
            subprocess.run([program, "issue-cert", folder / "certs", "--role", "client", "--name", client],
                           check=True, stdout=subprocess.DEVNULL)
        servers = []
        try:
            times, counts = measure(arguments, folder, servers)
        finally:
            for server in servers:
                server.terminate()
                server.wait()
    return 0 if report(arguments, times, counts) else 1


if __name__ == "__main__":
    sys.exit(main())
