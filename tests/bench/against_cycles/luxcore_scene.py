"""Renders a glTF scene by LuxCore.

    PYTHON luxcore_scene.py -- SCENE OPTIONS.json        PYTHON has the module pyluxcore

OPTIONS.json is that of blender_scene.py, with "engine", for example "PATHCPU". "sky" is null or [r, g, b].
Prints a line JOB with the CPU seconds of the process for each job; they include the start of the render. LuxCore
renders up to 0.6 % more samples than asked for.
"""

import array
import json
import math
import pathlib
import sys
import tempfile
import time

import numpy
import pyluxcore

import gltf_scene


def material(name, surface):
    """Returns the properties of a material."""
    found = {}
    if surface.kind == "glass":
        found = {"type": "glass", "kr": (1, 1, 1), "kt": (1, 1, 1), "interiorior": surface.ior, "exteriorior": 1}
        if max(surface.absorption) > 0:
            found["volume.interior"] = f"{name}_inside"
    elif surface.kind == "metal":
        alpha = surface.roughness**2
        found = {"type": "metal2", "fresnel": f"{name}_fresnel", "uroughness": alpha, "vroughness": alpha}
    else:
        found = {"type": "matte", "kd": surface.color}
    if max(surface.emission) > 0:
        found |= {"emission": surface.emission, "emission.directlightsampling.type": "ENABLED"}
    made = {f"scene.materials.{name}.{key}": value for key, value in found.items()}
    if surface.kind == "metal":
        made |= {f"scene.textures.{name}_fresnel.type": "fresnelcolor",
                 f"scene.textures.{name}_fresnel.kr": surface.color}
    if max(surface.absorption) > 0:
        made |= {f"scene.volumes.{name}_inside.type": "clear",
                 f"scene.volumes.{name}_inside.absorption": surface.absorption}
    return made


def light(name, made):
    if made.kind == "point":  # LuxCore divides the colour by 4 pi
        found = {"type": "point", "position": made.position, "color": [4 * math.pi * c for c in made.color]}
    else:
        found = {"type": "sharpdistant", "direction": made.direction, "color": made.color}
    return {f"scene.lights.{name}.{key}": value for key, value in found.items()}


def camera(made, yfov, size):
    """Returns the properties of the camera of an image that is wider than high.

    LuxCore asks for the horizontal field of view. Its images are one row too low, which the window corrects.
    """
    eye, towards, up = made[:3, 3], -made[:3, 2], made[:3, 1]
    aspect, row = size[0] / size[1], 2 / size[0]
    found = {"type": "perspective", "lookat.orig": eye, "lookat.target": eye + towards, "up": up,
             "fieldofview": math.degrees(2 * math.atan(math.tan(yfov / 2) * aspect)),
             "screenwindow": (-1, 1, -1 / aspect - row, 1 / aspect - row)}
    return {f"scene.camera.{key}": value for key, value in found.items()}


def described(scene, options, folder):
    """Returns the properties of the scene."""
    found = camera(scene.camera, scene.yfov, options["jobs"][0]["size"])
    for k, made in enumerate(scene.shapes):
        file = folder / f"{k}.ply"
        file.write_bytes(gltf_scene.ply(made))
        found |= material(f"material_{k}", made.surface)
        found |= {f"scene.objects.object_{k}.ply": str(file), f"scene.objects.object_{k}.material": f"material_{k}"}
    for k, made in enumerate(scene.lights):
        found |= light(f"light_{k}", made)
    if options["sky"] is not None:
        found |= {"scene.lights.sky.type": "constantinfinite", "scene.lights.sky.color": options["sky"]}
    return found


def settings(options, job):
    """Returns the properties of a render: a box filter, one thread, no clamping or adaptive sampling."""
    segments = options["depth"] + 1
    found = {"renderengine.type": options["engine"], "renderengine.seed": job["seed"], "native.threads.count": 1,
             "sampler.type": options["sampler"], "sampler.sobol.adaptive.strength": 0,
             "sampler.random.adaptive.strength": 0, "batch.haltspp": job["spp"], "film.width": job["size"][0],
             "film.height": job["size"][1], "film.filter.type": "NONE",  # the samples of a pixel count for it alone
             "film.imagepipelines.0.0.type": "NOP", "film.outputs.0.type": "RGB", "film.outputs.0.filename": "rgb.exr",
             "path.clamping.variance.maxvalue": 0, "light.maxdepth": segments, "path.maxdepth": segments}
    return found | {f"path.pathdepth.{kind}": segments for kind in ("total", "diffuse", "glossy", "specular")}


def properties(values):
    made = pyluxcore.Properties()
    for key, value in values.items():
        is_list = isinstance(value, (list, tuple, numpy.ndarray))
        made.Set(pyluxcore.Property(key, [float(v) for v in value] if is_list else [value]))
    return made


def render(scene, options, job):
    """Returns the image and the CPU seconds."""
    session = pyluxcore.RenderSession(pyluxcore.RenderConfig(properties(settings(options, job)), scene))
    before = time.process_time()
    session.Start()
    while not session.HasDone():
        time.sleep(0.002)
        session.UpdateStats()
    session.Stop()
    spent = time.process_time() - before
    width, height = job["size"]
    buffer = array.array("f", bytes(4 * 3 * width * height))
    session.GetFilm().GetOutputFloat(pyluxcore.FilmOutputType.RGB, buffer)
    return numpy.array(buffer).reshape(height, width, 3)[::-1], spent


def main():
    path, options = sys.argv[sys.argv.index("--") + 1 :]
    options = json.loads(pathlib.Path(options).read_text())
    pyluxcore.Init(lambda message: None)
    with tempfile.TemporaryDirectory() as folder:
        scene = pyluxcore.Scene()
        read = gltf_scene.read(pathlib.Path(path).read_bytes())
        scene.Parse(properties(described(read, options, pathlib.Path(folder))))
        for job in options["jobs"]:
            image, spent = render(scene, options, job)
            numpy.save(job["out"], image)
            print("JOB", spent, flush=True)


main()
