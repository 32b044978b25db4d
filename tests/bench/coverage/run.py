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


def allowed_misses(seeds):
    """Returns the maximum number of seeds with a wrong claim: nominal 95 %, 1 % false alarms (31 of 400).
    A seed without a claim cannot be wrong; the table counts the claims."""
    tail, misses = 0.0, seeds
    while misses > 0:
        term = math.exp(math.lgamma(seeds + 1) - math.lgamma(misses + 1) -
                        math.lgamma(seeds - misses + 1) + misses * math.log(0.05) +
                        (seeds - misses) * math.log(0.95))
        if tail + term > 0.01:
            break
        tail += term
        misses -= 1
    return misses


def run_scene(options, file, scene, first_seed):
    """Returns the document of the tool, from --results if it contains this run."""
    command = [str(options.bin / "tessera-bench-coverage"), str(file), "--error", str(scene["error"]),
               "--seeds", str(options.seeds), "--first-seed", str(first_seed), *options.extra,
               *scene["options"]]
    key = " ".join([scene["scene"], *command[2:]])
    if options.results and options.results.exists():
        for line in options.results.read_text().splitlines():
            if (row := json.loads(line))["key"] == key:
                return row
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    row = {"key": key, **json.loads(done.stdout)}
    if options.results:
        with options.results.open("a") as file:
            file.write(json.dumps(row) + "\n")
    return row


def failures(options, scene, rows):
    """Returns the faults of the runs of a scene, taken together; empty if it passes. The bound of a denoised
    frame is wide in small frames, so that only the claims made are judged."""
    faults = []
    claims, covered, seeds, no_claim = (
        sum(row[key] for row in rows) for key in ("claims", "covered", "seeds", "no_claim"))
    if claims - covered > allowed_misses(seeds):
        faults.append(f"{claims - covered} of {claims} claims do not hold")
    if scene["well_behaved"] and not options.denoise:
        if no_claim > max(1, seeds // 100):
            faults.append(f"no claim for {no_claim} of {seeds} seeds")
        ratio = max(row["median_upper_over_true"] for row in rows)
        if ratio > MEDIAN_LIMIT:
            faults.append(f"median bound over true error {ratio:.2f}")
    return faults


def judge(options, folder, scene):
    """Runs a scene, and again with new seeds if it fails; both runs count."""
    rows = []
    for first_seed in (1, 1 + options.seeds):
        row = run_scene(options, folder / f"{scene['scene']}.gltf", scene, first_seed)
        row["no_claim"] = row["uncertain"] + row["capped"]
        rows.append(row)
        faults = failures(options, scene, rows)
        print(f"{scene['scene']}: {'; '.join(faults) or 'holds'} ({row['cpu_seconds']:.0f} s of CPU)",
              file=sys.stderr, flush=True)
        if not faults:
            break
    return rows, faults


def table(rows):
    text = ("| scene | E | seeds | claims | held | UNCERTAIN | CAPPED | true ≤ E | bound / true | "
            "spp | fixed spp for E |\n|---|---|---|---|---|---|---|---|---|---|---|\n")
    for row in rows:
        fixed = "-" if row["fixed_samples"] is None else f"{row['fixed_samples']:.0f}"
        text += (f"| {row['scene']} | {row['error']} | {row['seeds']} | {row['claims']} | "
                 f"{row['covered']} | {row['uncertain']} | {row['capped']} | "
                 f"{row['true_within_error']} | {row['median_upper_over_true']:.2f} | "
                 f"{row['samples_mean']:.0f} | {fixed} |\n")
    return text


def bias_table(rows):
    text = ("| scene | E | error of the reference | bias of the mean ± s.e. | part of the squared "
            "error that is systematic |\n|---|---|---|---|---|\n")
    for row in rows:
        text += (f"| {row['scene']} | {row['error']} | {row['reference_error']:.4f} | "
                 f"{100 * row['bias']:+.3f} ± {100 * row['bias_standard_error']:.3f} % | "
                 f"{100 * row['bias_share']:+.2f} % |\n")
    return text


def parser_of(description, seeds):
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--seeds", type=int, default=seeds)
    parser.add_argument("--bin", type=Path, default=ROOT / "build/dev/bin")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--results", type=Path)
    parser.add_argument("--out", type=Path)
    parser.set_defaults(extra=[])  # further options of the tool
    return parser


def main():
    parser = parser_of(__doc__, seeds=400)
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--denoise", action="store_true")
    parser.add_argument("--no-guiding", action="store_true")
    parser.add_argument("--size", default="64x64")
    parser.add_argument("--error-scale", type=float, default=1)
    options = parser.parse_args()
    width, height = options.size.split("x")
    options.extra = [] if options.size == "64x64" else ["--width", width, "--height", height]
    options.extra += ["--denoise"] if options.denoise else []
    options.extra += ["--no-guiding"] if options.no_guiding else []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        subprocess.run([sys.executable, str(Path(__file__).with_name("make_scenes.py")), name],
                       check=True)
        battery = [scene for scene in json.loads((folder / "battery.json").read_text())
                   if not options.scenes or scene["scene"] in options.scenes]
        for scene in battery:
            scene["error"] = round(scene["error"] * options.error_scale, 6)
        with ThreadPoolExecutor(options.jobs) as pool:
            results = list(pool.map(lambda scene: judge(options, folder, scene), battery))
    rows = [row for some, _ in results for row in some]
    text = table(rows) + "\n" + bias_table(rows)
    print(text, end="")
    if options.out:
        options.out.write_text(text)
    return 1 if any(faults for _, faults in results) else 0


if __name__ == "__main__":
    sys.exit(main())
