"""Runs the comparison of tests/bench/against_cycles.sh.

For each scene, both renderers run alternately, with one thread, a box filter, no clamping, no denoiser:
- reference: the mean of four images with other seeds, whose spread gives its relMSE;
- agreement: Welch's t-test of the two references, per block of 8 x 8 pixels;
- error: relMSE of images with increasing sample counts against the renderer's own reference, whose
  relMSE is subtracted; the samples for 0.01 are interpolated on logarithmic scales;
- agreement with the same BSDF: scenes of opaque metallic-roughness materials again, with Cycles'
  formula in Tessera (tessera_render_cycles34), so that everything else is compared;
- speed: difference of the CPU seconds of two whole processes that differ only in their sample counts,
  divided by the difference of samples, which excludes loading and building. The minimum of several.
relMSE = mean of (x - r)^2 / (r^2 + 0.01) over pixels and channels.
"""

import argparse
import ctypes
import json
import math
import os
import pathlib
import resource
import statistics
import struct
import subprocess
import sys
import tempfile

import numpy
import OpenImageIO

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[2]
VENICE = "env/venice_sunset_1k.hdr"
# name: (samples of the reference, scattering events, environment)
SCENES = {
    "cm_cornell_diffuse": (2048, 9, None),
    "cm_cornell_glass": (8192, 17, None),
    "cm_interior_window": (8192, 9, (1, 1.2, 1.5)),
    "cm_manylights200": (16384, 9, None),
    "DamagedHelmet": (1024, 9, VENICE),
    "cm_bunnies1024": (2048, 9, VENICE),
}
SAME_BSDF = {  # as above
    "cm_spheres_grid": (2048, 9, VENICE),
    "DamagedHelmet": SCENES["DamagedHelmet"],
    "cm_bunnies1024": SCENES["cm_bunnies1024"],
}
PR_SET_CHILD_SUBREAPER = 36
GOAL = 0.01  # relMSE
ERROR_SIZE, SPEED_SIZE = (96, 72), (320, 240)
REFERENCES, SEEDS, LEVELS = 4, 3, [16, 64, 256, 1024, 4096]
SPEED_SAMPLES, SPEED_ROUNDS = (8, 64), 3


class Runner:
    def __init__(self, scenes, binaries, folder):
        self.scenes, self.binaries, self.folder = scenes, binaries, folder
        self.count = 0

    def file(self, ending):
        self.count += 1
        return self.folder / f"{self.count}{ending}"

    def scene(self, name):
        return next((self.scenes / name).glob("*.gl[bt]*"))

    def sky(self, sky):
        if sky is None:
            return None
        if isinstance(sky, str):
            return self.scenes / sky
        path = self.folder / ("sky_" + "_".join(map(str, sky)) + ".exr")
        if not path.exists():
            spec = OpenImageIO.ImageSpec(16, 8, 3, "float")
            image = OpenImageIO.ImageOutput.create(str(path))
            image.open(str(path), spec)
            image.write_image(numpy.broadcast_to(numpy.float32(sky), (8, 16, 3)).copy())
            image.close()
        return path

    def tessera(self, name, spp, seed, size):
        """Returns the file of the image and the CPU seconds of all processes."""
        _, depth, sky = SCENES[name]
        out = self.file(".exr")
        command = [self.binaries / "tessera", "render", self.scene(name), "-o", out, "--spp", str(spp),
                   "--seed", str(seed), "--size", "%dx%d" % size, "--max-depth", str(depth),
                   "--threads", "1"]
        if sky is not None:
            command += ["--environment", self.sky(sky)]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wait_for_orphans()
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return out, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    def cycles34(self, name, spp, seed, size):
        """Renders with Tessera and the BSDF of Cycles."""
        _, depth, sky = SAME_BSDF[name]
        marked = self.folder / f"{name}.glb"
        if not marked.exists():
            mark_materials(self.scene(name), marked)
        out = self.file(".pfm")
        subprocess.run([self.binaries / "tessera_render_cycles34", marked, "-o", out, "--spp", str(spp),
                        "--seed", str(seed), "--size", "%dx%d" % size, "--max-depth", str(depth),
                        "--environment", self.sky(sky)], check=True, stdout=subprocess.DEVNULL)
        return out, 0

    def cycles(self, name, spp, seed, size):
        _, depth, sky = {**SAME_BSDF, **SCENES}[name]
        out = self.file(".exr")
        options = {"spp": spp, "seed": seed, "size": size, "depth": depth}
        if sky is not None:
            options["sky"] = str(self.sky(sky))
        done = subprocess.run(
            ["blender", "-b", "--factory-startup", "-noaudio", "-P", HERE / "blender_scene.py", "--",
             self.scene(name), out, json.dumps(options)], capture_output=True, text=True)
        spent = [line for line in done.stdout.splitlines() if line.startswith("CPU_SECONDS")]
        if not spent or not out.exists():
            sys.exit(f"against_cycles: Blender failed on {name}:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
        return out, float(spent[0].split()[1])


def mark_materials(source, target):
    """Copies a .glb and gives its opaque materials an extension without effect."""
    data = source.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    gltf = json.loads(data[20 : 20 + length])
    for material in gltf.get("materials", []):
        if "KHR_materials_transmission" not in material.get("extensions", {}):
            material.setdefault("extensions", {})["TESSERA_material"] = {"fresnel": "exact"}
    gltf.setdefault("extensionsUsed", []).append("TESSERA_material")
    text = json.dumps(gltf).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    target.write_bytes(struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
                       + text + rest)


def wait_for_orphans():
    """Returns CPU seconds; as a subreaper, this process also waits for servers and workers of the command."""
    while True:
        try:
            os.waitpid(-1, 0)
        except ChildProcessError:
            return


def pixels(path):
    return OpenImageIO.ImageBuf(str(path)).get_pixels(OpenImageIO.FLOAT)[..., :3].astype(numpy.float64)


def rel_mse(squares, reference):
    return float((squares / (reference**2 + 0.01)).mean())


def student_tail(t, freedom):
    """Returns P(|T| > t)."""
    theta = math.atan(t / math.sqrt(freedom))
    steps = 400
    width = (math.pi / 2 - theta) / steps
    angles = theta + (numpy.arange(steps) + 0.5) * width
    scale = math.exp(math.lgamma((freedom + 1) / 2) - math.lgamma(freedom / 2)) / math.sqrt(math.pi)
    return 2 * scale * float((numpy.cos(angles) ** (freedom - 1)).sum()) * width


def blocks(image):
    """Returns means over 8 x 8 pixels and the channels."""
    height, width, _ = image.shape
    return image.mean(2).reshape(height // 8, 8, width // 8, 8).mean((1, 3)).ravel()


def agreement(ours, theirs):
    """Returns the share of blocks whose means differ at the 1 % level, and the ratio of the images' means."""
    a, b = (numpy.array([blocks(image) for image in images]) for images in (ours, theirs))
    n = len(ours)
    va, vb = a.var(0, ddof=1) / n, b.var(0, ddof=1) / n
    apart = 0
    for k in range(a.shape[1]):
        v = va[k] + vb[k]
        difference = abs(a[:, k].mean() - b[:, k].mean())
        if v == 0:
            apart += difference > 1e-6
            continue
        freedom = v**2 / ((va[k] ** 2 + vb[k] ** 2) / (n - 1))
        apart += student_tail(difference / math.sqrt(v), freedom) < 0.01
    return apart / a.shape[1], numpy.mean(theirs) / numpy.mean(ours)


def compare_materials(runner, name):
    spp = SAME_BSDF[name][0] // REFERENCES
    images = {"cycles34": [], "cycles": []}
    for seed in range(REFERENCES):
        for renderer in images:
            images[renderer].append(pixels(getattr(runner, renderer)(name, spp, 1 + seed, ERROR_SIZE)[0]))
    apart, ratio = agreement(images["cycles34"], images["cycles"])
    return {"scene": f"{name}, Cycles' BSDF in both", "blocks_apart": apart, "mean_ratio": float(ratio)}


class Reference:
    def __init__(self, images):
        stack = numpy.array(images)
        self.images = images
        self.mean = stack.mean(0)
        self.rel_mse = rel_mse(stack.var(0, ddof=1) / len(images), self.mean)


def samples_to_goal(render, name, reference):
    """Returns the samples per pixel for relMSE GOAL, and the curve."""
    curve = []
    for spp in LEVELS:
        errors = [rel_mse((pixels(render(name, spp, 1000 + seed, ERROR_SIZE)[0]) - reference.mean) ** 2,
                          reference.mean) - reference.rel_mse for seed in range(SEEDS)]
        curve.append((spp, statistics.mean(errors)))
        if curve[-1][1] <= GOAL:
            break
    if curve[-1][1] > GOAL:
        return math.nan, curve
    if len(curve) == 1:  # below GOAL from the start: extrapolated as 1 / samples
        return curve[0][0] * curve[0][1] / GOAL, curve
    (n0, e0), (n1, e1) = curve[-2:]
    slope = math.log(e1 / e0) / math.log(n1 / n0)
    return n0 * (GOAL / e0) ** (1 / slope), curve


def compare(runner, name):
    spp = SCENES[name][0] // REFERENCES
    images = {"tessera": [], "cycles": []}
    for seed in range(REFERENCES):
        for renderer in images:
            images[renderer].append(pixels(getattr(runner, renderer)(name, spp, 1 + seed, ERROR_SIZE)[0]))
    references = {renderer: Reference(found) for renderer, found in images.items()}
    seconds = {"tessera": [], "cycles": []}
    for _ in range(SPEED_ROUNDS):
        for renderer in seconds:
            few, many = (getattr(runner, renderer)(name, n, 7, SPEED_SIZE)[1] for n in SPEED_SAMPLES)
            seconds[renderer].append((many - few) / (SPEED_SAMPLES[1] - SPEED_SAMPLES[0]))
    apart, ratio = agreement(images["tessera"], images["cycles"])
    row = {"scene": name, "blocks_apart": apart, "mean_ratio": float(ratio)}
    area = SPEED_SIZE[0] * SPEED_SIZE[1] * 1e-6
    for renderer, reference in references.items():
        needed, curve = samples_to_goal(getattr(runner, renderer), name, reference)
        marginal = min(seconds[renderer])
        row[renderer] = {"reference_relmse": reference.rel_mse, "curve": curve, "spp": needed,
                         "kpaths_per_second": area * 1e3 / marginal,
                         "seconds_per_megapixel": needed * marginal / area}
    row["ratio"] = row["cycles"]["seconds_per_megapixel"] / row["tessera"]["seconds_per_megapixel"]
    return row


def table(rows, same_bsdf):
    """Returns the tables as Markdown."""
    lines = ["| scene | blocks that differ at 1 % | Cycles / Tessera, mean radiance | comparable |",
             "|---|---|---|---|"]
    for row in rows + same_bsdf:
        same = row["blocks_apart"] <= 0.04
        lines.append(f"| {row['scene']} | {100 * row['blocks_apart']:.1f} % | {row['mean_ratio']:.4f} | "
                     f"{'yes' if same else 'not within noise'} |")
    if not rows:
        return "\n".join(lines), math.inf
    lines += ["", "| scene | 1,000 paths / CPU s: Tessera, Cycles | spp for relMSE 0.01 | own relMSE of the "
              "references | CPU s per megapixel for that | Cycles / Tessera |", "|---|---|---|---|---|---|"]
    for row in rows:
        a, b = row["tessera"], row["cycles"]
        lines.append(f"| {row['scene']} | {a['kpaths_per_second']:.0f}, {b['kpaths_per_second']:.0f} | "
                     f"{a['spp']:.1f}, {b['spp']:.1f} | {a['reference_relmse']:.1e}, "
                     f"{b['reference_relmse']:.1e} | {a['seconds_per_megapixel']:.1f}, "
                     f"{b['seconds_per_megapixel']:.1f} | {row['ratio']:.2f} |")
    mean = math.exp(statistics.mean(math.log(row["ratio"]) for row in rows))
    return "\n".join([*lines, "", f"Geometric mean of {len(rows)}: {mean:.2f}"]), mean


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("scenes", type=pathlib.Path)
    parser.add_argument("--bin", type=pathlib.Path, default=ROOT / "build/bench/bin")
    parser.add_argument("--only", action="append", choices=[*SCENES, "cm_spheres_grid"])
    parser.add_argument("--agreement", action="store_true", help="with the same BSDF alone")
    parser.add_argument("--out", type=pathlib.Path, help="the tables; beside it .json")
    args = parser.parse_args()
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    rows, same_bsdf = [], []
    with tempfile.TemporaryDirectory() as folder:
        os.environ["TMPDIR"] = folder
        runner = Runner(args.scenes.resolve(), args.bin.resolve(), pathlib.Path(folder))
        for name in SAME_BSDF:
            if not args.only or name in args.only:
                same_bsdf.append(compare_materials(runner, name))
                print(json.dumps(same_bsdf[-1]), flush=True)
        for name in SCENES:
            if not args.agreement and (not args.only or name in args.only):
                rows.append(compare(runner, name))
                print(json.dumps(rows[-1]), flush=True)
    text, mean = table(rows, same_bsdf)
    print(text)
    if args.out:
        args.out.write_text(text + "\n")
        args.out.with_suffix(".json").write_text(json.dumps(rows + same_bsdf, indent=1) + "\n")
    return 0 if mean >= 2 and all(row["ratio"] >= 1 for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
