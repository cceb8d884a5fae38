# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""What a surface of Cycles is in the channels of `thinlens_stack.shading`.

It has passes for colour and normal. For the light that came from surfaces, the world is black to the surfaces that the
camera sees. For the reflected distance, materials become mirrors that show the length of the mirrored ray; for
reflectance and roughness, they shine with what `reflectance` reads from their shaders.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np

from .journal import Journal
from .passes import Job, Passes, Renderer
from .reflectance import Reader
from .settings import Say
from .shared import ExportError
from .shared import shading as names

# Settings of Cycles that would change the measured length of a ray.
EXACT = {
    "glossy_bounces": 1,
    "sample_clamp_direct": 0.0,
    "sample_clamp_indirect": 0.0,
    "use_fast_gi": False,
}
# Ray depths below this are those of a world that is seen by the camera (1) or from what the camera sees (2).
WORLD_DEPTH = 2.5


def diffuse(passes: Passes) -> np.ndarray:
    """The light of a render but what its surfaces reflect specularly, `[height][width][3]`."""
    return passes.vector("Combined", "RGB") - passes.glossy()


@dataclass(frozen=True)
class Measured:
    """What the surfaces of a peel are, `[height][width]` or `[height][width][3]`."""

    diffuse: np.ndarray
    reflection: np.ndarray
    normals: np.ndarray
    # 1/distance to what is reflected; 0 where that is nothing.
    inverse: np.ndarray
    reflectance: np.ndarray
    roughness: np.ndarray

    def channels(self) -> tuple[dict, dict]:
        """Planes of a layer that are summed, and planes that are averaged, when samples are merged."""
        sums = {name: self.diffuse[..., k] for k, name in enumerate(names.DIFFUSE)}
        sums |= {name: self.reflection[..., k] for k, name in enumerate(names.REFLECTION)}
        means = {name: self.normals[..., k] for k, name in enumerate(names.NORMAL)}
        means |= {names.DISTANCE: self.inverse, names.ROUGHNESS: self.roughness}
        return sums, means | {name: self.reflectance[..., k] for k, name in enumerate(names.SPECULAR)}


def of_background(colors: np.ndarray) -> tuple[dict, dict]:
    """The channels of the world, which reflects nothing."""
    nothing, plane = np.zeros_like(colors), np.zeros(colors.shape[:2], np.float32)
    return Measured(colors, nothing, nothing, plane, nothing, plane + 1.0).channels()


class Shading:
    """Measures what the camera sees. The journal restores what it changes."""

    def __init__(self, scene: Any, layer: Any, surfaces: Sequence[tuple[str, Any, Any]], camera: Any, journal: Journal):
        """`surfaces` are names of materials, node trees, and the input that their surface is linked to."""
        self.scene, self.layer = scene, layer
        # Right, up and back of the camera, in columns.
        self.axes = np.array(camera.matrix_world.normalized().to_3x3(), np.float32)
        self._lamps = [ob for ob in bpy.data.objects if ob.type == "LIGHT" and not ob.hide_render]
        self._suns = [ob for ob in self._lamps if ob.data.type == "SUN"]
        # Undoes the change to mirrors.
        self._changes: Journal | None = None
        group = _mirror(journal)
        self._surfaces = [_Surface(name, tree, target, group, journal) for name, tree, target in surfaces]
        # Before the mirrors are removed.
        journal.on_restore(self._show_surfaces)

    def say_unread(self, say: Say) -> None:
        """Tells the user of materials whose reflectance cannot be read."""
        unread = sorted({surface.name for surface in self._surfaces if not surface.is_whole})
        if unread:
            say(f"warning: shaders of {', '.join(unread)} cannot be read: reflectance 0 and roughness 1 are written")

    def normals(self, passes: Passes) -> np.ndarray:
        """Normals of a render with them, in the camera's axes, `[height][width][3]`."""
        return passes.vector("Normal", "XYZ") @ self.axes

    def from_surfaces(self, renderer: Renderer, lit: Job, passes: Passes) -> Passes:
        """The render `lit`, whose passes are given, with nothing from the world and suns in its reflections."""
        world = self.layer.world_override or self.scene.world
        if (world is None and not self._suns) or not passes.glossy().any():
            return passes
        self._changes = Journal()
        if world is not None:
            self._darken(world)
        for sun in self._suns:
            self._changes.set(sun, "visible_glossy", False)
        found = renderer.render(replace(lit, name=f"near reflections of {lit.name}"))
        self._show_surfaces()
        return found

    def _darken(self, world: Any) -> None:
        """Makes the world black where the surfaces that the camera sees are lit by it, and leaves it to all others."""
        if not _has_nodes(world):
            plain = self._changes.made(bpy.data.worlds, bpy.data.worlds.new("thinlens world"))
            plain.use_nodes = True
            plain.node_tree.nodes["Background"].inputs["Color"].default_value = (*world.color, 1.0)
            self._changes.set(self.layer, "world_override", plain)
            world = plain
        tree = world.node_tree
        output = tree.get_output_node("CYCLES")
        if output is None or not output.inputs["Surface"].is_linked:
            return
        target = output.inputs["Surface"]
        source = target.links[0].from_socket
        nodes: list[Any] = []
        self._changes.on_restore(lambda: _unlink(tree, nodes, source, target))
        path, compare, mix = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("LightPath", "Math", "MixShader"))
        nodes += [path, compare, mix]
        compare.operation = "LESS_THAN"
        compare.inputs[1].default_value = WORLD_DEPTH
        tree.links.new(path.outputs["Ray Depth"], compare.inputs[0])
        tree.links.new(compare.outputs[0], mix.inputs[0])
        # Nothing in the other input is black.
        tree.links.new(source, mix.inputs[1])
        tree.links.new(mix.outputs[0], target)

    def inverse_distances(self, renderer: Renderer, name: str) -> np.ndarray:
        """1/distance to what each visible surface reflects, `[height][width]`; 0 where that is nothing."""
        self._replace(lambda surface: surface.mirror)
        length = renderer.render(Job(f"reflections of {name}", bounces=1)).channel("Combined.R")
        self._show_surfaces()
        return np.where(length > 0.0, 1.0 / np.where(length > 0.0, length, 1.0), 0.0).astype(np.float32)

    def materials(self, renderer: Renderer, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Reflectance `[height][width][3]` and roughness `[height][width]` of each visible surface."""
        self._replace(lambda surface: surface.reflectance)
        colors = renderer.render(Job(f"reflectance of {name}")).vector("Combined", "RGB")
        self._show_surfaces()
        self._replace(lambda surface: surface.roughness)
        roughness = renderer.render(Job(f"roughness of {name}")).channel("Combined.R")
        self._show_surfaces()
        return np.clip(colors, 0.0, 1.0), np.clip(roughness, 0.0, 1.0)

    def _show_surfaces(self) -> None:
        changes, self._changes = self._changes or Journal(), None
        if failures := changes.restore():
            raise ExportError("the materials could not be restored", found="; ".join(failures))

    def _replace(self, choose: Callable[[_Surface], Any]) -> None:
        """Shows a shader of every surface in the place of its own."""
        self._changes = Journal()
        for surface in self._surfaces:
            surface.show(choose(surface), self._changes)
        # The shaders must show nothing but themselves.
        for lamp in self._lamps:
            self._changes.set(lamp, "hide_render", True)
        self._changes.set(self.layer, "world_override", None)
        self._changes.set(self.scene, "world", None)
        for name, value in EXACT.items():
            self._changes.set(self.scene.cycles, name, value)


class _Surface:
    """The surface of a material, with shaders that can take its place."""

    def __init__(self, name: str, tree: Any, target: Any, group: Any, journal: Journal) -> None:
        self.name, self.tree, self.target = name, tree, target
        before = set(tree.nodes)
        journal.on_restore(lambda: self._remove(made))
        made: list[Any] = []
        node = tree.nodes.new("ShaderNodeGroup")
        node.node_tree = group
        self.mirror = node.outputs[0]
        reader = Reader(tree)
        found = reader.read(target)
        self.is_whole = reader.is_whole
        self.reflectance, self.roughness = self._shining(found.color), self._shining(found.roughness)
        made += [own for own in tree.nodes if own not in before]

    def _shining(self, value: Any) -> Any:
        """A shader that emits a number, a colour, or the output of a node."""
        node = self.tree.nodes.new("ShaderNodeEmission")
        if isinstance(value, float):
            node.inputs["Color"].default_value = (value, value, value, 1.0)
        elif isinstance(value, tuple):
            node.inputs["Color"].default_value = (*value, 1.0)
        else:
            self.tree.links.new(value, node.inputs["Color"])
        return node.outputs[0]

    def _remove(self, nodes: list[Any]) -> None:
        for node in nodes:
            self.tree.nodes.remove(node)

    def show(self, shader: Any, changes: Journal) -> None:
        """Links `shader`."""
        source = self.target.links[0].from_socket if self.target.is_linked else None
        changes.on_restore(lambda: self._link(source))
        self.tree.links.new(shader, self.target)

    def _link(self, source: Any) -> None:
        if source:
            self.tree.links.new(source, self.target)
        else:
            self.tree.links.remove(self.target.links[0])


def _has_nodes(world: Any) -> bool:
    """Whether a world has nodes; in Blender 5 all have."""
    return bool(world.node_tree) and (bpy.app.version >= (5, 0) or world.use_nodes)


def _unlink(tree: Any, nodes: list[Any], source: Any, target: Any) -> None:
    """Removes `nodes`, and links `source` to `target` again."""
    for node in nodes:
        tree.nodes.remove(node)
    tree.links.new(source, target)


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
