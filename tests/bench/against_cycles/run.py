"""Runs the comparison of tests/bench/against_cycles.sh.

Each scene is rendered by Tessera and by the peers that are installed, alternately, with one thread, a box
filter and no clamping (scenes.py says what else makes all do the same work):
- reference: the mean of eight images, whose spread gives its own relMSE;
- agreement: the means of the references, and of their blocks of 8 x 8 pixels (comparison.py); scenes that
  do not agree are shown, but give no ratio;
- error: relMSE of images with increasing sample counts against the renderer's own reference; the sample
  count for the goal is interpolated between measured counts, never extrapolated;
- cost: difference of the CPU seconds of two renders that differ only in their sample counts, divided by
  the difference of samples, which excludes loading and building. The minimum of several;
- adaptive sampling: the same error curve over noise thresholds, with the median of the CPU seconds of the
  images, less those of an image with one sample;
- denoised: relMSE and CPU seconds with each renderer's denoiser, whose cost per pixel is measured with larger
  images, because small ones consist mostly of its fixed cost.
"""

import argparse
import ctypes
import json
import math
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

import comparison
import plot
from comparison import Reference
from renderers import Inputs, Tessera, peers, save
from scenes import GIVEN, OWN, SCENES

ROOT = pathlib.Path(__file__).resolve().parents[3]
PR_SET_CHILD_SUBREAPER = 36
US = "Tessera"
GOAL = 0.01  # relMSE
SIZE, QUICK_SIZE, COST_SIZE = (96, 72), (64, 48), (160, 120)
REFERENCE_IMAGES = 8
# Samples per pixel and seeds; Tessera takes at least four. A curve ends at the first count well below the goal.
LEVELS = {4: 16, 16: 16, 64: 8, 256: 4, 1024: 4, 4096: 4}
COST_SAMPLES, COST_ROUNDS = (8, 56), 3
DENOISED_LEVELS, DENOISED_SEEDS = (16, 64, 256), 3
FILTER_SIZE, FILTER_SPP = (640, 480), 4  # for the cost of the denoiser
THRESHOLDS = (0.4, 0.2, 0.1, 0.05, 0.025, 0.0125)  # of adaptive sampling
ADAPTIVE_SEEDS, ADAPTIVE_SPP = 8, 4096
VARIANTS = {"guided", "adaptive"}  # with the expected image of the renderer itself
GUIDED = f"{US}, guided"
DENOISED = {US, GUIDED, "Cycles 4.5"}
SIMPLE = {"cornell_diffuse", "cornell_glass", "interior_window", "manylights200", "punctual"}
SCENES_OF = {  # by words in the names of renderers; the others render every scene
    "Mitsuba": SIMPLE, "LuxCore": SIMPLE,  # what gltf_scene.py reads
    # Where path guiding can help, because light arrives indirectly, or second paths, because lights look small.
    "guided": {"cornell_glass", "interior_window", "manylights200", "window", "window_sky", "caustic", "glass_box",
               "glint", "quickstart"},
    "adaptive": {"cornell_glass", "interior_window"}}  # where more samples are needed than it takes at least


def log(*words):
    print(*words, file=sys.stderr, flush=True)


def jobs_of(spp, seeds, first_seed, size, **more):
    return [{"spp": spp, "seed": first_seed + k, "size": size, **more} for k in range(seeds)]


def variant_of(renderer):
    """Returns the last word of the name of a variant, or None."""
    last = renderer.split(", ")[-1]
    return last if last in VARIANTS else None


def renders(renderer, name):
    return all(name in scenes for word, scenes in SCENES_OF.items() if word in renderer)


def references(name, renderers, size, out):
    spp = SCENES[name].reference_spp // REFERENCE_IMAGES
    made = {}
    for renderer, program in renderers.items():
        if variant_of(renderer):
            continue  # the same expected image, and a second training for nothing
        made[renderer] = Reference([image for image, _ in program.render(
            name, jobs_of(spp, REFERENCE_IMAGES, 1, size))])
        if out:
            save(made[renderer].mean, out / f"{name}, {renderer}.exr")
        log(f"{name}: reference of {renderer}, relMSE {made[renderer].rel_mse:.1e}")
    return made


def cost_per_sample(name, renderers):
    """Returns CPU seconds per pixel sample of each renderer."""
    found = {renderer: [] for renderer in renderers}
    for _ in range(COST_ROUNDS):
        for renderer, program in renderers.items():
            spent = [cpu for _, cpu in program.render(
                name, [{"spp": n, "seed": 7, "size": COST_SIZE} for n in COST_SAMPLES])]
            found[renderer].append((spent[1] - spent[0]) / (COST_SAMPLES[1] - COST_SAMPLES[0]))
    area = COST_SIZE[0] * COST_SIZE[1]
    return {renderer: min(values) / area for renderer, values in found.items()}


def error_curve(name, program, reference, size):
    """Returns [(spp, errors of the seeds)] until the error is well below the goal."""
    curve = []
    for spp, seeds in LEVELS.items():
        errors = [reference.error_of(image) for image, _ in program.render(name, jobs_of(spp, seeds, 1000, size))]
        curve.append((spp, errors))
        if statistics.mean(errors) <= GOAL / 2 and len(curve) > 2:
            break
    return curve


def adaptive_curve(name, program, reference, size):
    """Returns [(CPU seconds per megapixel, errors of the seeds)] over noise thresholds."""
    base = min(cpu for _, cpu in program.render(name, jobs_of(1, COST_ROUNDS, 7, size)))
    area = size[0] * size[1] * 1e-6
    curve = []
    for threshold in THRESHOLDS:
        made = program.render(name, jobs_of(ADAPTIVE_SPP, ADAPTIVE_SEEDS, 1000, size, threshold=threshold))
        errors = [reference.error_of(image) for image, _ in made]
        curve.append(((statistics.median(cpu for _, cpu in made) - base) / area, errors))
        if statistics.mean(errors) <= GOAL / 2:
            break
    return curve


def cost_of_filter(name, program):
    """Returns CPU seconds per megapixel of the denoiser."""
    pixels = FILTER_SIZE[0] * FILTER_SIZE[1]
    extra = []
    for _ in range(COST_ROUNDS):
        (_, raw), (_, smooth) = program.render(name, [
            {"spp": FILTER_SPP, "seed": 7, "size": FILTER_SIZE, "denoise": denoise} for denoise in (False, True)])
        extra.append((smooth - raw) / pixels)
    return 1e6 * max(statistics.median(extra), 0)


def denoised(name, program, reference, cost, size):
    """Returns {spp: {raw, denoised, seconds_per_megapixel, filter_seconds_per_megapixel}}."""
    filtering = cost_of_filter(name, program)
    found = {}
    for spp in DENOISED_LEVELS:
        raw = program.render(name, jobs_of(spp, DENOISED_SEEDS, 3000, size))
        smooth = program.render(name, jobs_of(spp, DENOISED_SEEDS, 3000, size, denoise=True))
        found[spp] = {"raw": statistics.mean(reference.error_of(image) for image, _ in raw),
                      "denoised": statistics.mean(reference.error_of(image) for image, _ in smooth),
                      "seconds_per_megapixel": 1e6 * cost * spp + filtering,
                      "filter_seconds_per_megapixel": filtering}
    return found


def compare(name, renderers, size, raw, out):
    renderers = {renderer: program for renderer, program in renderers.items() if renders(renderer, name)}
    made = references(name, renderers, size, out)
    cost = cost_per_sample(name, {renderer: program for renderer, program in renderers.items()
                                  if variant_of(renderer) != "adaptive"})
    row = {"scene": name, "renderers": {}}
    for renderer, program in renderers.items():
        reference = made.get(renderer) or made[renderer.removesuffix(f", {variant_of(renderer)}")]
        if variant_of(renderer) == "adaptive":
            curve = adaptive_curve(name, program, reference, size)
        else:
            curve = [(1e6 * cost[renderer] * spp, errors)
                     for spp, errors in error_curve(name, program, reference, size)]
        means = comparison.means(curve)
        per_sample = 1e6 * cost[renderer] if renderer in cost else None
        entry = {"cpu_seconds_per_megasample": per_sample, "reference_relmse": reference.rel_mse,
                 "curve": curve, "slope": comparison.slope(means),
                 "seconds_per_megapixel": comparison.crossing(means, GOAL)}
        if renderer != US:
            agreement = comparison.agreement(made[US].images, reference.images)
            entry |= {"mean_ratio": agreement.mean_ratio, "blocks": agreement.block_count,
                      "differing": agreement.differing, "comparable": bool(agreement.comparable)}
            ours = row["renderers"][US]
            if None not in (entry["seconds_per_megapixel"], ours["seconds_per_megapixel"]):
                entry["ratio"] = entry["seconds_per_megapixel"] / ours["seconds_per_megapixel"]
                entry["interval"] = comparison.ratio_interval(curve, ours["curve"], GOAL)
        if renderer in DENOISED and not raw:
            entry["denoised"] = denoised(name, program, reference, cost[renderer], size)
        row["renderers"][renderer] = entry
        log(f"{name}: {renderer}: " + json.dumps({k: v for k, v in entry.items() if k != "curve"}))
    return row


def compare_costs(row, renderers):
    """Measures the CPU times of a row of results.json again, and changes what follows from them."""
    found = row["renderers"]
    timed = {name: program for name, program in renderers.items()
             if name in found and variant_of(name) != "adaptive"}
    cost = cost_per_sample(row["scene"], timed)
    for name, program in timed.items():
        entry = found[name]
        factor = 1e6 * cost[name] / entry["cpu_seconds_per_megasample"]
        entry["cpu_seconds_per_megasample"] *= factor
        entry["curve"] = [(factor * seconds, errors) for seconds, errors in entry["curve"]]
        if entry["seconds_per_megapixel"] is not None:
            entry["seconds_per_megapixel"] *= factor
        if "denoised" in entry:
            filtering = cost_of_filter(row["scene"], program)
            for spp, values in entry["denoised"].items():
                values["filter_seconds_per_megapixel"] = filtering
                values["seconds_per_megapixel"] = 1e6 * cost[name] * int(spp) + filtering
        if "ratio" in entry:
            ours = found[US]  # which comes first
            entry["ratio"] = entry["seconds_per_megapixel"] / ours["seconds_per_megapixel"]
            entry["interval"] = comparison.ratio_interval(entry["curve"], ours["curve"], GOAL)
    log(f"{row['scene']}: " + json.dumps({name: found[name]["cpu_seconds_per_megasample"] for name in timed}))
    return row


def number(value, form="{:.2f}"):
    return "—" if value is None else form.format(value)


def raw_table(rows, peer):
    lines = [f"| scene | mean, {peer} / Tessera | blocks that differ | µs per sample: Tessera, {peer} | "
             f"CPU s per megapixel to relMSE {GOAL}: Tessera, {peer} | ratio, 95 % interval |",
             "|---|---|---|---|---|---|"]
    ratios = []
    for row in rows:
        a, b = row["renderers"][US], row["renderers"].get(peer)
        if b is None:
            continue
        ratio = "not comparable"
        if b["comparable"]:
            ratio = "not measured" if "ratio" not in b else f"{b['ratio']:.2f}"
            if b.get("interval"):
                ratio += " ({:.2f} to {:.2f})".format(*b["interval"])
            ratios += [b["ratio"]] if "ratio" in b else []
        lines.append(
            f"| {row['scene']} | {b['mean_ratio']:.4f} | {b['differing']} of {b['blocks']} | "
            f"{a['cpu_seconds_per_megasample']:.2f}, {number(b['cpu_seconds_per_megasample'])} | "
            f"{number(a['seconds_per_megapixel'])}, {number(b['seconds_per_megapixel'])} | {ratio} |")
    if ratios:
        lines += ["", f"{len(ratios)} comparable scenes: geometric mean {comparison.geometric_mean(ratios):.2f}, "
                  f"least {min(ratios):.2f}."]
    return "\n".join(lines), ratios


def error_at(found, seconds):
    """Returns the error of a denoised curve at a CPU time as text, interpolated on logarithmic scales. After the
    last measured time the error there is an upper limit."""
    points = sorted((entry["seconds_per_megapixel"], entry["denoised"]) for entry in found.values())
    for (x0, e0), (x1, e1) in zip(points, points[1:]):
        if x0 <= seconds <= x1 and min(e0, e1) > 0:
            return f"{e0 * (e1 / e0) ** (math.log(seconds / x0) / math.log(x1 / x0)):.5f}"
    return f"at most {points[-1][1]:.5f}" if seconds > points[-1][0] else "—"


def denoised_table(rows, peer):
    """Compares a peer with Tessera, and with guided Tessera in the scenes that have it."""
    lines = [f"| scene | spp of {peer} | CPU s per megapixel | relMSE of {peer} | of {US} at equal time | of {GUIDED} |",
             "|---|---|---|---|---|---|"]
    for row in rows:
        b = row["renderers"].get(peer)
        if b is None or not b["comparable"] or "denoised" not in b:
            continue
        for spp, entry in b["denoised"].items():
            ours = [error_at(row["renderers"][name]["denoised"], entry["seconds_per_megapixel"])
                    if name in row["renderers"] else "" for name in (US, GUIDED)]
            lines.append(f"| {row['scene']} | {spp} | {entry['seconds_per_megapixel']:.1f} | "
                         f"{entry['denoised']:.5f} | {ours[0]} | {ours[1]} |")
    return "\n".join(lines)


def tables(rows):
    """Returns all tables as Markdown."""
    found = list(dict.fromkeys(peer for row in rows for peer in row["renderers"] if peer != US))
    parts = []
    for peer in found:
        parts.append(raw_table(rows, peer)[0])
        if peer != GUIDED and any("denoised" in row["renderers"].get(peer, {}) for row in rows):
            parts.append(denoised_table(rows, peer))
    return "\n\n".join(parts)


def own_scenes(folder):
    """Writes the project's own scenes, by a process of its own, because some of their modules have equal names."""
    subprocess.run([sys.executable, pathlib.Path(__file__).with_name("own_scenes.py"), folder], check=True)
    return folder


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("scenes", type=pathlib.Path, nargs="?")
    parser.add_argument("--bin", type=pathlib.Path, default=ROOT / "build/release/bin")
    parser.add_argument("--python", type=pathlib.Path, default=ROOT / "build/peers/bin/python")
    parser.add_argument("--only", action="append", metavar="NAME", help="a scene by its name in scenes.py")
    parser.add_argument("--peer", action="append", help="a peer by its name in renderers.py; all that are installed")
    parser.add_argument("--quick", action="store_true", help="smaller images, for wider intervals in half the time")
    parser.add_argument("--raw", action="store_true", help="no denoised images")
    parser.add_argument("--costs-of", type=pathlib.Path, metavar="RESULTS", help="measure only CPU times, for the "
                        "images of an earlier run's results.json, because they need an idle machine")
    parser.add_argument("--out", type=pathlib.Path, help="folder for results.json, tables.md, SVG curves and references")
    args = parser.parse_args()
    known = GIVEN if args.scenes else OWN
    if not set(args.only or known) <= set(known):
        sys.exit(f"against_cycles: --only is one of {', '.join(known)}")
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["TMPDIR"] = folder
        scenes = args.scenes.resolve() if args.scenes else own_scenes(pathlib.Path(folder) / "own")
        inputs = Inputs(scenes, pathlib.Path(folder))
        binaries = args.bin.resolve()
        renderers = {US: Tessera(inputs, binaries), **peers(inputs, args.python),
                     GUIDED: Tessera(inputs, binaries, guiding=True)}
        if len(renderers) == 2:
            sys.exit("against_cycles: no peer is installed; see the head of tests/bench/against_cycles.sh")
        chosen = set(args.peer or renderers)
        if not chosen <= set(renderers):
            sys.exit(f"against_cycles: --peer is one of {', '.join(renderers)}")
        chosen |= {US} | {name.removesuffix(f", {variant_of(name)}") for name in chosen}
        renderers = {name: program for name, program in renderers.items() if name in chosen}
        if args.out:
            args.out.mkdir(parents=True, exist_ok=True)
        earlier = {row["scene"]: row for row in json.loads(args.costs_of.read_text())} if args.costs_of else {}
        rows = []
        for name in args.only or earlier or known:
            if args.costs_of:
                rows.append(compare_costs(earlier[name], renderers))
            else:
                rows.append(compare(name, renderers, QUICK_SIZE if args.quick else SIZE, args.raw, args.out))
            if args.out:
                (args.out / "results.json").write_text(json.dumps(rows, indent=1) + "\n")
                (args.out / "tables.md").write_text(tables(rows) + "\n")
                (args.out / f"{name}.svg").write_text(plot.curves(rows[-1], GOAL))
    print(tables(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
