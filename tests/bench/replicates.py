#!/usr/bin/env python3
"""Measures the effect of the number of replicates R on errors and estimates (docs/notes/replicates.md).

    tests/bench/replicates.py [--counts 1,2,4,8] [--build DIR] [--results FILE.jsonl] [SCENE…]

R is a constant of the render contract, so each value needs a program of its own: the sources are copied
to DIR/tree, and tessera-bench-coverage is built there for each R. Each program renders scenes of the
battery with fixed sample counts and to target errors, with the same seeds. R = 1 has no estimate; it
shows how fast the error falls if the samples of a pixel are one sequence.
"""

import argparse
import json
import math
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SCENES = {"furnace": 0.06, "small_lamp": 0.08, "checker": 0.1}  # and target errors
FIXED = ((32, 64), (256, 16))  # samples, seeds
ERROR_SEEDS = 32
REFERENCE_SPP = "2048"


def build(folder, replicates):
    """Returns tessera-bench-coverage for one R; builds it if an earlier run has not."""
    binary = folder / f"coverage-r{replicates}"
    if binary.exists():
        return binary
    tree = folder / "tree"
    if not tree.exists():
        shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns("build", ".git", "gallery"))
    version = tree / "contract/version.h"
    changed = re.sub(r"kReplicates = \d+;", f"kReplicates = {replicates};", version.read_text())
    version.write_text(changed)
    for command in (["cmake", "--preset", "bench"],
                    ["cmake", "--build", "--preset", "bench", "-j2", "--target",
                     "tessera-bench-coverage"]):
        subprocess.run(command, cwd=tree, check=True, stdout=sys.stderr)
    shutil.copy(tree / "build/bench/bin/tessera-bench-coverage", binary)
    return binary


class Runs:
    """Documents of the tool, stored in a file as they arrive."""

    def __init__(self, binaries, scenes, results):
        self.binaries, self.scenes, self.results = binaries, scenes, results
        self.rows = {}
        if results and results.exists():
            rows = [json.loads(line) for line in results.read_text().splitlines()]
            self.rows = {row["key"]: row for row in rows}

    def get(self, replicates, scene, *options):
        command = [f"{scene}.gltf", "--reference-spp", REFERENCE_SPP, *map(str, options)]
        key = f"{replicates} {' '.join(command)}"
        if key not in self.rows:
            done = subprocess.run([self.binaries[replicates], *command], cwd=self.scenes,
                                  stdout=subprocess.PIPE, text=True, check=True)
            self.rows[key] = {"key": key, **json.loads(done.stdout)}
            if self.results:
                with self.results.open("a") as file:
                    file.write(json.dumps(self.rows[key]) + "\n")
        return self.rows[key]


def geometric_mean(values):
    return math.exp(sum(map(math.log, values)) / len(values))


def table(runs, counts, scenes):
    """Returns a row for each R; squared errors and samples are relative to the first R that has them."""
    text = "| R |" + "".join(
        f" squared error at {spp} spp | estimate / true at {spp} spp | bound held |"
        for spp, _ in FIXED) + " samples by error | bound / true | held |\n"
    text += "|---|" + "---|" * (3 * len(FIXED) + 3) + "\n"
    for replicates in counts:
        cells = [str(replicates)]
        for spp, seeds in FIXED:
            rows = [runs.get(replicates, s, "--fixed", spp, "--seeds", seeds) for s in scenes]
            base = [runs.get(counts[0], s, "--fixed", spp, "--seeds", seeds) for s in scenes]
            ratios = [row["true_square"] / other["true_square"] for row, other in zip(rows, base)]
            cells.append(f"{geometric_mean(ratios):.2f} ({min(ratios):.2f}–{max(ratios):.2f})")
            if replicates == 1:
                cells += ["-", "-"]
                continue
            mean = sum(row["estimate_over_true"] for row in rows) / len(rows)
            deviation = math.sqrt(sum(row["estimate_over_true_deviation"] ** 2
                                      for row in rows) / len(rows))
            cells.append(f"{mean:.3f} ± {deviation:.3f}")
            cells.append(f"{sum(row['covered'] for row in rows)} of "
                         f"{sum(row['claims'] for row in rows)}")
        cells += by_error(runs, counts, scenes, replicates)
        text += "| " + " | ".join(cells) + " |\n"
    return text


def by_error(runs, counts, scenes, replicates):
    if replicates == 1:
        return ["-", "-", "-"]

    def rows_of(r):
        return [runs.get(r, s, "--error", SCENES[s], "--seeds", ERROR_SEEDS) for s in scenes]

    rows, base = rows_of(replicates), rows_of(next(r for r in counts if r > 1))
    ratios = [row["samples_mean"] / other["samples_mean"] for row, other in zip(rows, base)]
    bounds = [row["median_upper_over_true"] for row in rows]
    return [f"{geometric_mean(ratios):.2f} ({min(ratios):.2f}–{max(ratios):.2f})",
            f"{geometric_mean(bounds):.2f}",
            f"{sum(row['covered'] for row in rows)} of {sum(row['claims'] for row in rows)}"]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=[])
    parser.add_argument("--counts", default="1,2,4,8")
    parser.add_argument("--build", type=Path)
    parser.add_argument("--results", type=Path)
    options = parser.parse_args()
    counts = [int(count) for count in options.counts.split(",")]
    with tempfile.TemporaryDirectory() as name:
        folder = (options.build or Path(name)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        binaries = {count: build(folder, count) for count in counts}
        scenes = Path(name) / "scenes"
        subprocess.run([sys.executable, ROOT / "tests/bench/coverage/make_scenes.py", scenes],
                       check=True)
        runs = Runs(binaries, scenes, options.results)
        print(table(runs, counts, options.scenes or list(SCENES)), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
