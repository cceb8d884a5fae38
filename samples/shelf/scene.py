"""A shelf of toys: a tin robot in focus, leaves close to the lens, beads on wires, a paper tree, lamps in the distance.

python scene.py shelf.blend                    the scene, by the bpy module
python scene.py shelf.blend a.exr b.exr        and Cycles' own pictures of it, with depth of field; their noise differs
"""

from __future__ import annotations

import math
import random
import sys
from typing import Any

import bpy
from mathutils import Vector

SIZE = (240, 135)
# Light samples of a pixel: of the stack in all, and of a picture with depth of field.
SAMPLES, REFERENCE_SAMPLES = 512, 2048
# Strength of the lamps, from which a blurred one is about as bright as white.
LAMP_STRENGTH = 12.0
# From this roughness on, materials are matt.
ROUGH = 0.5
Color = tuple[float, float, float]


def material(name: str, color: Color, roughness: float = 0.6, metallic: float = 0.0, glow: float = 0.0) -> Any:
    """A principled material; with `glow`, one that emits `color` so strongly."""
    made = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        made.use_nodes = True
    inputs = made.node_tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = (*color, 1.0)
    inputs["Roughness"].default_value, inputs["Metallic"].default_value = roughness, metallic
    # What is rough does not mirror the lamps at all: less noise.
    inputs["Specular IOR Level"].default_value = 0.5 if roughness < ROUGH else 0.0
    inputs["Emission Color"].default_value, inputs["Emission Strength"].default_value = (*color, 1.0), glow
    return made


def add(kind: str, name: str, made: Any, place: Vector | Color, scale: Color | float = 1.0, **options: Any) -> Any:
    """A primitive mesh of this name and material."""
    getattr(bpy.ops.mesh, f"primitive_{kind}_add")(location=place, **options)
    ob = bpy.context.object
    ob.name, ob.scale = name, (scale,) * 3 if isinstance(scale, float) else scale
    ob.data.materials.append(made)
    if kind != "cube":
        bpy.ops.object.shade_smooth()
    return ob


def box(name: str, made: Any, place: Color, size: Color) -> Any:
    """A box with round edges."""
    ob = add("cube", name, made, place, size, size=1.0)
    bpy.ops.object.transform_apply(location=False, rotation=False, scale=True)
    bevel = ob.modifiers.new("edges", "BEVEL")
    bevel.width, bevel.segments = 0.014, 3
    return ob


def ball(name: str, made: Any, place: Vector | Color, radius: float) -> Any:
    """A smooth ball."""
    return add("uv_sphere", name, made, place, radius=radius, segments=48, ring_count=24)


def rod(name: str, made: Any, start: Color, end: Color, radius: float) -> Any:
    """A thin cylinder from `start` to `end`."""
    start, end = Vector(start), Vector(end)
    ob = add("cylinder", name, made, (start + end) / 2, radius=radius, depth=(end - start).length, vertices=16)
    ob.rotation_euler = (end - start).to_track_quat("Z", "Y").to_euler()
    return ob


def robot() -> Any:
    """The robot; returns its head."""
    tin, red = material("tin", (0.55, 0.6, 0.62), 0.3, 1.0), material("red paint", (0.5, 0.05, 0.03), 0.4)
    eyes = material("eyes", (1.0, 0.75, 0.2), glow=1.5)
    box("body", red, (0.0, 0.0, 0.34), (0.26, 0.18, 0.28))
    head = box("head", tin, (0.0, -0.01, 0.6), (0.2, 0.17, 0.17))
    for side in (-1, 1):
        box("foot", tin, (0.07 * side, -0.02, 0.03), (0.1, 0.17, 0.06))
        rod("leg", tin, (0.07 * side, 0.0, 0.05), (0.07 * side, 0.0, 0.21), 0.03)
        rod("arm", tin, (0.13 * side, 0.0, 0.43), (0.22 * side, -0.06, 0.28), 0.022)
        ball("hand", red, (0.225 * side, -0.065, 0.265), 0.04)
        ball("eye", eyes, (0.045 * side, -0.1, 0.62), 0.022)
    rod("neck", tin, (0.0, 0.0, 0.47), (0.0, 0.0, 0.53), 0.035)
    rod("aerial", tin, (0.0, 0.0, 0.67), (0.03, 0.0, 0.8), 0.005)
    ball("knob", red, (0.03, 0.0, 0.81), 0.02)
    return head


def leaves() -> None:
    """Leaves on stalks between the camera and the robot, at both sides of the frame."""
    green = [material(f"leaf {k}", (0.04 + 0.05 * k, 0.2 + 0.07 * k, 0.04)) for k in range(3)]
    for k in range(17):
        side = -1 if k % 2 else 1
        root = Vector((side * random.uniform(0.24, 0.5), random.uniform(-1.5, -1.0), 0.0))
        lean = Vector((-side * random.uniform(0.0, 0.35), random.uniform(-0.15, 0.15), random.uniform(0.35, 0.8)))
        across = lean.cross(Vector((random.uniform(-0.4, 0.4), 1.0, random.uniform(-0.5, 0.5)))).normalized()
        width = random.uniform(0.018, 0.032)
        points, steps = [], 12
        for step in range(steps + 1):
            t = step / steps
            spine = root + lean * t + Vector((-side * 0.2 * t * t, 0.0, -0.12 * t**3))
            half = across * width * (math.sin(math.pi * min(0.97, 0.12 + 0.88 * t)) + 0.02)
            points += [spine - half, spine + half]
        mesh = bpy.data.meshes.new("leaf")
        mesh.from_pydata(points, [], [(2 * s, 2 * s + 1, 2 * s + 3, 2 * s + 2) for s in range(steps)])
        mesh.materials.append(random.choice(green))
        bpy.context.collection.objects.link(bpy.data.objects.new("leaf", mesh))


def beads() -> None:
    """Beads on three wires behind the robot."""
    wire = material("wire", (0.7, 0.65, 0.55), 0.4, 1.0)
    colors = ((0.6, 0.35, 0.05), (0.05, 0.25, 0.5), (0.45, 0.08, 0.2), (0.1, 0.35, 0.2))
    paints = [material(f"bead {k}", color, 0.2) for k, color in enumerate(colors)]
    for side in (0.32, 1.02):
        box("post", wire, (side, 0.9, 0.3), (0.04, 0.04, 0.6))
    for row in range(3):
        height = 0.16 + 0.18 * row
        rod("wire", wire, (0.32, 0.9, height), (1.02, 0.9, height), 0.006)
        for k in range(3 + row % 2):
            ball("bead", paints[(row + k) % 4], (0.44 + 0.12 * k + 0.1 * row, 0.9, height), 0.06)


def tree() -> None:
    """A paper tree of three cones."""
    paper, wood = material("paper", (0.1, 0.3, 0.22)), material("stem", (0.3, 0.16, 0.07))
    rod("stem", wood, (-0.56, 0.7, 0.0), (-0.56, 0.7, 0.2), 0.03)
    for k in range(3):
        radius = 0.2 - 0.045 * k
        add("cone", "paper", paper, (-0.56, 0.7, 0.28 + 0.15 * k), radius1=radius, depth=0.24, vertices=48)


def lamps() -> None:
    """A string of lamps far behind, and a soft light above."""
    colors = ((1.0, 0.45, 0.12), (1.0, 0.7, 0.35), (0.35, 0.6, 1.0))
    glows = [material(f"lamp {k}", color, glow=LAMP_STRENGTH) for k, color in enumerate(colors)]
    for k in range(13):
        ball("lamp", glows[k % 3], (-1.5 + 0.26 * k, 4.6, 0.75 + 0.35 * math.sin(1.7 * k)), 0.03)
    data = bpy.data.lights.new("window", "AREA")
    data.shape, data.size, data.energy, data.color = "SQUARE", 2.5, 70.0, (1.0, 0.95, 0.88)
    window = bpy.data.objects.new("window", data)
    window.location, window.rotation_euler, window.visible_camera = (-1.6, -1.2, 2.6), (0.4, -0.55, 0.0), False
    bpy.context.collection.objects.link(window)


def camera(focus: Any) -> None:
    """The camera: 60 mm, f/0.7, focused at the object `focus`."""
    data = bpy.data.cameras.new("camera")
    data.lens = 60.0
    dof = data.dof
    dof.use_dof, dof.focus_object, dof.aperture_fstop = True, focus, 0.7
    dof.aperture_blades, dof.aperture_rotation = 6, math.radians(15.0)
    ob = bpy.data.objects.new("camera", data)
    ob.location, ob.rotation_euler = (0.05, -2.4, 0.62), (math.radians(87.0), 0.0, 0.0)
    bpy.context.collection.objects.link(ob)
    bpy.context.scene.camera = ob


def build() -> Any:
    """Replaces the open file by the scene; returns it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    random.seed(7)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    cycles = scene.cycles
    cycles.samples, cycles.use_denoising, cycles.max_bounces = SAMPLES, False, 6
    # All samples, and light only where the pixel is: what a coverage peel holds.
    cycles.use_adaptive_sampling, cycles.pixel_filter_type, cycles.sample_clamp_indirect = False, "BOX", 4.0
    scene.world = bpy.data.worlds.new("dusk")
    if bpy.app.version < (5, 0):
        scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.03, 0.045, 0.09, 1.0)
    add("plane", "shelf", material("wood", (0.24, 0.13, 0.07)), (0.0, 1.5, 0.0), size=7.0)
    ball("chrome ball", material("chrome", (0.9, 0.88, 0.85), 0.12, 1.0), (-0.42, 0.12, 0.13), 0.13)
    box("block", material("blue paint", (0.06, 0.16, 0.38), 0.35), (0.4, -0.12, 0.09), (0.18, 0.18, 0.18))
    leaves()
    beads()
    tree()
    lamps()
    camera(robot())
    return scene


def render(scene: Any, path: str, seed: int) -> None:
    """Cycles' own picture, with depth of field: floats, scene-linear."""
    scene.cycles.samples, scene.cycles.seed = REFERENCE_SAMPLES, seed
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.color_depth, image.exr_codec = "OPEN_EXR", "RGB", "32", "ZIP"
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    files = [bpy.path.abspath(name) for name in sys.argv[1:]]
    made = build()
    bpy.ops.wm.save_as_mainfile(filepath=files[0])
    for number, file in enumerate(files[1:]):
        render(made, file, number)
