#!/usr/bin/env python3
"""Measures the light that a white dielectric (index 1.5) scatters in Tessera, Cycles and the sample code of glTF.

    dielectric_albedo.py [--bin DIR (build/release/bin)] [--python PATH (build/peers/bin/python)]

Needs python3-numpy, python3-openimageio, and bpy 4.5 in the environment of PATH (against_cycles.sh). Prints
- the albedo: radiance of a plane under uniform light of radiance 1, seen from several angles;
- the light of a lamp: light that the plane scatters to all sides, divided by the light that it receives from a
  directional light at the given angle. It equals the albedo if the BRDF is reciprocal.
The sample code of appendix B is integrated numerically. Figures: docs/reference/materials.md.
"""

import argparse
import base64
import json
import math
import pathlib
import subprocess
import sys
import tempfile

import numpy
import OpenImageIO

from renderers import HERE, pixels

ROUGHNESSES, ANGLES = (0, 0.25, 0.5, 1), (0, 60, 75, 82, 87)  # angles from the normal, degrees
LAMP_ROUGHNESSES, RENDERERS = (0.25, 1), ("Tessera", "Cycles")
STRIP, MARGIN, FACE = 16, 2, 192  # pixels
SPP, LAMP_SPP, SEED = 4096, 16, 5


def turn(axis, degrees):
    """Returns the quaternion of a rotation about an axis."""
    half = math.radians(degrees) / 2
    return [math.sin(half) * a for a in axis] + [math.cos(half)]


def scene(planes, rotation, camera, camera_node, lamp=None):
    """Returns a glTF document. `planes` are (roughness, x0, x1) of rectangles in the plane z = 0."""
    points = [numpy.float32([[x0, -2000, 0], [x1, -2000, 0], [x1, 2000, 0], [x0, 2000, 0]]) for _, x0, x1 in planes]
    count, normals, indices = len(planes), numpy.float32([[0, 0, 1]] * 4), numpy.uint16([0, 1, 2, 0, 2, 3])
    data = b"".join(part.tobytes() for part in (*points, normals, indices))
    accessors = [{"bufferView": 0, "byteOffset": 48 * i, "componentType": 5126, "type": "VEC3", "count": 4,
                  "min": part.min(0).tolist(), "max": part.max(0).tolist()}
                 for i, part in enumerate((*points, normals))]
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0, "rotation": rotation}, {"camera": 0, **camera_node}], "cameras": [camera],
        "materials": [{"name": f"white {r}", "pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": r}}
                      for r, _, _ in planes],
        "meshes": [{"primitives": [{"attributes": {"POSITION": i, "NORMAL": count}, "indices": count + 1, "material": i}
                                   for i in range(count)]}],
        "accessors": [*accessors, {"bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": 6}],
        "bufferViews": [{"buffer": 0, "byteLength": len(data) - 12, "target": 34962},
                        {"buffer": 0, "byteOffset": len(data) - 12, "byteLength": 12, "target": 34963}],
        "buffers": [{"byteLength": len(data),
                     "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}]}
    if lamp is not None:
        light = "KHR_lights_punctual"
        document["nodes"].append({"rotation": lamp, "extensions": {light: {"light": 0}}})
        document["scenes"][0]["nodes"].append(2)
        document["extensionsUsed"] = [light]
        document["extensions"] = {light: {"lights": [{"type": "directional", "intensity": 1}]}}
    return document


def render(options, renderer, name, document, size, lamp=False):
    """Returns the mean of the three channels of each pixel."""
    path, out, spp = options.out / f"{name}.gltf", options.out / f"{name}_{renderer}.exr", LAMP_SPP if lamp else SPP
    path.write_text(json.dumps(document))
    if renderer == "Tessera":
        command = [options.bin / "tessera", "render", path, "-o", out, "--force", "--size", "%dx%d" % size,
                   "--spp", str(spp), "--seed", str(SEED), "--threads", "1"]
        command += [] if lamp else ["--environment", options.out / "sky.exr"]
    else:
        settings = options.out / "settings.json"
        settings.write_text(json.dumps({"depth": 16, "sky": None if lamp else [1, 1, 1], "jobs": [
            {"out": str(out), "spp": spp, "seed": SEED, "size": size}]}))
        command = [options.python, HERE / "blender_scene.py", "--", path, settings]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0 or not out.exists():
        sys.exit(f"dielectric_albedo: {renderer} failed on {name}:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return pixels(out).mean(-1)


def albedos(options, renderer, angle):
    """Returns (albedo, standard error) for each roughness: coplanar strips before an orthographic camera."""
    camera = {"type": "orthographic", "orthographic": {"xmag": 2, "ymag": 0.5, "znear": 1, "zfar": 1e4}}
    planes = [(r, i - 2, i - 1) for i, r in enumerate(ROUGHNESSES)]
    document = scene(planes, turn((1, 0, 0), -angle), camera, {"translation": [0, 0, 3000]})
    image = render(options, renderer, f"furnace_{angle}", document, (STRIP * len(planes), STRIP))
    strips = [image[:, STRIP * i + MARGIN : STRIP * (i + 1) - MARGIN] for i in range(len(planes))]
    return [(part.mean(), part.std(ddof=1) / math.sqrt(part.size)) for part in strips]


def scattered(options, renderer, roughness, angle):
    """Returns the share of a lamp's light that is scattered: radiance times cosine over five faces of a cube.

    The camera is 1 above the plane y = 0. The lamp is in the plane of y and z, so views along x and -x are equal.
    """
    x, y = numpy.meshgrid(*[(numpy.arange(FACE) + 0.5) / FACE * 2 - 1] * 2)  # y grows downwards
    solid_angle = (2 / FACE) ** 2 / (1 + x * x + y * y) ** 1.5
    total = 0
    for face, rotation, weight in (("down", turn((1, 0, 0), -90), 1), ("back", turn((0, 1, 0), 180), 1),
                                   ("ahead", turn((0, 1, 0), 0), 1), ("side", turn((0, 1, 0), -90), 2)):
        camera = {"type": "perspective", "perspective": {"yfov": math.pi / 2, "aspectRatio": 1, "znear": 0.01}}
        node = {"translation": [0, 1, 0], "rotation": rotation}
        document = scene([(roughness, -2000, 2000)], turn((1, 0, 0), -90), camera, node, turn((1, 0, 0), angle - 90))
        image = render(options, renderer, f"lamp_{roughness}_{angle}_{face}", document, (FACE, FACE), lamp=True)
        cosine = (1 if face == "down" else numpy.maximum(y, 0)) / numpy.sqrt(1 + x * x + y * y)
        total += weight * (image * cosine * solid_angle).sum()
    return total / math.cos(math.radians(angle))


def sample_code(roughness, angle, n=1500):
    """Returns the albedo of appendix B: F x specular + (1 - F) x diffuse, F at the half vector."""
    u, phi = numpy.meshgrid((numpy.arange(n) + 0.5) / n, (numpy.arange(n) + 0.5) / n * math.pi)  # half the azimuths
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))

    def fresnel(cosine):
        return 0.04 + 0.96 * (1 - cosine) ** 5

    l_z, l_x = numpy.sqrt(1 - u), numpy.sqrt(u) * numpy.cos(phi)  # directions by their cosine
    diffuse = (1 - fresnel(numpy.sqrt((1 + l_z * c + l_x * s) / 2))).mean()
    if roughness == 0:
        return fresnel(c) + diffuse
    a2 = roughness**4
    h_z = numpy.sqrt((1 - u) / (1 + (a2 - 1) * u))  # half vectors by their density
    v_h = c * h_z + s * numpy.sqrt(1 - h_z * h_z) * numpy.cos(phi)
    l_n = numpy.maximum(2 * v_h * h_z - c, 0)
    both = l_n * math.sqrt(c * c * (1 - a2) + a2) + c * numpy.sqrt(l_n * l_n * (1 - a2) + a2)
    v_h = numpy.maximum(v_h, 0)
    return diffuse + (fresnel(v_h) * 2 * l_n * v_h / (both * h_z)).mean()


def show(title, values):
    print(f"{title:28}", "".join(f"{value:>18}" for value in values), flush=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--bin", type=pathlib.Path, default=HERE.parents[2] / "build/release/bin")
    parser.add_argument("--python", type=pathlib.Path, default=HERE.parents[2] / "build/peers/bin/python")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        options.out = pathlib.Path(folder)
        sky = OpenImageIO.ImageBuf(OpenImageIO.ImageSpec(16, 8, 3, "float"))
        OpenImageIO.ImageBufAlgo.fill(sky, (1, 1, 1))
        sky.write(str(options.out / "sky.exr"))
        show("albedo, roughness", ROUGHNESSES)
        for angle in ANGLES:
            show(f"{angle}° sample code", [f"{sample_code(r, angle):.4f}" for r in ROUGHNESSES])
            for name in RENDERERS:
                show(f"{angle}° {name}", [f"{a:.4f} ± {e:.4f}" for a, e in albedos(options, name, angle)])
        show("light of a lamp, roughness", LAMP_ROUGHNESSES)
        for angle in ANGLES:
            for name in RENDERERS:
                show(f"{angle}° {name}", [f"{scattered(options, name, r, angle):.4f}" for r in LAMP_ROUGHNESSES])


main()
