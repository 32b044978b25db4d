#!/usr/bin/env python3
"""Renders scenes to a target error with many seeds. Checks that the true error is at most the target,
and compares the samples with the fixed sample count that just reaches it.

    composed.py SCENE.glb… [--seeds N (40)] [--error E (0.05)] [--size PX (96)] [--tile PX (16)]
                [--max-spp N (16384)] [--background R,G,B] [--bin DIR] [--jobs N]
                [--results FILE.jsonl] [--out FILE.md]

Fails if fewer than nine of ten seeds are within E, or if the samples exceed twice the fixed count. A
scene that ends CAPPED or UNCERTAIN makes no claim and is listed as such.
"""

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from run import parser_of, run_scene

SMALLEST_SHARE, MOST_SAMPLES = 0.9, 2.0


def verdict(row):
    faults = []
    if row["true_within_error"] < SMALLEST_SHARE * row["seeds"]:
        faults.append("true error above E")
    if row["fixed_samples"] and row["samples_mean"] > MOST_SAMPLES * row["fixed_samples"]:
        faults.append("more than twice the fixed samples")
    if faults and row["uncertain"] + row["capped"] > row["seeds"] / 2:
        return "no claim: " + ", ".join(faults)
    return ", ".join(faults) or "holds"


def table(rows):
    text = ("| scene | true error ≤ E | CONVERGED | UNCERTAIN | CAPPED | spp | fixed spp for E | "
            "ratio | verdict |\n|---|---|---|---|---|---|---|---|---|\n")
    for row in rows:
        fixed, ratio = "-", "-"
        if row["fixed_samples"]:
            fixed = f"{row['fixed_samples']:.0f}"
            ratio = f"{row['samples_mean'] / row['fixed_samples']:.2f}"
        text += (f"| {row['scene']} | {row['true_within_error']} of {row['seeds']} | "
                 f"{row['claims']} | {row['uncertain']} | {row['capped']} | "
                 f"{row['samples_mean']:.0f} | {fixed} | {ratio} | {verdict(row)} |\n")
    return text


def main():
    parser = parser_of(__doc__, seeds=40)
    parser.add_argument("scenes", nargs="+", type=Path)
    parser.add_argument("--error", type=float, default=0.05)
    parser.add_argument("--size", type=int, default=96)
    parser.add_argument("--tile", type=int, default=16)
    parser.add_argument("--max-spp", type=int, default=16384)
    parser.add_argument("--background")
    parser.add_argument("--reference-spp", type=int, default=8192)
    options = parser.parse_args()
    settings = ["--width", str(options.size), "--height", str(options.size), "--tile",
                str(options.tile), "--max-spp", str(options.max_spp), "--reference-spp",
                str(options.reference_spp)]
    if options.background:
        settings += ["--background", options.background]

    def run(file):
        scene = {"scene": file.stem, "error": options.error, "options": settings}
        row = run_scene(options, file, scene, 1)
        print(f"{file.stem}: {verdict(row)} ({row['cpu_seconds']:.0f} s of CPU)", file=sys.stderr,
              flush=True)
        return row

    with ThreadPoolExecutor(options.jobs) as pool:
        rows = list(pool.map(run, options.scenes))
    print(table(rows), end="")
    if options.out:
        options.out.write_text(table(rows))
    return 0 if all(verdict(row) == "holds" for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
