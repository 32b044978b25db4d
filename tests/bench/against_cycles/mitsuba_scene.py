"""Renders a glTF scene by Mitsuba 3.

    PYTHON mitsuba_scene.py -- SCENE OPTIONS.json        PYTHON has the module mitsuba

OPTIONS.json is that of blender_scene.py, with "variant", for example "scalar_rgb". "sky" is null or [r, g, b].
Prints a line JOB with the CPU seconds of the process for each job, without loading and compiling.
"""

import json
import pathlib
import sys
import tempfile
import time

import mitsuba
import numpy

import gltf_scene


def rgb(values):
    return {"type": "rgb", "value": list(map(float, values))}


def bsdf(surface):
    if surface.kind == "glass":
        return {"type": "dielectric", "int_ior": surface.ior, "ext_ior": 1.0}
    if surface.kind == "metal":  # Schlick's Fresnel term, as in glTF
        inner = {"type": "principled", "base_color": rgb(surface.color), "metallic": 1.0,
                 "roughness": surface.roughness}
    else:
        inner = {"type": "diffuse", "reflectance": rgb(surface.color)}
    return {"type": "twosided", "bsdf": inner}


def absorbing(surface):
    """Returns a medium without scattering."""
    largest = max(surface.absorption)
    return {"type": "homogeneous", "albedo": 0.0, "scale": largest,
            "sigma_t": rgb(a / largest for a in surface.absorption)}


def shape(made, file):
    found = {"type": "ply", "filename": str(file), "bsdf": bsdf(made.surface)}
    if max(made.surface.emission) > 0:
        found["emitter"] = {"type": "area", "radiance": rgb(made.surface.emission)}
    if max(made.surface.absorption) > 0:
        found["interior"] = absorbing(made.surface)
    return found


def light(made):
    if made.kind == "point":
        return {"type": "point", "position": made.position.tolist(), "intensity": rgb(made.color)}
    return {"type": "directional", "direction": made.direction.tolist(), "irradiance": rgb(made.color)}


def sensor(scene, size, sampler):
    to_world = scene.camera @ numpy.diag([-1.0, 1.0, -1.0, 1.0])  # Mitsuba looks along +z, with +x to the left
    return {"type": "perspective", "fov_axis": "y", "fov": float(numpy.degrees(scene.yfov)), "near_clip": 1e-3,
            "far_clip": 1e4, "to_world": mitsuba.ScalarTransform4f(to_world), "sampler": {"type": sampler},
            "film": {"type": "hdrfilm", "width": size[0], "height": size[1], "pixel_format": "rgb",
                     "component_format": "float32", "rfilter": {"type": "box"}}}


def described(scene, options, folder):
    """Returns the scene for mitsuba.load_dict."""
    has_media = any(max(made.surface.absorption) > 0 for made in scene.shapes)
    found = {"type": "scene", "integrator": {"type": "volpath" if has_media else "path",
                                             "max_depth": options["depth"] + 1}}  # it counts segments
    for k, made in enumerate(scene.shapes):
        file = folder / f"{k}.ply"
        file.write_bytes(gltf_scene.ply(made))
        found[f"shape_{k}"] = shape(made, file)
    for k, made in enumerate(scene.lights):
        found[f"light_{k}"] = light(made)
    if options["sky"] is not None:
        found["sky"] = {"type": "constant", "radiance": rgb(options["sky"])}
    return found


def main():
    path, options = sys.argv[sys.argv.index("--") + 1 :]
    options = json.loads(pathlib.Path(options).read_text())
    mitsuba.set_variant(options["variant"])
    mitsuba.set_log_level(mitsuba.LogLevel.Warn)
    import drjit

    drjit.set_thread_count(1)
    scene = gltf_scene.read(pathlib.Path(path).read_bytes())
    with tempfile.TemporaryDirectory() as folder:
        loaded = mitsuba.load_dict(described(scene, options, pathlib.Path(folder)))
    warm = set()
    for job in options["jobs"]:
        eye = mitsuba.load_dict(sensor(scene, job["size"], options["sampler"]))

        def render(seed):
            return numpy.array(mitsuba.render(loaded, sensor=eye, spp=job["spp"], seed=seed))

        if (job["spp"], *job["size"]) not in warm and options["variant"].startswith("llvm"):
            render(0)  # compiles
            warm.add((job["spp"], *job["size"]))
        before = time.process_time()
        image = render(job["seed"])
        spent = time.process_time() - before
        numpy.save(job["out"], image)
        print("JOB", spent, flush=True)


main()
