#!/usr/bin/env python3
"""Submits small scenes one after another with `tessera submit` and waits until all are rendered.

    submits.py --bin DIR --server ADDRESS --token FILE --scene scene.gltf --count 300 --scratch DIR

Each scene has a digest of its own, so that it is uploaded. Prints median and 99th percentile of the
command's duration, its CPU time with its children, and the time until the last job is done.
"""

import argparse
import json
import resource
import statistics
import subprocess
import time
from pathlib import Path


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("bin", "server", "token", "scene", "scratch"):
        parser.add_argument(f"--{name}", required=True)
    parser.add_argument("--count", type=int, default=300)
    options = parser.parse_args()
    tessera = str(Path(options.bin) / "tessera")
    connection = ["--server", options.server, "--token", options.token]
    text = Path(options.scene).read_text()
    scenes = []
    for i in range(options.count):
        scene = Path(options.scratch) / f"scene{i}.gltf"
        scene.write_text(text + " " * (i + 1))
        scenes.append(str(scene))

    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.monotonic()
    seconds, jobs = [], []
    for scene in scenes:
        begun = time.monotonic()
        made = subprocess.run([tessera, "submit", scene, "--size", "16x16", "--spp", "4", *connection],
                              check=True, capture_output=True, text=True)
        seconds.append(time.monotonic() - begun)
        jobs.append(made.stdout.strip())
    submitted = time.monotonic()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    left = set(jobs)
    while left:
        listed = subprocess.run([tessera, "list", "--limit", "0", "--json", *connection], check=True,
                                capture_output=True, text=True)
        active = {job["id"] for job in json.loads(listed.stdout)["jobs"]
                  if job["state"] in ("queued", "running")}
        left &= active
        if time.monotonic() - submitted > 120:
            raise SystemExit(f"{len(left)} jobs are not done")
    done = time.monotonic()
    for job in (jobs[0], jobs[-1]):
        status = subprocess.run([tessera, "status", job, "--json", *connection], check=True,
                                capture_output=True, text=True)
        assert json.loads(status.stdout)["state"] == "done", status.stdout
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    seconds.sort()
    print(f"{options.count} submits: median {1e3 * statistics.median(seconds):.1f} ms, "
          f"p99 {1e3 * seconds[int(0.99 * len(seconds))]:.1f} ms, "
          f"{1e3 * cpu / options.count:.1f} ms CPU each; "
          f"all submitted after {submitted - start:.2f} s, done after {done - start:.2f} s")


if __name__ == "__main__":
    main()
