#!/usr/bin/env python3
"""What a scene pays for features it does not use, and what it gains as things are chosen by needs.

    tests/bench/needs.py [--pairs 20] [--scene tests/scenes/lit_square.gltf] [FEATURE]...
    tests/bench/needs.py --general [--pairs 20] [--scene tests/scenes/quickstart.gltf] [FEATURE]...

Builds tessera_render_once twice from copies of the sources, once as they are and once with a
feature's code taken out by hand (FEATURES below; an edit that no longer applies is an error), and
renders a scene without that feature (SCENES, or --scene): instructions under valgrind's callgrind (AVX2: it knows no
AVX-512), and CPU time in interleaved pairs (each side the least of three runs by turns), the median
ratio with its 95 % interval by bootstrap.
The pixels must be the same. Limits: 1.005 for instructions, 1.02 for the interval's upper end.

--general: the general way against the special one. A scene without a feature is rendered as though
everything in it had it (tessera_render_once --assume): instructions of twice the samples less those
of once, so that loading and building do not count, and the same pairs. The pixels must be the same,
but for the extended BSDF, which rounds otherwise. --pairs 0 leaves the pairs out.
"""

import argparse
import functools
import json
import math
import os
import pathlib
import random
import re
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
TRAVERSAL, PACKET = "worker/accel/traversal/traversal.h", "worker/accel/traversal/packet_traversal.h"
MEDIA = "worker/render/path/path_media.h"
PATHS, FRAME = "worker/render/path/path_tracer.cpp", "worker/render/frame_renderer.cpp"
RAY, SURFACE = "worker/geometry/ray.h", "worker/shading/surface/surface.h"
FEATURES = {  # feature: (file, what is there, what is put in its place)
    "instances": [
        (TRAVERSAL, "if (scene.single) return intersect_placed(", "return intersect_placed("),
        (TRAVERSAL, "  return intersect_instances(scene, ray, query);\n}", "}"),
        (TRAVERSAL, "if (!placed.identity) {", "if (false) {"),
        (PACKET, "if (scene.single) {", "if (true) {"),
        (PACKET, "if (!placed.identity) {", "if (false) {"),
    ],
    "alpha": [
        (PATHS, "if (traits == 0) return frame_.accel.closest_hit(path_.ray, *hit);",
         "if (true) return frame_.accel.closest_hit(path_.ray, *hit);"),
        (PATHS, "if (traits == 0) {\n    const TriangleId& target", "if (true) {\n    const TriangleId& target"),
        (PATHS, "return (frame.shading.traits & traits) == 0 && frame.accel.takes_packets();",
         "static_cast<void>(traits);\n  return frame.accel.takes_packets();"),
    ],
    "motion": [
        (RAY, "struct Ray {", "struct NoTime {\n  operator float() const { return 0; }\n"
         "  NoTime& operator=(float) { return *this; }\n};\nstruct Ray {"),
        (RAY, "  float time = 0;", "  [[no_unique_address]] NoTime time;"),
        (PATHS, "frame.moves ? begin_paths<true>(frame, ids, samplers, rays)\n"
         "              : begin_paths<false>(", "begin_paths<false>("),
        (PATHS, "  hit.time = path_.ray.time;", ""),
        ("worker/render/path/path_tracer.h", "  float time = 0;   // of the ray that met it", ""),
        (PATHS, "camera.moves() ? camera.at(hit.time).depth(hit.position)\n"
         "                                                  : ", ""),
        (FRAME, "camera_.moves() ? camera_.at(hit.time).depth(hit.position) : ", ""),
        (SURFACE, "return instance.moves ? moved_at(scene, hit, direction, time, memory)\n"
         "                          : solid_at(", "return solid_at("),
    ],
    "media": [
        (PATHS, "if (frame.shading.tracks_bodies && scratch->crossings == nullptr) {", "if (false) {"),
        (PATHS, "    if (frame.shading.tracks_bodies) [[unlikely]] {\n      results", "    if (false) {\n      results"),
    ],
    "shapes": [
        (SURFACE, "if (instance.special) [[unlikely]] {", "if (instance.moves) [[unlikely]] {"),
        (SURFACE, "  if (instance.solid) [[unlikely]]\n    return solid_at(scene, instance, hit, direction);\n", ""),
        ("worker/shading/surface/surface.cpp", "if (p.shape != nullptr) [[unlikely]]", "if (false)"),
    ],
    "planes": [
        (TRAVERSAL, "    if (!scene.unbounded.empty() && intersect_unbounded(scene, ray, query)) [[unlikely]]\n"
         "      return true;\n    if (scene.placed.empty()) return false;\n", ""),
    ],
    "emissive-media": [
        (MEDIA, "  if (tracer().frame_.shading.has_emissive_media && medium.emits()) [[unlikely]]\n"
         "    add_emission_along(segment);\n", ""),
        (MEDIA, "  if (light.filling != nullptr) [[unlikely]] {", "  if (false) {"),
        ("worker/shading/surface/medium.h", "return max_component(extinction) > 0 || emits();",
         "return max_component(extinction) > 0;"),
        ("worker/light/light_sampler.h", "  std::uint32_t body = 0;                 // of `filling`\n"
         "  const MaterialView* filling = nullptr;", "  static inline std::uint32_t body = 0;\n"
         "  static inline const MaterialView* filling = nullptr;"),
    ],
    "procedures": [
        (PATHS, "if (frame_.shading.tracks_footprints) [[unlikely]]", "if (false)"),
    ],
}
SCENES = {  # of features whose code only some scenes reach; the others: --scene
    "planes": ROOT / "tests/scenes/shapes.gltf",
    "emissive-media": ROOT / "tests/scenes/fog.gltf",
}
GENERAL = ["textures", "texture-transforms", "vertex-colors", "alpha-mask", "unlit", "specular",
           "thin-transmission", "instances", "lens", "procedural-textures", "shapes", "media",
           "emissive-media", "motion"]
EXTENDED = "extended"  # the BSDF with all extensions of materials, where there are none
EXTEND = [("worker/shading/surface/shading_scene.cpp", "view.extended = (is_layered(m) || view.dispersive) && !m.unlit;",
           "view.extended = (is_layered(m) || true) && !m.unlit;")]
RENDER = ["--size", "64x48", "--spp", "8", "--threads", "1"]
TIMED = ["--size", "256x192", "--spp", "64", "--threads", "1"]
ONCE = ["--size", "32x24", "--spp", "8", "--threads", "1"]  # and twice the samples
TWICE = ["--size", "32x24", "--spp", "16", "--threads", "1"]
TIMED_GENERAL = ["--size", "160x120", "--spp", "16", "--threads", "1"]


def build(folder, edits):
    shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns("build", ".git"))
    for file, old, new in edits:
        path = folder / file
        text = path.read_text()
        if text.count(old) != 1:
            sys.exit(f"needs: {file}: {old!r} is there {text.count(old)} times; mend FEATURES")
        path.write_text(text.replace(old, new))
    subprocess.run(["cmake", "--preset", "dev", "-D", "CMAKE_COMPILE_WARNING_AS_ERROR=OFF"], cwd=folder,
                   check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    shared = {**os.environ, "CCACHE_BASEDIR": str(folder), "CCACHE_NOHASHDIR": "1"}
    subprocess.run(["cmake", "--build", "--preset", "dev", "--target", "tessera_render_once"],
                   cwd=folder, check=True, stdout=subprocess.DEVNULL, env=shared)
    return folder / "build/dev/bin/tessera_render_once"


def instructions(command, folder, render=RENDER):
    done = subprocess.run(
        ["valgrind", "--tool=callgrind", f"--callgrind-out-file={folder}/callgrind.out", *command,
         *render], capture_output=True, text=True, check=True)
    return int(re.search(r"Collected : (\d+)", done.stderr)[1]), re.search(r"sha256 (\w+)", done.stdout)[1]


@functools.lru_cache
def instructions_of_samples(command, folder):
    """Of what TWICE asks for beyond ONCE; and the pixels."""
    once, pixels = instructions(command, folder, ONCE)
    twice, _ = instructions(command, folder, TWICE)
    return twice - once, pixels


def cpu_seconds(command, timed):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([*command, *timed], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def ratio_interval(ratios):
    dice = random.Random(1)
    medians = sorted(statistics.median(dice.choices(ratios, k=len(ratios))) for _ in range(4000))
    return statistics.median(ratios), medians[100], medians[3899]


def pairs_of(more, less, count, timed):
    """Ratios of the CPU time of two commands."""
    ratios = []
    for _ in range(count):
        least_of = {"more": math.inf, "less": math.inf}
        for side, command in [("less", less), ("more", more)] * 3:
            least_of[side] = min(least_of[side], cpu_seconds(command, timed))
        ratios.append(least_of["more"] / least_of["less"])
    return ratios


def matt(scene, folder):
    """A copy of a scene whose dielectrics have no specular layer, for what is chosen by that."""
    gltf = json.loads(scene.read_text())
    for material in gltf["materials"]:
        extensions = material.setdefault("extensions", {})
        if "KHR_materials_transmission" not in extensions:
            extensions["KHR_materials_specular"] = {"specularFactor": 0}
    gltf["extensionsUsed"] = sorted({*gltf.get("extensionsUsed", []), "KHR_materials_specular"})
    path = folder / "matt.gltf"
    path.write_text(json.dumps(gltf))
    return path


def compare_without(args, folder):
    failed = False
    program = build(folder / "whole", [])
    for feature in args.features or FEATURES:
        scene = SCENES.get(feature, args.scene)
        whole, without = [program, scene], [build(folder / feature, FEATURES[feature]), scene]
        count, pixels = instructions(whole, folder)
        least, same = instructions(without, folder)
        if same != pixels:
            sys.exit(f"needs: {feature}: other pixels without it; the scene uses it")
        middle, low, high = ratio_interval(pairs_of(whole, without, args.pairs, TIMED))
        held = count / least <= 1.005 and high <= 1.02
        failed = failed or not held
        print(f"{feature:14} instructions {count:,} / {least:,} = {count / least:.4f}; CPU time, "
              f"{args.pairs} pairs: {middle:.4f} ({low:.4f} to {high:.4f})"
              f"{'' if held else '  OVER THE LIMIT'}", flush=True)
    return 1 if failed else 0


def compare_general(args, folder):
    special = build(folder / "special", [])
    asked = args.features or [*GENERAL, EXTENDED, "all"]
    extended = build(folder / "extended", EXTEND) if EXTENDED in asked else None
    for feature in asked:
        scene = matt(args.scene, folder) if feature == "specular" else SCENES.get(feature, args.scene)
        less = (special, scene)
        assumed = GENERAL if feature == "all" else [feature]
        more = (extended, scene) if feature == EXTENDED else (*less, "--assume", ",".join(assumed))
        least, pixels = instructions_of_samples(less, folder)
        count, same = instructions_of_samples(more, folder)
        if same != pixels and feature != EXTENDED:
            sys.exit(f"needs: {feature}: the general way gives other pixels")
        line = f"{feature:20} instructions {count:,} / {least:,} = {count / least:.4f}"
        if args.pairs > 0:
            middle, low, high = ratio_interval(pairs_of(more, less, args.pairs, TIMED_GENERAL))
            line += f"; CPU time, {args.pairs} pairs: {middle:.3f} ({low:.3f} to {high:.3f})"
        print(line, flush=True)
    return 0


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--general", action="store_true")
    parser.add_argument("--scene", type=pathlib.Path)
    parser.add_argument("features", nargs="*", metavar="FEATURE")
    args = parser.parse_args()
    args.scene = args.scene or ROOT / "tests/scenes" / ("quickstart.gltf" if args.general else "lit_square.gltf")
    unknown = {*args.features} - {*([*GENERAL, EXTENDED, "all"] if args.general else FEATURES)}
    if unknown:
        parser.error(f"no such feature: {', '.join(sorted(unknown))}")
    with tempfile.TemporaryDirectory() as name:
        return (compare_general if args.general else compare_without)(args, pathlib.Path(name))


if __name__ == "__main__":
    sys.exit(main())
