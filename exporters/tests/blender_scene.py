"""A small scene for the tests of the Blender exporter, with what can go wrong in it. Needs the bpy module."""

from __future__ import annotations

import math
from typing import Any

import bpy
import numpy as np

SIZE = (48, 27)
HAS_USE_NODES = bpy.app.version < (5, 0)


def build(size: tuple[int, int] = SIZE) -> Any:
    """Replaces the open file by the scene; returns it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.cycles.samples, scene.cycles.max_bounces = 4, 2
    scene.cycles.use_denoising = True
    _world(scene)
    _objects(scene)
    _camera(scene)
    _traps(scene)
    bpy.context.view_layer.update()
    return scene


def material(name: str, *kinds: str) -> tuple[Any, list[Any]]:
    """A material of nodes of these kinds, the first of them its surface; returns it and its nodes."""
    made = bpy.data.materials.new(name)
    if HAS_USE_NODES:
        made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    nodes = [tree.nodes.new(kind) for kind in kinds]
    tree.links.new(nodes[0].outputs[0], output.inputs["Surface"])
    return made, nodes


def _world(scene: Any) -> None:
    scene.world = bpy.data.worlds.new("world")
    if HAS_USE_NODES:
        scene.world.use_nodes = True
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.rotation_euler = (0.6, 0.3, 0.0)
    scene.collection.objects.link(sun)


def _add(operator: Any, made: Any, **options: Any) -> Any:
    operator(**options)
    ob = bpy.context.object
    if made:
        ob.data.materials.append(made)
    return ob


def _objects(scene: Any) -> None:
    add = bpy.ops.mesh
    gray, _ = material("gray", "ShaderNodeBsdfDiffuse")
    glass, _ = material("glass", "ShaderNodeBsdfGlass")
    lamp, (emission,) = material("lamp", "ShaderNodeEmission")
    emission.inputs["Strength"].default_value = 40.0
    tinted, (clear,) = material("tinted", "ShaderNodeBsdfTransparent")
    clear.inputs["Color"].default_value = (0.9, 0.2, 0.1, 1.0)
    _add(add.primitive_plane_add, gray, size=10, location=(0, 5, 0)).name = "floor"
    _add(add.primitive_plane_add, tinted, size=0.5, location=(0.7, 2, 0.6), rotation=(math.pi / 2, 0, 0))
    _add(add.primitive_uv_sphere_add, glass, radius=0.3, location=(0.2, 2.5, 0.3), segments=16, ring_count=8)
    _add(add.primitive_uv_sphere_add, lamp, radius=0.04, location=(-0.5, 6, 1), segments=8, ring_count=4)
    mirrored = _add(add.primitive_uv_sphere_add, gray, radius=0.4, location=(-0.8, 3, 0.4), segments=16, ring_count=8)
    mirrored.name, mirrored.scale = "ball", (-1, 1, 1)
    _add(add.primitive_cube_add, None, size=0.4, location=(1.2, 4, 0.2)).name = "bare"
    curve = bpy.data.curves.new("text", "FONT")
    curve.body, curve.extrude = "A", 0.1
    curve.materials.append(gray)
    text = bpy.data.objects.new("text", curve)
    text.location, text.rotation_euler = (-0.2, 4, 0.2), (math.pi / 2, 0, 0)
    scene.collection.objects.link(text)
    _cube_and_sheet(scene, gray)


def _cube_and_sheet(scene: Any, made: Any) -> None:
    """One mesh of a closed piece and an open one."""
    corners = [(x, y, z) for x in (0, 0.3) for y in (0, 0.3) for z in (0, 0.3)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3), (8, 9, 10, 11)]
    sheet = [(0.5, 0, 0), (1, 0, 0), (1, 0, 0.5), (0.5, 0, 0.5)]
    mesh = bpy.data.meshes.new("cube and sheet")
    mesh.from_pydata(corners + sheet, [], faces)
    mesh.materials.append(made)
    ob = bpy.data.objects.new("cube and sheet", mesh)
    ob.location = (-1.5, 3.5, 0.1)
    scene.collection.objects.link(ob)


def _camera(scene: Any) -> None:
    data = bpy.data.cameras.new("camera")
    data.lens = 35
    data.dof.use_dof = True
    data.dof.focus_object = bpy.data.objects["ball"]
    data.dof.aperture_fstop = 0.5
    # An animated property is set again by every render.
    data.shift_x = 0.02
    data.keyframe_insert("shift_x", frame=1)
    camera = bpy.data.objects.new("camera", data)
    camera.location, camera.rotation_euler = (0, -0.5, 0.8), (math.radians(86), 0, 0)
    scene.collection.objects.link(camera)
    scene.camera = camera


def _traps(scene: Any) -> None:
    """Settings that an export turns off, and must turn on again."""
    render = scene.render
    render.use_motion_blur = render.use_border = render.use_persistent_data = render.use_freestyle = True
    render.use_multiview = True
    render.filepath = "/nowhere/frame_"
    render.image_settings.file_format = "PNG"
    render.image_settings.color_depth = "16"
    if HAS_USE_NODES:
        scene.use_nodes = True
        flat = bpy.data.materials.new("flat")
        flat.use_nodes = False
        bpy.data.objects["bare"].data.materials.append(flat)
        bpy.data.objects["bare"].data.materials.append(None)
    marker = scene.timeline_markers.new("cut", frame=1)
    marker.camera = scene.camera
    other = scene.view_layers.new("other")
    other.use_pass_mist = True
    scene.view_layers[0].use_pass_normal = True
    scene.view_layers[0].material_override = bpy.data.materials["gray"]
    image = bpy.data.images.new("pattern", 4, 4)
    image.pixels.foreach_set(np.ones(64, np.float32))
