#!/usr/bin/env python3
"""Measures denoising on the battery of tests/bench/coverage: relMSE denoised over raw, and whether
the bound of the denoised error holds.

    run.py [SCENE…] [--seeds N (4)] [--spp LIST (16,64,256)] [--size WxH (64x64)]
           [--reference-spp N (4096)] [--bin DIR] [--jobs N (cores)] [--out FILE.md]
           [--bars 16=0.2,64=0.3,256=0.5] [--worst 1.0] [--held 0.9]

Fails if the geometric mean of the ratio exceeds the bar of a sample count, the ratio of a scene
exceeds --worst, or fewer than --held of all claims hold. A claim is made if at least 30 pixels carry
the error, of the raw and of the denoised image.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]


def options_of():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--spp", default="16,64,256")
    parser.add_argument("--size", default="64x64")
    parser.add_argument("--reference-spp", type=int, default=4096)
    parser.add_argument("--bin", type=Path, default=ROOT / "build/dev/bin")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--out", type=Path)
    parser.add_argument("--bars", default="16=0.2,64=0.3,256=0.5")
    parser.add_argument("--worst", type=float, default=1.0)
    parser.add_argument("--held", type=float, default=0.9)
    return parser.parse_args()


def measure(options, folder, scene):
    width, height = options.size.split("x")
    extra = scene["options"]
    depth = ["--max-depth", extra[extra.index("--max-depth") + 1]] if "--max-depth" in extra else []
    text = subprocess.run(
        [options.bin / "tessera-bench-denoise", folder / f"{scene['scene']}.gltf", "--spp", options.spp,
         "--seeds", str(options.seeds), "--width", width, "--height", height,
         "--reference-spp", str(options.reference_spp), *depth],
        check=True, capture_output=True, text=True).stdout
    return [json.loads(line) for line in text.splitlines()]


def table(rows):
    text = ("| scene | spp | relMSE raw | denoised | ratio | error | estimated | claims that hold | left raw "
            "| s/MP |\n|---|---|---|---|---|---|---|---|---|---|\n")
    for row in rows:
        text += (f"| {row['scene']} | {row['spp']} | {row['relmse_raw']:.3g} | "
                 f"{row['relmse_denoised']:.3g} | {row['ratio']:.3f} | {row['error_denoised']:.3g} | "
                 f"{row['error_estimated']:.3g} | {row['held']} of {row['claims']} | "
                 f"{row['raw_share']:.2f} | {row['seconds_per_megapixel']:.1f} |\n")
    return text


def faults_of(options, rows):
    faults, summary = [], ""
    for bar in options.bars.split(","):
        spp, limit = bar.split("=")
        ratios = [row["ratio"] for row in rows if row["spp"] == int(spp)]
        if not ratios:
            continue
        mean = math.exp(sum(map(math.log, ratios)) / len(ratios))
        summary += f"{spp} spp: geometric mean {mean:.3f} over {len(ratios)} scenes, bar {limit}\n"
        if mean > float(limit):
            faults.append(f"{spp} spp: {mean:.3f} is above {limit}")
    faults += [f"{row['scene']}, {row['spp']} spp: ratio {row['ratio']:.3f}" for row in rows
               if row["ratio"] > options.worst]
    claims, held = sum(row["claims"] for row in rows), sum(row["held"] for row in rows)
    summary += f"{held} of {claims} claims hold\n"
    if claims and held < options.held * claims:
        faults.append(f"only {held} of {claims} claims hold")
    return faults, summary


def main():
    options = options_of()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        subprocess.run([sys.executable, HERE.parent / "coverage/make_scenes.py", folder], check=True)
        battery = json.loads((folder / "battery.json").read_text())
        chosen = [s for s in battery if not options.scenes or s["scene"] in options.scenes]
        with ThreadPoolExecutor(options.jobs) as pool:
            rows = sum(pool.map(lambda s: measure(options, folder, s), chosen), [])
    for row in rows:
        row["ratio"] = max(row["relmse_denoised"] / row["relmse_raw"], 1e-6)
    rows.sort(key=lambda row: row["spp"])
    faults, summary = faults_of(options, rows)
    text = table(rows) + "\n" + summary
    print(text, end="")
    if options.out:
        options.out.write_text(text)
    for fault in faults:
        print(f"denoise: {fault}", file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
