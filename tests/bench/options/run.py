#!/usr/bin/env python3
"""Measures what each option that trades accuracy for speed costs, saves and brings in error.

    run.py [SCENE…] [--bin DIR] [--size WxH (48x48)] [--spp N (64)] [--many N (1024)] [--seeds N (4)]
           [--reference-spp N (8192)] [--out FILE.md] [--json FILE]

The scenes are the well-behaved ones of tests/bench/coverage. The reference of a scene has a depth of
255, another seed, and the pixel filter of the option. For each option the table shows geometric means
over the scenes, as ratios to the default options: CPU time of all processes with --many samples,
relMSE at --spp, and the product of the two, which is the time to equal error if only noise counted. It
also shows the median error with --many samples per pixel, at which a systematic error remains where
the noise is gone, and the scene in which that error grows most.
"""

import argparse
import json
import math
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
OPTIONS = {
    "default": [],
    "--max-depth 1": ["--max-depth", "1"],
    "--max-depth 2": ["--max-depth", "2"],
    "--max-depth 4": ["--max-depth", "4"],
    "--max-depth 8": ["--max-depth", "8"],
    "--max-depth 64": ["--max-depth", "64"],
    "--clamp 1": ["--clamp", "1"],
    "--clamp 10": ["--clamp", "10"],
    "--half": ["--half"],
    "--filter gaussian": ["--filter", "gaussian"],
    "--denoise": ["--denoise"],
    "--guiding": ["--guiding"],
    "--accelerator bvh2": ["--accelerator", "bvh2"],
}
REFERENCE_SEED = 1000


def options_of():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--bin", type=Path, default=ROOT / "build/dev/bin")
    parser.add_argument("--size", default="48x48")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--many", type=int, default=1024)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--reference-spp", type=int, default=8192)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def time_of_children():
    """CPU seconds of all processes that have ended: client, server and workers."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


class Bench:
    def __init__(self, options, folder):
        self.options, self.folder = options, folder

    def render(self, scene, spp, seed, extra, image="image.exr"):
        """The report of one image."""
        command = [self.options.bin / "tessera", "render", self.folder / f"{scene}.gltf", "-o",
                   self.folder / image, "--size", self.options.size, "--spp", spp, "--seed", seed,
                   "--threads", 1, "--json", "--force", *extra]
        done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            sys.exit(f"{' '.join(map(str, command))}: exit code {done.returncode}\n{done.stderr}")
        return json.loads(done.stdout)

    def measure(self, scene):
        """{option: (CPU seconds per million samples, relMSE, error with many samples)}."""
        reference = f"reference-{scene}.exr"
        references = {}
        for filter_name, extra in (("box", []), ("gaussian", ["--filter", "gaussian"])):
            references[filter_name] = self.folder / f"{filter_name}-{reference}"
            self.render(scene, self.options.reference_spp, REFERENCE_SEED, ["--max-depth", 255, *extra],
                        references[filter_name].name)
        width, height = (int(side) for side in self.options.size.split("x"))
        figures = {}
        for name, extra in OPTIONS.items():
            compared = ["--reference", references["gaussian" if "gaussian" in extra else "box"]]
            few = [self.render(scene, self.options.spp, seed, extra + compared)
                   for seed in range(self.options.seeds)]
            start = time_of_children()
            many = self.render(scene, self.options.many, self.options.seeds, extra + compared)
            samples = width * height * self.options.many / 1e6
            figures[name] = ((time_of_children() - start) / samples,
                             statistics.fmean(report["frames"][0]["true"]["relmse"] for report in few),
                             many["frames"][0]["true"]["error"])
        return figures


def geometric_mean(values):
    return math.exp(statistics.fmean(map(math.log, values)))


def table(measured):
    text = ("| option | CPU time per sample | relMSE | CPU time × relMSE | median error, many samples | "
            "worst scene |\n|---|---|---|---|---|---|\n")
    for option in OPTIONS:
        rows = {scene: figures[option] for scene, figures in measured.items()}
        plain = {scene: figures["default"] for scene, figures in measured.items()}
        cost, noise = (geometric_mean([rows[scene][k] / plain[scene][k] for scene in rows]) for k in (0, 1))
        worst = max(rows, key=lambda scene: rows[scene][2] / plain[scene][2])
        text += (f"| `{option}` | {cost:.2f} | {noise:.3g} | {cost * noise:.3g} | "
                 f"{statistics.median(row[2] for row in rows.values()):.3g} | "
                 f"{worst}: {rows[worst][2]:.3g}, default {plain[worst][2]:.3g} |\n")
    return text


def main():
    options = options_of()
    measured = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        subprocess.run([sys.executable, ROOT / "tests/bench/coverage/make_scenes.py", folder], check=True,
                       stdout=subprocess.DEVNULL)
        bench = Bench(options, folder)
        for scene in json.loads((folder / "battery.json").read_text()):
            if scene["scene"] in options.scenes or (not options.scenes and scene["well_behaved"]):
                measured[scene["scene"]] = bench.measure(scene["scene"])
                print(f"{scene['scene']}: measured", file=sys.stderr)
    if not measured:
        sys.exit("no scene has this name")
    text = table(measured)
    print(text, end="")
    if options.out:
        options.out.write_text(text)
    if options.json:
        options.json.write_text(json.dumps(measured, indent=1))


if __name__ == "__main__":
    main()
