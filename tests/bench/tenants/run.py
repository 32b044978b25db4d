#!/usr/bin/env python3
"""Measures how much one tenant at its limits slows down another: the p99 of CreateJob and of a small
ListJobs of a steady client, alone and beside a greedy client that does all its quotas refuse.

    tests/bench/tenants/run.py [--bin build/dev/bin] [--rounds 12] [--seconds 5]

A real tessera-server with certificates, over loopback TCP; the clients are other processes. Rounds
with and without the greedy client alternate, so that changes of the load affect both. Each round
has its p99; the median over the rounds counts, and the quartiles show how far the load moves it.
The greedy client begins when the steady one is at work, with the calls that it has saved up: in
short rounds this burst decides the p99, in rounds of 20 s the time at its quotas does. The greedy
client's own CPU time counts as the server's here, because all share the machine; run it with
`--greedy-nice 19` to give it what is left. Target: less than 20 %.
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


def one_round(arguments, certs, address, is_greedy):
    """Returns the steady client's times, and how often the greedy one was served and refused."""
    greedy = None
    if is_greedy:
        # It connects before the steady client starts: a process that starts and four TLS handshakes take CPU time,
        # which no quota limits. The steady client is at work when the greedy one begins to call.
        greedy = tenant(arguments, "greedy", certs, address, "--greedy", "--delay", CONNECT_S + GREEDY_START_S,
                        "--seconds", arguments.seconds - GREEDY_START_S, nice=arguments.greedy_nice)
    time.sleep(CONNECT_S)
    steady = tenant(arguments, "steady", certs, address, "--seconds", arguments.seconds)
    lines = steady.communicate()[0].splitlines()
    if steady.returncode != 0:
        raise RuntimeError("the steady client failed")
    rows = [[float(word) for word in line.split()] for line in lines]
    counts = [int(word) for word in greedy.communicate()[0].split()] if greedy else [0, 0]
    return {"CreateJob": [row[0] for row in rows], "ListJobs": [row[1] for row in rows]}, counts


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--bin", type=Path, default=ROOT / "build/dev/bin")
    parser.add_argument("--rounds", type=int, default=12)
    parser.add_argument("--seconds", type=float, default=5)
    parser.add_argument("--greedy-nice", type=int, default=0)
    parser.add_argument("--server-option", action="append", default=[], help="such as --client-calls=50")
    arguments = parser.parse_args()
    arguments.bin = arguments.bin.resolve()
    server_binary = str(arguments.bin / "tessera-server")
    with tempfile.TemporaryDirectory(prefix="tenants-") as folder:
        certs = Path(folder) / "certs"
        subprocess.run([server_binary, "init-certs", certs, "--host", "127.0.0.1"], check=True,
                       stderr=subprocess.DEVNULL)
        for name in ("steady", "greedy"):
            subprocess.run([server_binary, "issue-cert", certs, "--role", "client", "--name", name],
                           check=True, stdout=subprocess.DEVNULL)
        server = subprocess.Popen(
            [server_binary, "--listen", "127.0.0.1:0", "--store", str(Path(folder) / "store"),
             "--certs", str(certs), "--log-level", "error", "--client-quota",
             "greedy:jobs=100,calls=50", "--client-quota", "steady:jobs=0",
             *arguments.server_option],
            stdout=subprocess.PIPE, text=True)
        try:
            address = server.stdout.readline().strip()
            times = {False: {"CreateJob": [], "ListJobs": []}, True: {"CreateJob": [], "ListJobs": []}}
            served = refused = 0
            one_round(arguments, certs, address, False)  # warms up
            for number in range(2 * arguments.rounds):
                is_greedy = number % 4 in (1, 2)  # ABBA
                measured, counts = one_round(arguments, certs, address, is_greedy)
                for call, values in measured.items():
                    times[is_greedy][call].append(values)
                served, refused = served + counts[0], refused + counts[1]
        finally:
            server.terminate()
            server.wait()
    seconds = arguments.rounds * arguments.seconds
    print(f"the greedy client was served {served / seconds:.0f} and refused {refused / seconds:.0f} "
          "times a second")
    worst = 0
    for call in ("CreateJob", "ListJobs"):
        p50, p99 = ({kind: [percentile(values, part) for values in times[kind][call]]
                     for kind in (False, True)} for part in (.5, .99))
        change = median(p99[True]) / median(p99[False]) - 1
        worst = max(worst, change)
        print(f"{call}: p50 {median(p50[False]):.2f} -> {median(p50[True]):.2f} ms, "
              f"p99 {spread(p99[False])} -> {spread(p99[True])} ms ({100 * change:+.0f} %, "
              f"{sum(map(len, times[False][call]))} calls each)")
    print("target: less than +20 %:", "met" if worst < .2 else "missed")
    return 0 if worst < .2 else 1


if __name__ == "__main__":
    sys.exit(main())
