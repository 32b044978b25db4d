"""The renderers of the comparison: each renders a list of jobs of one scene and measures CPU seconds."""

import json
import os
import pathlib
import resource
import shutil
import subprocess
import sys

import numpy
import OpenImageIO

from scenes import SCENES, prepare

HERE = pathlib.Path(__file__).resolve().parent


def wait_for_orphans():
    """As a subreaper, this process also waits for the server and the workers of a command."""
    while True:
        try:
            os.waitpid(-1, 0)
        except ChildProcessError:
            return


def children_cpu():
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def pixels(path, prefix=""):
    """Returns the colours of an EXR or .npy file; `prefix` selects a layer, for example "raw."."""
    if path.suffix == ".npy":
        return numpy.load(path).astype(numpy.float64)
    image = OpenImageIO.ImageBuf(str(path))
    names = image.spec().channelnames
    channels = [names.index(prefix + c) for c in "RGB"]
    return image.get_pixels(OpenImageIO.FLOAT)[..., channels].astype(numpy.float64)


def save(image, path):
    """Writes colours to an EXR file."""
    height, width, channels = image.shape
    output = OpenImageIO.ImageOutput.create(str(path))
    output.open(str(path), OpenImageIO.ImageSpec(width, height, channels, "float"))
    output.write_image(numpy.ascontiguousarray(image, numpy.float32))
    output.close()


class Inputs:
    """The files that all renderers read."""

    def __init__(self, scenes, folder):
        self.scenes, self.folder = scenes, folder
        self.count = 0
        self.prepared = {}

    def file(self, ending):
        self.count += 1
        return self.folder / f"{self.count}{ending}"

    def scene(self, name):
        if name not in self.prepared:
            self.prepared[name] = prepare(self.scenes / SCENES[name].file, self.folder / name)
        return self.prepared[name]

    def sky_file(self, name):
        sky = SCENES[name].sky
        if sky is None or isinstance(sky, str):
            return sky and self.scenes / sky
        path = self.folder / ("sky_" + "_".join(map(str, sky)) + ".exr")
        if not path.exists():
            save(numpy.broadcast_to(numpy.float32(sky), (8, 16, 3)), path)
        return path


class Tessera:
    """One `tessera render` per image; counts the CPU seconds of client, server and worker."""

    def __init__(self, inputs, binaries, guiding=False):
        self.inputs, self.binaries, self.guiding = inputs, binaries, guiding

    def render(self, name, jobs):
        """Renders jobs {spp, seed, size, denoise}. Returns (image, CPU seconds) of each."""
        return [self.render_one(name, job) for job in jobs]

    def render_one(self, name, job):
        out = self.inputs.file(".exr")
        command = [self.binaries / "tessera", "render", self.inputs.scene(name), "-o", out,
                   "--spp", str(job["spp"]), "--seed", str(job["seed"]), "--size", "%dx%d" % job["size"],
                   "--max-depth", str(SCENES[name].depth), "--threads", "1"]
        sky = self.inputs.sky_file(name)
        command += ["--environment", sky] if sky else []
        command += ["--denoise"] if job.get("denoise") else []
        command += ["--guiding"] if self.guiding else []
        before = children_cpu()
        done = subprocess.run(command, capture_output=True, text=True)
        wait_for_orphans()
        if done.returncode != 0:
            sys.exit(f"against_cycles: tessera failed on {name}:\n{done.stderr[-2000:]}")
        spent = children_cpu() - before
        image = pixels(out)
        out.unlink()
        return image, spent


class Peer:
    """A script that renders all jobs of a call in one process, and prints the CPU seconds of each."""

    def __init__(self, inputs, command, ending=".exr", **options):
        self.inputs, self.command, self.ending, self.options = inputs, command, ending, options

    def render(self, name, jobs):
        sky = SCENES[name].sky
        if isinstance(sky, str):
            sky = str(self.inputs.scenes / sky)
        outs = [self.inputs.file(self.ending) for _ in jobs]
        options = self.inputs.file(".json")
        options.write_text(json.dumps({"depth": SCENES[name].depth, "sky": sky, **self.options, "jobs": [
            {**job, "out": str(out)} for job, out in zip(jobs, outs)]}))
        done = subprocess.run([*self.command, "--", self.inputs.scene(name), options], capture_output=True, text=True)
        spent = [float(line.split()[1]) for line in done.stdout.splitlines() if line.startswith("JOB ")]
        if len(spent) != len(jobs):
            sys.exit(f"against_cycles: {self.command} failed on {name}:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
        images = [pixels(out) for out in outs]
        for out in outs:
            out.unlink()
        return list(zip(images, spent))


def has_module(python, module):
    return python.exists() and subprocess.run([python, "-c", f"import {module}"], capture_output=True).returncode == 0


def peers(inputs, python):
    """Returns the peers that are installed, by name."""
    found = {}
    if has_module(python, "bpy"):
        command = [python, HERE / "blender_scene.py"]
        found["Cycles 4.5"] = Peer(inputs, command)
        found["Cycles 4.5, guided"] = Peer(inputs, command, guiding=True)
        found["Cycles 4.5, adaptive"] = Peer(inputs, command)
    if shutil.which("blender"):
        found["Cycles 3.4"] = Peer(inputs, ["blender", "-b", "--factory-startup", "-noaudio", "-P",
                                            HERE / "blender_scene.py"])
    if has_module(python, "mitsuba"):
        command = [python, HERE / "mitsuba_scene.py"]
        found["Mitsuba 3"] = Peer(inputs, command, ".npy", variant="llvm_ad_rgb", sampler="multijitter")
        found["Mitsuba 3, scalar"] = Peer(inputs, command, ".npy", variant="scalar_rgb", sampler="multijitter")
    if has_module(python, "pyluxcore"):
        command = [python, HERE / "luxcore_scene.py"]
        found["LuxCore"] = Peer(inputs, command, ".npy", engine="PATHCPU", sampler="SOBOL")
        found["LuxCore, bidirectional"] = Peer(inputs, command, ".npy", engine="BIDIRCPU", sampler="SOBOL")
    return found
