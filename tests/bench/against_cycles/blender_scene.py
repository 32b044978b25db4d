"""Renders a glTF scene by Cycles, with the meaning that glTF specifies.

    PYTHON blender_scene.py -- SCENE OPTIONS.json                 PYTHON has the module bpy
    blender -b --factory-startup -noaudio -P blender_scene.py -- SCENE OPTIONS.json

OPTIONS.json: {"depth": scattering events, "sky": null, a latitude-longitude image or [r, g, b],
"guiding": bool, "jobs": [{"out": FILE.exr, "spp", "seed", "size": [w, h], "denoise": bool, "threshold": noise
threshold of adaptive sampling with at most "spp" samples}]}.
The importer and the defaults of Cycles differ from the specification in some points; each function below
corrects one of them, in Blender 3.4 and 4.5. Corrected are only features of the compared scenes: punctual
lights, Lambert surfaces (specularFactor 0), emitters, smooth solid glass, Beer's law, alphaMode MASK, and the
thin lens of TESSERA_camera (fNumber, sensorHeight, focusDistance).
Prints a line JOB with the CPU seconds of the process for each job; they include synchronising the scene.
"""

import json
import math
import os
import struct
import sys
import time

import numpy

for old in (bool, object, int, float):  # Blender 3.4 uses names that numpy has removed
    setattr(numpy, old.__name__, old)

import bpy  # noqa: E402

IS_NEW = bpy.app.version >= (4, 0)
EMISSION = "Emission Color" if IS_NEW else "Emission"

def put(thing, name, value):
    """Sets a property that this version may not have."""
    if hasattr(thing, name):
        setattr(thing, name, value)


def gltf_of(path):
    """Returns the JSON of a .gltf or .glb."""
    data = open(path, "rb").read()
    if data[:4] != b"glTF":
        return json.loads(data)
    (length,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + length])


def mend_lights(gltf):
    """Makes punctual lights have no size, and intensity 1 where the file gives none."""
    lights = gltf.get("extensions", {}).get("KHR_lights_punctual", {}).get("lights", [])
    silent = {g.get("name") for g in lights if "intensity" not in g}
    for light in bpy.data.lights:
        light.shadow_soft_size = 0
        put(light, "use_soft_falloff", False)
        light.cycles.max_bounces = 1024
        light.cycles.use_multiple_importance_sampling = False
        if light.type == "SUN":
            light.angle = 0
        if light.name in silent:
            light.energy = 1 if light.type == "SUN" else 4 * math.pi


def mend_meshes():
    """Turns off the shadow terminator offsets of Cycles, which move rays off the triangles."""
    for thing in bpy.data.objects:
        if thing.type == "MESH":
            for owner in (thing, thing.cycles):  # where they are depends on the version
                for name in ("geometry", "normal", "shading"):
                    put(owner, f"shadow_terminator_{name}_offset", 0)
                put(owner, "shadow_terminator_offset", 0)


class Material:
    """A Blender material with the glTF material it was imported from."""

    def __init__(self, blender, gltf):
        self.blender = blender
        self.gltf = gltf
        self.tree = blender.node_tree
        self.principled = next((n for n in self.tree.nodes if n.type == "BSDF_PRINCIPLED"), None)
        self.output = next(n for n in self.tree.nodes if n.type == "OUTPUT_MATERIAL")

    def extension(self, name):
        return self.gltf.get("extensions", {}).get("KHR_materials_" + name, {})

    def node(self, kind, **inputs):
        made = self.tree.nodes.new(kind)
        for name, value in inputs.items():
            made.inputs[name].default_value = value
        return made

    def link(self, source, target):
        self.tree.links.new(target, source)

    def pass_color(self, socket):
        base = self.principled.inputs["Base Color"]
        if base.is_linked:
            self.link(base.links[0].from_socket, socket)
        else:
            socket.default_value = base.default_value

    def mend(self):
        if not IS_NEW:
            self.mend_mixes()
        if self.principled is None:
            return
        # Both compensate for multiple scattering by energy, unlike the random walk of 3.4.
        self.principled.distribution = "MULTI_GGX" if IS_NEW else "GGX"
        self.mend_mask()
        self.mend_absorption()
        factors = self.gltf.get("pbrMetallicRoughness", {})
        plain = factors.get("metallicFactor", 1) == 0 and "metallicRoughnessTexture" not in factors
        if self.extension("specular").get("specularFactor", 1) == 0 and IS_NEW:
            self.principled.inputs["Specular IOR Level"].default_value = 0
        if plain and self.extension("transmission").get("transmissionFactor", 0) == 1:
            if factors.get("roughnessFactor", 1) == 0 and self.extension("volume").get("thicknessFactor", 0) > 0:
                self.put(self.solid_glass())
        elif plain and self.extension("specular").get("specularFactor", 1) == 0:
            self.put(self.lambert())
        elif self.emits():
            self.put(self.principled.outputs[0])

    def mend_mixes(self):
        """Corrects the importer of 3.4, which connects the scalar output of a colour mix."""
        for node in self.tree.nodes:
            if node.type == "MIX" and node.data_type == "RGBA":
                for link in list(node.outputs[0].links):
                    target = link.to_socket
                    self.tree.links.remove(link)
                    self.link(node.outputs[2], target)

    def mend_mask(self):
        """alphaMode MASK: makes alpha 0 or 1 instead of blending."""
        alpha = self.principled.inputs["Alpha"]
        if self.gltf.get("alphaMode") != "MASK" or not alpha.is_linked:
            return
        step = self.tree.nodes.new("ShaderNodeMath")
        step.operation = "GREATER_THAN"
        step.inputs[1].default_value = self.gltf.get("alphaCutoff", 0.5) - 1e-6
        self.link(alpha.links[0].from_socket, step.inputs[0])
        self.link(step.outputs[0], alpha)

    def mend_absorption(self):
        """Sets the absorption coefficient: sigma = -ln(colour) / distance."""
        volume = self.extension("volume")
        distance = volume.get("attenuationDistance", math.inf)
        sigma = [-math.log(max(c, 1e-6)) / distance for c in volume.get("attenuationColor", [1, 1, 1])]
        most = max(sigma)
        for node in self.tree.nodes:
            if node.type in ("VOLUME_ABSORPTION", "PRINCIPLED_VOLUME"):
                node.inputs["Density"].default_value = most
                node.inputs["Color"].default_value = [1 - s / (most or 1) for s in sigma] + [1]

    def emits(self):
        emission, strength = (self.principled.inputs[name] for name in (EMISSION, "Emission Strength"))
        is_dark = not strength.is_linked and strength.default_value == 0
        return not is_dark and (emission.is_linked or max(emission.default_value[:3]) > 0)

    def emission(self):
        """Returns the light of the surface, from the front only if it is single-sided; Cycles emits from both sides.

        The light tree of Cycles weights lamps by the strength of an emission node. It reads it through a mixture of
        shaders, but not if the strength is computed by other nodes: then it takes 1.
        """
        light = self.tree.nodes.new("ShaderNodeEmission")
        for name, target in ((EMISSION, "Color"), ("Emission Strength", "Strength")):
            source = self.principled.inputs[name]
            if source.is_linked:
                self.link(source.links[0].from_socket, light.inputs[target])
            else:
                light.inputs[target].default_value = source.default_value
        if self.gltf.get("doubleSided"):
            return light.outputs[0]
        put(self.blender.cycles, "emission_sampling", "FRONT")
        facing = self.tree.nodes.new("ShaderNodeNewGeometry")
        mix = self.tree.nodes.new("ShaderNodeMixShader")
        self.link(facing.outputs["Backfacing"], mix.inputs[0])
        self.link(light.outputs[0], mix.inputs[1])
        return mix.outputs[0]

    def lambert(self):
        """Removes the specular layer of Principled, which ignores specularFactor in 3.4."""
        diffuse = self.node("ShaderNodeBsdfDiffuse", Roughness=0)
        self.pass_color(diffuse.inputs["Color"])
        normal = self.principled.inputs["Normal"]
        if normal.is_linked:
            self.link(normal.links[0].from_socket, diffuse.inputs["Normal"])
        alpha = self.principled.inputs["Alpha"]
        if not alpha.is_linked and alpha.default_value == 1:
            return diffuse.outputs[0]
        through = self.tree.nodes.new("ShaderNodeBsdfTransparent")
        mix = self.tree.nodes.new("ShaderNodeMixShader")
        if alpha.is_linked:
            self.link(alpha.links[0].from_socket, mix.inputs[0])
        else:
            mix.inputs[0].default_value = alpha.default_value
        self.link(through.outputs[0], mix.inputs[1])
        self.link(diffuse.outputs[0], mix.inputs[2])
        return mix.outputs[0]

    def solid_glass(self):
        """Smooth glass: untinted reflection with the exact Fresnel term."""
        ior = self.extension("ior").get("ior", 1.5)
        mirror = self.node("ShaderNodeBsdfGlossy", Roughness=0, Color=(1, 1, 1, 1))
        through = self.node("ShaderNodeBsdfRefraction", Roughness=0, IOR=ior)
        mirror.distribution = through.distribution = "GGX" if IS_NEW else "SHARP"
        self.pass_color(through.inputs["Color"])
        fresnel = self.node("ShaderNodeFresnel", IOR=ior)
        mix = self.tree.nodes.new("ShaderNodeMixShader")
        self.link(fresnel.outputs[0], mix.inputs[0])
        self.link(through.outputs[0], mix.inputs[1])
        self.link(mirror.outputs[0], mix.inputs[2])
        return mix.outputs[0]

    def put(self, shader):
        """Replaces the surface by the given shader and the emission of Principled."""
        if self.emits():
            both = self.tree.nodes.new("ShaderNodeAddShader")
            self.link(shader, both.inputs[0])
            self.link(self.emission(), both.inputs[1])
            shader = both.outputs[0]
            strength = self.principled.inputs["Emission Strength"]
            for link in list(strength.links):
                self.tree.links.remove(link)
            strength.default_value = 0
        self.link(shader, self.output.inputs["Surface"])


def mend_materials(gltf):
    by_name = {g.get("name", f"Material_{i}"): g for i, g in enumerate(gltf.get("materials", []))}
    for material in bpy.data.materials:
        known = by_name.get(material.name) or by_name.get(material.name.rsplit(".", 1)[0])
        if material.use_nodes and known is not None:
            Material(material, known).mend()


def decode_textures():
    """Decodes sRGB before filtering, as glTF specifies; Cycles filters encoded values."""
    for image in list(bpy.data.images):
        if image.type != "IMAGE" or not image.size[0]:
            continue
        image.alpha_mode = "CHANNEL_PACKED"
        if image.colorspace_settings.name != "sRGB" or image.is_float:
            continue
        width, height = image.size
        pixels = numpy.empty(width * height * 4, numpy.float32)
        image.pixels.foreach_get(pixels)
        color = pixels.reshape(-1, 4)[:, :3]
        color[:] = numpy.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
        linear = bpy.data.images.new(image.name + " linear", width, height, alpha=True,
                                     float_buffer=True, is_data=True)
        linear.pixels.foreach_set(pixels)
        linear.alpha_mode = "CHANNEL_PACKED"
        linear.update()
        linear.pack()
        for material in bpy.data.materials:
            for node in material.node_tree.nodes if material.use_nodes else []:
                if node.type == "TEX_IMAGE" and node.image == image:
                    node.image = linear


def frame_everything(width, height):
    """Tessera's camera for scenes without one: box centre c, half diagonal r, 40 degrees,
    eye c + r / sin(20 degrees) towards (0.5, 0.35, 1)."""
    from mathutils import Matrix, Vector

    corners = []
    graph = bpy.context.evaluated_depsgraph_get()
    for thing in bpy.context.scene.objects:
        if thing.type == "MESH":
            mesh = thing.evaluated_get(graph).data
            points = numpy.empty(len(mesh.vertices) * 3, numpy.float32)
            mesh.vertices.foreach_get("co", points)
            world = numpy.array(thing.matrix_world)
            points = points.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3]
            corners += [points.min(0), points.max(0)]
    low, high = numpy.min(corners, 0), numpy.max(corners, 0)
    angle = math.radians(40)
    half = angle / 2 if width >= height else math.atan(math.tan(angle / 2) * width / height)
    towards = Vector((0.5, -1.0, 0.35)).normalized()  # Blender's axes: x, -z, y of glTF
    eye = Vector((low + high) / 2) + towards * (numpy.linalg.norm(high - low) / 2 / math.sin(half))
    right = (-towards).cross(Vector((0, 0, 1))).normalized()
    up = right.cross(-towards)
    camera = bpy.data.objects.new("all", bpy.data.cameras.new("all"))
    bpy.context.scene.collection.objects.link(camera)
    camera.matrix_world = Matrix([(*row, e) for row, e in zip(zip(right, up, towards), eye)] + [(0, 0, 0, 1)])
    camera.data.sensor_fit = "VERTICAL"
    camera.data.angle_y = angle
    camera.data.clip_start, camera.data.clip_end = 1e-3, 1e6
    return camera


def set_lens(camera, gltf):
    """Sets the thin lens of the first camera, or a pinhole."""
    camera.data.dof.use_dof = False
    core = gltf.get("cameras", [{}])[0]
    lens = core.get("extensions", {}).get("TESSERA_camera", {}).get("lens")
    if lens is None:
        return
    focal_length = lens.get("sensorHeight", 0.024) / (2 * math.tan(core["perspective"]["yfov"] / 2))
    radius = focal_length / (2 * lens["fNumber"])
    camera.data.dof.use_dof = True
    camera.data.dof.focus_distance = lens["focusDistance"]
    camera.data.dof.aperture_blades = 0
    camera.data.dof.aperture_fstop = camera.data.lens * 1e-3 / (2 * radius)


def set_sky(sky):
    """Sets no sky, an image, or a constant radiance."""
    world = bpy.data.worlds.new("sky")
    bpy.context.scene.world = world
    world.use_nodes = True
    world.cycles.max_bounces = 1024
    nodes = world.node_tree.nodes
    background = nodes["Background"]
    background.inputs["Color"].default_value = (0, 0, 0, 1)
    if isinstance(sky, list):
        background.inputs["Color"].default_value = (*sky, 1)
    elif sky is not None:
        image = bpy.data.images.load(os.path.abspath(sky))
        image.colorspace_settings.name = "Linear Rec.709" if IS_NEW else "Linear"
        texture = nodes.new("ShaderNodeTexEnvironment")
        texture.image = image
        world.node_tree.links.new(texture.outputs["Color"], background.inputs["Color"])
        world.cycles.sampling_method = "MANUAL"
        world.cycles.sample_map_resolution = 2048


def set_sampling(depth):
    """Independent pixels with a box filter: no clamping."""
    scene = bpy.context.scene
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    bounces = depth - 1  # Cycles counts them after the first scattering
    settings = dict(
        device="CPU", use_animated_seed=False, time_limit=0,
        pixel_filter_type="BOX", filter_width=1, sample_clamp_direct=0, sample_clamp_indirect=0,
        blur_glossy=0, light_sampling_threshold=0, use_light_tree=True, caustics_reflective=True,
        caustics_refractive=True, max_bounces=bounces, diffuse_bounces=bounces, glossy_bounces=bounces,
        transmission_bounces=bounces, volume_bounces=bounces, transparent_max_bounces=128,
        min_light_bounces=0, min_transparent_bounces=0, use_auto_tile=False, film_exposure=1)
    if IS_NEW:  # Debian's 3.4 has no denoiser
        settings |= dict(
            denoiser="OPENIMAGEDENOISE", denoising_input_passes="RGB_ALBEDO_NORMAL",
            denoising_prefilter="ACCURATE", denoising_quality="HIGH", denoising_use_gpu=False)
    for name, value in settings.items():
        put(cycles, name, value)
    settings = dict(
        resolution_percentage=100, threads_mode="FIXED", threads=1, film_transparent=False,
        use_compositing=False, use_sequencer=False, dither_intensity=0, use_motion_blur=False,
        use_simplify=False, use_persistent_data=False)
    for name, value in settings.items():
        setattr(render, name, value)
    image = render.image_settings
    image.file_format, image.color_mode, image.color_depth = "OPEN_EXR", "RGB", "32"
    scene.view_settings.view_transform = "Standard"


def render_job(job, guiding):
    """Renders one image and returns the CPU seconds."""
    scene = bpy.context.scene
    scene.cycles.samples, scene.cycles.seed = job["spp"], job["seed"]
    scene.cycles.use_denoising = job.get("denoise", False)
    put(scene.cycles, "use_guiding", guiding)
    scene.cycles.use_adaptive_sampling = "threshold" in job
    scene.cycles.adaptive_threshold = job.get("threshold", 0)
    scene.render.resolution_x, scene.render.resolution_y = job["size"]
    before = time.process_time()
    bpy.ops.render.render(write_still=False)
    spent = time.process_time() - before
    bpy.data.images["Render Result"].save_render(os.path.abspath(job["out"]))
    return spent


def main():
    path, options = sys.argv[sys.argv.index("--") + 1 :]
    with open(options) as file:
        options = json.load(file)
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    lighting = "export_import_convert_lighting_mode" if IS_NEW else "convert_lighting_mode"
    bpy.ops.import_scene.gltf(filepath=os.path.abspath(path), **{lighting: "COMPAT"})
    gltf = gltf_of(path)
    mend_lights(gltf)
    mend_meshes()
    mend_materials(gltf)
    decode_textures()
    bpy.context.view_layer.update()
    cameras = [thing for thing in bpy.context.scene.objects if thing.type == "CAMERA"]
    camera = cameras[0] if cameras else frame_everything(*options["jobs"][0]["size"])
    set_lens(camera, gltf)
    bpy.context.scene.camera = camera
    set_sky(options["sky"])
    set_sampling(options["depth"])
    print("START_UP", time.process_time(), flush=True)
    for job in options["jobs"]:
        print("JOB", render_job(job, options.get("guiding", False)), flush=True)


main()
