#!/usr/bin/env python3
"""Measures path guiding; tests/bench/guiding.sh describes options and figures."""

import argparse
import json
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
TARGET = 0.01
# Samples per pixel without and with guiding, and of the reference. Scenes with rare events need more.
RARE = (1024, 256, 16384)
SAMPLES = {"caustic": RARE, "caged_lamp": RARE, "small_sun_ball": RARE, "door_gap": RARE,
           "window": (256, 256, 8192), "window_sky": (256, 256, 8192), "glint": (256, 256, 8192)}
USUAL = (64, 64, 4096)
SCENES = ("furnace", "cornell", "penumbra", "small_lamp", "many_lamps", "checker", "foliage", "points",
          "glossy", "glint", "window", "caustic", "caged_lamp", "small_sun_ball", "door_gap", "window_sky")
ENVIRONMENTS = {"window_sky": "sky.hdr"}


def options_of():
    parser = argparse.ArgumentParser()
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--bin", type=Path, default=ROOT / "build/dev/bin")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--results", type=Path)
    parser.add_argument("--scale", type=float, default=1)
    parser.add_argument("--references", type=Path)
    return parser.parse_args()


def measure(options, folder, scene):
    plain, guided, reference = (max(4, round(options.scale * count)) for count in SAMPLES.get(scene, USUAL))
    command = [options.bin / "tessera-bench-guiding", folder / f"{scene}.gltf", "--spp", plain,
               "--guided-spp", guided, "--reference-spp", max(64, reference), "--seeds", options.seeds]
    if scene in ENVIRONMENTS:
        command += ["--environment", ENVIRONMENTS[scene]]
    if options.references:
        command += ["--reference", options.references / f"{scene}-{max(64, reference)}.reference"]
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}: exit code {done.returncode}\n{done.stderr}")
    print(f"{scene}: measured", file=sys.stderr)
    return json.loads(done.stdout)


def seconds_to_target(run):
    return run["build_seconds"] + run["render_seconds"] * run["relmse"] / TARGET


def table(rows):
    text = ("| scene | relMSE without (spp) | relMSE with (spp) | CPU time per sample, ratio | efficiency, ratio | "
            f"seconds to relMSE {TARGET} without | with | ratio |\n|---|---|---|---|---|---|---|---|\n")
    for row in rows:
        plain, guided = row["plain"], row["guided"]
        cost = guided["render_seconds"] / guided["spp"] / (plain["render_seconds"] / plain["spp"])
        gain = (plain["relmse"] * plain["render_seconds"]) / (guided["relmse"] * guided["render_seconds"])
        spread = sum((run["relmse_error"] / run["relmse"]) ** 2 for run in (plain, guided)) ** 0.5
        times = [seconds_to_target(run) for run in (plain, guided)]
        text += (f"| {row['scene']} | {plain['relmse']:.3g} ({plain['spp']}) | "
                 f"{guided['relmse']:.3g} ({guided['spp']}) | {cost:.2f} | "
                 f"{gain:.3g} ± {100 * spread:.0f} % | {times[0]:.3g} | {times[1]:.3g} | "
                 f"{times[0] / times[1]:.3g} |\n")
    return text


def main():
    options = options_of()
    unknown = set(options.scenes) - set(SCENES)
    if unknown:
        sys.exit(f"no scene has the name {', '.join(sorted(unknown))}")
    if options.references:
        options.references.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        subprocess.run([sys.executable, ROOT / "tests/bench/guiding/scenes.py", folder], check=True)
        with ThreadPoolExecutor(options.jobs) as pool:
            rows = list(pool.map(lambda scene: measure(options, folder, scene), options.scenes or SCENES))
    text = table(rows)
    print(text, end="")
    if options.results:
        options.results.write_text("".join(json.dumps(row) + "\n" for row in rows))
    if options.out:
        options.out.write_text(text)


if __name__ == "__main__":
    main()
