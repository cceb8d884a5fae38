"""Makes the fixtures of tests/cycles.rs: two small lights before and behind focus, as Cycles' own lens shows them.

Made with Blender 5.0.1 as a Python module (`pip install bpy==5.0.1`); takes about four minutes of CPU time:

    python render.py FOLDER

`stack.exr` is a pinhole render as two depth peels, a view layer each, one sample at each pixel's centre: both lights and the
black wall behind them, then the wall alone. The other files are the same scene through apertures of Cycles (see CASES), each pixel
the mean of SAMPLES samples over its area. Lights and lens are chosen so that the blur has a radius of 12 pixels, at either side.
"""

import sys
from pathlib import Path

import bpy

WIDTH, HEIGHT = 128, 64
FOCAL_LENGTH_MM, SENSOR_WIDTH_MM, F_NUMBER, FOCUS_DISTANCE = 100.0, 36.0, 0.75, 1.0
# Pixels that a light's middle is from the left and from the top, its distance, and how many pixels wide it is.
LIGHTS = [((32.5, 32.5), 2.0 / 3.0, 3), ((95.5, 32.5), 2.0, 3)]
RADIANCE = 64.0
WALL_DISTANCE = 2.1
SAMPLES = 16384

# Name of the file: Cycles' aperture_blades, aperture_rotation in degrees, aperture_ratio.
CASES = {
    "blades3": (3, 0.0, 1.0),
    "blades3_rotation20": (3, 20.0, 1.0),
    "blades5_rotation20": (5, 20.0, 1.0),
    "blades6_rotation20": (6, 20.0, 1.0),
    "ratio2": (0, 0.0, 2.0),
    "blades3_rotation20_ratio2": (3, 20.0, 2.0),
}


def emission(name, radiance):
    """A material that shines evenly in all directions."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True  # until Blender 6, which always does
    nodes = material.node_tree.nodes
    nodes.clear()
    shader = nodes.new("ShaderNodeEmission")
    shader.inputs["Strength"].default_value = radiance
    output = nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(shader.outputs["Emission"], output.inputs["Surface"])
    return material


def quad(name, centre_px, distance, size_px, material):
    """A rectangle that faces the camera, given by what it covers in the picture."""
    units_per_px = SENSOR_WIDTH_MM / FOCAL_LENGTH_MM * distance / WIDTH
    x, y = centre_px[0] - WIDTH / 2, HEIGHT / 2 - centre_px[1]
    half_x, half_y = size_px[0] / 2, size_px[1] / 2
    corners = [(x - half_x, y - half_y), (x + half_x, y - half_y), (x + half_x, y + half_y), (x - half_x, y + half_y)]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(cx * units_per_px, cy * units_per_px, -distance) for cx, cy in corners], [], [(0, 1, 2, 3)])
    mesh.materials.append(material)
    return bpy.data.objects.new(name, mesh)


def collection(scene, name, objects):
    made = bpy.data.collections.new(name)
    scene.collection.children.link(made)
    for thing in objects:
        made.objects.link(thing)


def build():
    """The scene, seen from the origin along −z."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    light = emission("light", RADIANCE)
    lights = [quad("light", centre, distance, (size, size), light) for centre, distance, size in LIGHTS]
    wall = quad("wall", (WIDTH / 2, HEIGHT / 2), WALL_DISTANCE, (2 * WIDTH, 2 * HEIGHT), emission("black", 0.0))
    collection(scene, "lights", lights)
    collection(scene, "wall", [wall])
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.lens, camera.data.sensor_width = FOCAL_LENGTH_MM, SENSOR_WIDTH_MM
    camera.data.dof.focus_distance, camera.data.dof.aperture_fstop = FOCUS_DISTANCE, F_NUMBER
    scene.collection.objects.link(camera)
    scene.camera = camera
    settings(scene)
    return scene


def settings(scene):
    """Cycles as it is, with nothing that improves on its samples."""
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = WIDTH, HEIGHT, 100
    scene.render.use_stamp = False
    for name in dir(scene.render):
        if name.startswith("use_stamp_"):
            setattr(scene.render, name, False)
    cycles = scene.cycles
    cycles.device, cycles.use_denoising, cycles.use_adaptive_sampling = "CPU", False, False
    cycles.max_bounces, cycles.sample_clamp_direct, cycles.sample_clamp_indirect = 0, 0.0, 0.0
    scene.view_settings.view_transform = "Raw"


def render(scene, path, media, file_format):
    image = scene.render.image_settings
    image.media_type = media
    image.file_format, image.color_depth, image.exr_codec = file_format, "16", "ZIP"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def peels(scene, path):
    """The pinhole render: a view layer a peel."""
    scene.camera.data.dof.use_dof = False
    scene.cycles.samples, scene.cycles.pixel_filter_type, scene.cycles.filter_width = 1, "BLACKMAN_HARRIS", 0.01
    nearest = scene.view_layers[0]
    nearest.name, nearest.use_pass_z = "Peel0", True
    behind = scene.view_layers.new("Peel1")
    behind.use_pass_z = True
    behind.layer_collection.children["lights"].exclude = True
    render(scene, path, "MULTI_LAYER_IMAGE", "OPEN_EXR_MULTILAYER")
    scene.view_layers.remove(behind)


def truth(scene, path, blades, rotation_deg, ratio):
    """The same through Cycles' lens. Its box filter is one pixel wide."""
    dof = scene.camera.data.dof
    dof.use_dof, dof.aperture_blades, dof.aperture_ratio = True, blades, ratio
    dof.aperture_rotation = rotation_deg * 3.141592653589793 / 180.0
    scene.cycles.samples, scene.cycles.pixel_filter_type = SAMPLES, "BOX"
    scene.render.image_settings.color_mode = "RGB"
    render(scene, path, "IMAGE", "OPEN_EXR")


def main(folder):
    scene = build()
    peels(scene, folder / "stack.exr")
    for name, case in CASES.items():
        truth(scene, folder / f"{name}.exr", *case)


main(Path(sys.argv[1]).resolve())
