# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""What a surface of Cycles is in the channels of `thinlens_stack.shading`: colour, normal, reflected distance.

It has passes for the first two. For the third, materials become mirrors that show the length of the mirrored ray.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np

from .journal import Journal
from .passes import Job, Passes, Renderer
from .shared import ExportError
from .shared import shading as names

# Settings of Cycles that would change the measured length of a ray.
EXACT = {
    "glossy_bounces": 1,
    "sample_clamp_direct": 0.0,
    "sample_clamp_indirect": 0.0,
    "use_fast_gi": False,
}


def diffuse(passes: Passes) -> np.ndarray:
    """The light of a render but what its surfaces reflect specularly, `[height][width][3]`."""
    return passes.vector("Combined", "RGB") - passes.glossy()


def channels(colors: np.ndarray, normals: np.ndarray, inverse: np.ndarray) -> tuple[dict, dict]:
    """Planes of a layer that are summed, and planes that are averaged, when samples are merged."""
    sums = {name: colors[..., k] for k, name in enumerate(names.DIFFUSE)}
    means = {name: normals[..., k] for k, name in enumerate(names.NORMAL)}
    return sums, {**means, names.DISTANCE: inverse}


def of_background(colors: np.ndarray) -> tuple[dict, dict]:
    """The channels of the world, which reflects nothing."""
    return channels(colors, np.zeros_like(colors), np.zeros(colors.shape[:2], np.float32))


class Shading:
    """Measures normals and reflected distances of what the camera sees. The journal restores what it changes."""

    def __init__(self, scene: Any, layer: Any, surfaces: Sequence[tuple[Any, Any]], camera: Any, journal: Journal):
        """`surfaces` are node trees of materials with the input that their surface is linked to."""
        self.scene, self.layer = scene, layer
        # Right, up and back of the camera, in columns.
        self.axes = np.array(camera.matrix_world.normalized().to_3x3(), np.float32)
        self._lamps = [ob for ob in bpy.data.objects if ob.type == "LIGHT" and not ob.hide_render]
        # Undoes the change to mirrors.
        self._changes: Journal | None = None
        group = _mirror(journal)
        self._surfaces = [_Surface(tree, target, group, journal) for tree, target in surfaces]
        # Before the mirrors are removed.
        journal.on_restore(self._show_surfaces)

    def normals(self, passes: Passes) -> np.ndarray:
        """Normals of a render with them, in the camera's axes, `[height][width][3]`."""
        return passes.vector("Normal", "XYZ") @ self.axes

    def inverse_distances(self, renderer: Renderer, name: str) -> np.ndarray:
        """1/distance to what each visible surface reflects, `[height][width]`; 0 where that is nothing."""
        self._show_mirrors()
        length = renderer.render(Job(f"reflections of {name}", bounces=1)).channel("Combined.R")
        self._show_surfaces()
        return np.where(length > 0.0, 1.0 / np.where(length > 0.0, length, 1.0), 0.0).astype(np.float32)

    def _show_surfaces(self) -> None:
        changes, self._changes = self._changes or Journal(), None
        if failures := changes.restore():
            raise ExportError("the materials could not be restored", found="; ".join(failures))

    def _show_mirrors(self) -> None:
        self._changes = Journal()
        for surface in self._surfaces:
            surface.show_mirror(self._changes)
        # Mirrors must show nothing but the length.
        for lamp in self._lamps:
            self._changes.set(lamp, "hide_render", True)
        self._changes.set(self.layer, "world_override", None)
        self._changes.set(self.scene, "world", None)
        for name, value in EXACT.items():
            self._changes.set(self.scene.cycles, name, value)


class _Surface:
    """The surface of a material, with a mirror that can take its place."""

    def __init__(self, tree: Any, target: Any, group: Any, journal: Journal) -> None:
        self.tree, self.target = tree, target
        self.node = tree.nodes.new("ShaderNodeGroup")
        journal.on_restore(lambda: tree.nodes.remove(self.node))
        self.node.node_tree = group

    def show_mirror(self, changes: Journal) -> None:
        """Links the mirror."""
        source = self.target.links[0].from_socket if self.target.is_linked else None
        changes.on_restore(lambda: self._link(source))
        self.tree.links.new(self.node.outputs[0], self.target)

    def _link(self, source: Any) -> None:
        if source:
            self.tree.links.new(source, self.target)
        else:
            self.tree.links.remove(self.target.links[0])


def _mirror(journal: Journal) -> Any:
    """A node group whose shader is a mirror to the camera, and to what that mirrors shines with the ray's length."""
    groups = bpy.data.node_groups
    group = journal.made(groups, groups.new("thinlens mirror", "ShaderNodeTree"))
    group.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    kinds = ("LightPath", "Emission", "BsdfGlossy", "MixShader")
    path, shine, mirror, mix = (group.nodes.new(f"ShaderNode{kind}") for kind in kinds)
    mirror.inputs["Color"].default_value = shine.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    mirror.inputs["Roughness"].default_value = 0.0
    output = group.nodes.new("NodeGroupOutput")
    for source, target in (
        (path.outputs["Ray Length"], shine.inputs["Strength"]),
        (path.outputs["Is Camera Ray"], mix.inputs[0]),
        (shine.outputs[0], mix.inputs[1]),
        (mirror.outputs[0], mix.inputs[2]),
        (mix.outputs[0], output.inputs[0]),
    ):
        group.links.new(source, target)
    return group
