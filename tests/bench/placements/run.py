#!/usr/bin/env python3
"""Renders scenes at other scales and far from the origin, and compares each image with that of the
scene as it is.

    run.py [SCENE…] [--bin DIR] [--size WxH (64x64)] [--spp N (64)] [--limit R (0.05)]
           [--placement SCALE,X,Y,Z]… [--out FILE.md]

SCENE is the name of a scene of tests/bench/coverage (default: all of them). A placement puts the scene
under a node with this scale and translation in metres. Clip planes and distances of absorption are
scaled as well, and the intensity of point lights with the square of the scale, so that the images
would be equal if all numbers were exact.

Rounded coordinates move a few paths to another surface or lamp. With the same seed all other paths
carry the same radiance up to rounding. A share p of changed paths leaves an error between the images
of sqrt(2 p) times the error of the noise, so the limit of 0.05 allows 1 path in 800. Exits with 1
above it.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PLACEMENTS = ["1e-6,0,0,0", "1e-3,0,0,0", "1e6,0,0,0", "1,1e5,0,0", "1,1e6,-3e6,1e6", "1,1e7,1e7,1e7",
              "1e-6,1,1,1", "1e6,1e13,0,0"]


def options_of():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--bin", type=Path, default=ROOT / "build/dev/bin")
    parser.add_argument("--size", default="64x64")
    parser.add_argument("--spp", default="64")
    parser.add_argument("--limit", type=float, default=0.05)
    parser.add_argument("--placement", action="append", help="default: %s" % " ".join(PLACEMENTS))
    parser.add_argument("--out", type=Path)
    return parser.parse_args()


def scale_numbers(doc, scale):
    """Scales the lengths and intensities to which transforms of nodes do not apply."""
    for camera in doc.get("cameras", []):
        lens = camera[camera["type"]]
        for key in ("znear", "zfar", "xmag", "ymag"):
            if key in lens:
                lens[key] *= scale
    for material in doc.get("materials", []):
        volume = material.get("extensions", {}).get("KHR_materials_volume", {})
        if "attenuationDistance" in volume:
            volume["attenuationDistance"] *= scale
    for light in doc.get("extensions", {}).get("KHR_lights_punctual", {}).get("lights", []):
        if light["type"] != "directional":
            light["intensity"] = light.get("intensity", 1) * scale * scale
        if "range" in light:
            light["range"] *= scale


def place(source, target, placement):
    doc = json.loads(source.read_text())
    scale, *offset = (float(number) for number in placement.split(","))
    scale_numbers(doc, scale)
    scene = doc["scenes"][doc.get("scene", 0)]
    doc["nodes"].append({"children": scene["nodes"], "scale": [scale] * 3, "translation": offset})
    scene["nodes"] = [len(doc["nodes"]) - 1]
    target.write_text(json.dumps(doc))


def run_json(*command):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}: exit code {done.returncode}\n{done.stderr}")
    return json.loads(done.stdout)


def render(options, scene, image, extra):
    return run_json(options.bin / "tessera", "render", scene, "-o", image, "--size", options.size,
                    "--spp", options.spp, "--json", *extra)


def main():
    options = options_of()
    rows, above = [], []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        subprocess.run([sys.executable, ROOT / "tests/bench/coverage/make_scenes.py", folder], check=True,
                       stdout=subprocess.DEVNULL)
        battery = json.loads((folder / "battery.json").read_text())
        placements = options.placement or PLACEMENTS
        for scene in battery:
            if options.scenes and scene["scene"] not in options.scenes:
                continue
            extra = scene["options"]
            depth = extra[extra.index("--max-depth"):][:2] if "--max-depth" in extra else []
            file, plain = folder / f"{scene['scene']}.gltf", folder / "plain.exr"
            noise = render(options, file, plain, [*depth, "--force"])["frames"][0]["estimated"]
            shares = []
            for index, placement in enumerate(placements):
                placed, image = folder / f"placed{index}.gltf", folder / f"placed{index}.exr"
                place(file, placed, placement)
                render(options, placed, image, [*depth, "--force"])
                difference = run_json(options.bin / "tessera", "compare", image, plain, "--json")
                shares.append(difference["error"] / noise["error"])
                if not shares[-1] <= options.limit:
                    above.append(f"{scene['scene']} at {placement}: {shares[-1]:.3g}")
            rows.append((scene["scene"], noise["error"], shares))
    if not rows:
        sys.exit("no scene has this name")
    text = "| scene | noise | " + " | ".join(placements) + " |\n|---|---|" + "---|" * len(placements) + "\n"
    for scene, noise, shares in rows:
        text += f"| {scene} | {noise:.3g} | " + " | ".join(f"{share:.1e}" for share in shares) + " |\n"
    print(text, end="")
    if options.out:
        options.out.write_text(text)
    for line in above:
        print(f"above the limit of {options.limit}: {line}")
    sys.exit(1 if above else 0)


if __name__ == "__main__":
    main()
