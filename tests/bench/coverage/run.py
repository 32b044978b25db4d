#!/usr/bin/env python3
"""Runs the battery of make_scenes.py through tessera-bench-coverage; see ../coverage.sh."""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
MEDIAN_LIMIT = 1.5


def allowed_misses(claims):
    """Most claims that may fail: 95 % nominal, one false alarm in a hundred (of 400: 31)."""
    tail, misses = 0.0, claims
    while misses > 0:
        term = math.exp(math.lgamma(claims + 1) - math.lgamma(misses + 1) -
                        math.lgamma(claims - misses + 1) + misses * math.log(0.05) +
                        (claims - misses) * math.log(0.95))
        if tail + term > 0.01:
            break
        tail += term
        misses -= 1
    return misses


def run_scene(options, folder, scene, first_seed):
    command = [str(options.bin / "tessera-bench-coverage"), str(folder / f"{scene['scene']}.gltf"),
               "--error", str(scene["error"]), "--seeds", str(options.seeds), "--first-seed",
               str(first_seed), *scene["options"]]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout)


def failures(scene, row, seeds):
    """What does not hold of a run, as text; empty if all does."""
    faults = []
    if row["claims"] - row["covered"] > allowed_misses(row["claims"]):
        faults.append(f"{row['claims'] - row['covered']} of {row['claims']} claims do not hold")
    if scene["well_behaved"]:
        if row["uncertain"] + row["capped"] > max(1, seeds // 100):
            faults.append(f"no claim for {row['uncertain'] + row['capped']} seeds")
        if row["median_upper_over_true"] > MEDIAN_LIMIT:
            faults.append(f"median bound over true error {row['median_upper_over_true']:.2f}")
    return faults


def table(rows):
    text = ("| scene | E | seeds | claims | held | UNCERTAIN | CAPPED | true ≤ E | bound / true | "
            "spp | fixed spp for E | bias ± s.e. |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n")
    for row in rows:
        fixed = "-" if row["fixed_samples"] is None else f"{row['fixed_samples']:.0f}"
        text += (f"| {row['scene']} | {row['error']} | {row['seeds']} | {row['claims']} | "
                 f"{row['covered']} | {row['uncertain']} | {row['capped']} | "
                 f"{row['true_within_error']} | {row['median_upper_over_true']:.2f} | "
                 f"{row['samples_mean']:.0f} | {fixed} | {100 * row['bias']:+.2f} ± "
                 f"{100 * row['bias_standard_error']:.2f} % |\n")
    return text


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--seeds", type=int, default=400)
    parser.add_argument("--bin", type=Path, default=ROOT / "build/dev/bin")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        subprocess.run([sys.executable, str(Path(__file__).with_name("make_scenes.py")), name],
                       check=True)
        battery = [scene for scene in json.loads((folder / "battery.json").read_text())
                   if not options.scenes or scene["scene"] in options.scenes]

        def judge(scene):
            rows = [run_scene(options, folder, scene, 1)]
            faults = failures(scene, rows[0], options.seeds)
            if faults:
                rows.append(run_scene(options, folder, scene, 1 + options.seeds))
                faults = faults and failures(scene, rows[1], options.seeds)
            print(f"{scene['scene']}: {'; '.join(faults) or 'holds'}", file=sys.stderr, flush=True)
            return rows, faults

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            results = list(pool.map(judge, battery))
    rows = [row for some, _ in results for row in some]
    print(table(rows), end="")
    if options.out:
        options.out.write_text(table(rows))
    return 1 if any(faults for _, faults in results) else 0


if __name__ == "__main__":
    sys.exit(main())
