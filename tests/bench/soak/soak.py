#!/usr/bin/env python3
"""Submits small jobs to a running farm for a while and samples its processes; run by tests/bench/soak.sh.

    soak.py --duration 15m --server ADDRESS --store DIR --scenes DIR --csv FILE --svg FILE NAME=PID…

Every ten seconds it writes the resident memory and the number of open descriptors of each process, the size of the
store, and the numbers of jobs submitted and done. At the end it prints the median of each value over the second and
the last tenth of the time. It fails if a job failed or a process ended.
"""

import argparse
import csv
import itertools
import json
import os
import random
import statistics
import subprocess
import sys
import time
from pathlib import Path

TESSERA = str(Path(os.environ["TESSERA_BIN"]) / "tessera")
PERIOD = 10  # seconds between samples
MOST_OPEN = 24  # jobs that are not done
# Scene and options of the jobs, which take turns at random.
MIX = [
    ("lit_square.gltf", ["--size", "16x16", "--spp", "4"]),
    ("lit_square.gltf", ["--size", "64x48", "--spp", "8", "--tile-size", "16"]),
    ("same_bits.gltf", ["--size", "24x24", "--spp", "8", "--tile-size", "8", "--frames", "0-3"]),
    ("lit_square.gltf", ["--size", "32x32", "--tile-size", "8", "--error", "0.2"]),
]


def seconds_of(text):
    unit = {"s": 1, "m": 60, "h": 3600}.get(text[-1])
    return float(text[:-1]) * unit if unit else float(text)


def resident_mib(pid):
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    raise SystemExit(f"process {pid} has ended")


def children(pid):
    """Returns the process and its children; a worker has a renderer."""
    pids = [pid]
    for task in Path(f"/proc/{pid}/task").iterdir():
        pids += [int(child) for child in (task / "children").read_text().split()]
    return pids


def size_mib(folder):
    total = 0
    for path, _, names in os.walk(folder):
        for name in names:
            try:
                total += os.lstat(os.path.join(path, name)).st_blocks * 512
            except FileNotFoundError:
                pass  # removed meanwhile
    return total / 1048576


class Soak:
    def __init__(self, options):
        self.options = options
        self.processes = dict(entry.split("=") for entry in options.processes)
        self.rng = random.Random(1)
        self.submitted, self.done, self.open = 0, 0, {}

    def call(self, command, *arguments):
        done = subprocess.run([TESSERA, command, "--server", self.options.server, *arguments], check=True,
                              capture_output=True, text=True, stdin=subprocess.DEVNULL)
        return done.stdout

    def submit(self):
        scene, job = self.rng.choice(MIX)
        seed = ["--seed", str(self.submitted)]  # other pixels each time
        self.open[self.call("submit", str(Path(self.options.scenes) / scene), *job, *seed).strip()] = True
        self.submitted += 1

    def look(self):
        """Counts the jobs that have ended."""
        listed = json.loads(self.call("list", "--limit", "200", "--json"))["jobs"]
        for job in listed:
            if job["id"] not in self.open:
                continue
            if job["state"] in ("failed", "cancelled", "paused"):
                raise SystemExit(f"job {job['id']} is {job['state']}: {job['reason']}")
            if job["state"] == "done":
                del self.open[job["id"]]
                self.done += 1

    def sample(self, at):
        row = {"seconds": round(at)}
        for name, pid in self.processes.items():
            pids = children(int(pid))
            row[f"{name} MiB"] = round(sum(resident_mib(one) for one in pids), 2)
            row[f"{name} descriptors"] = sum(len(os.listdir(f"/proc/{one}/fd")) for one in pids)
        row["store MiB"] = round(size_mib(self.options.store), 2)
        row["jobs submitted"], row["jobs done"] = self.submitted, self.done
        return row

    def run(self, seconds):
        begin = time.monotonic()
        rows = [self.sample(0)]
        with open(self.options.csv, "w", newline="", encoding="utf-8") as file:
            table = csv.DictWriter(file, rows[0])
            table.writeheader()
            for tick in itertools.count(1):
                while time.monotonic() - begin < tick * PERIOD:
                    if len(self.open) < MOST_OPEN:
                        self.submit()
                    else:
                        time.sleep(0.2)
                    if len(self.open) >= MOST_OPEN:
                        self.look()
                rows.append(self.sample(time.monotonic() - begin))
                table.writerow(rows[-1])
                file.flush()
                if rows[-1]["seconds"] >= seconds:
                    return rows


def plot(rows, path):
    """Draws one panel per unit, one line per column."""
    width, height, left, top = 720, 150, 70, 24
    colours = ["#1b6ca8", "#c0392b", "#2e8b57", "#8e44ad"]
    panels = [("resident memory, MiB", [k for k in rows[0] if k.endswith(" MiB") and k != "store MiB"]),
              ("open descriptors", [k for k in rows[0] if k.endswith("descriptors")]),
              ("store, MiB", ["store MiB"]), ("jobs done", ["jobs done"])]
    last = max(row["seconds"] for row in rows)
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width + left + 40}" '
           f'height="{len(panels) * (height + 50) + 30}" font-family="sans-serif" font-size="12">',
           '<rect width="100%" height="100%" fill="white"/>']
    for index, (title, columns) in enumerate(panels):
        base = top + index * (height + 50)
        most = 1.1 * max(row[column] for row in rows for column in columns) or 1
        out.append(f'<text x="{left}" y="{base - 8}" font-weight="bold">{title}</text>')
        out.append(f'<rect x="{left}" y="{base}" width="{width}" height="{height}" fill="none" stroke="#999"/>')
        for part in (0, 0.5, 1):
            y = base + height * (1 - part)
            out.append(f'<text x="{left - 6}" y="{y + 4:.0f}" text-anchor="end">{most * part:,.0f}</text>')
            out.append(f'<text x="{left + width * part}" y="{base + height + 15}" text-anchor="middle">'
                       f'{last * part / 60:.1f} min</text>')
        for colour, column in zip(colours, columns):
            points = " ".join(f"{left + width * row['seconds'] / last:.1f},{base + height * (1 - row[column] / most):.1f}"
                              for row in rows)
            out.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.5"/>')
            if len(columns) > 1:
                x = left + 250 + 150 * columns.index(column)
                out.append(f'<text x="{x}" y="{base - 8}" fill="{colour}">{column.rsplit(" ", 1)[0]}</text>')
    Path(path).write_text("\n".join([*out, "</svg>"]) + "\n", encoding="utf-8")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", required=True, help="seconds, or a number with s, m or h")
    for name in ("server", "store", "scenes", "csv", "svg"):
        parser.add_argument(f"--{name}", required=True)
    parser.add_argument("processes", nargs="+", metavar="NAME=PID")
    options = parser.parse_args()
    soak = Soak(options)
    rows = soak.run(seconds_of(options.duration))
    plot(rows, options.svg)
    tenth = max(len(rows) // 10, 1)
    early, late = rows[tenth:2 * tenth], rows[-tenth:]
    print(f"{soak.done} jobs done of {soak.submitted} in {rows[-1]['seconds']} s")
    for column in rows[0]:
        if column.endswith(("MiB", "descriptors")):
            before, after = (statistics.median(row[column] for row in part) for part in (early, late))
            print(f"{column}: {before:g} in the second tenth, {after:g} in the last")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
