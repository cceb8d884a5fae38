# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""Materials while peels are rendered: each is mixed with a transparent shader by the node group of `peel_nodes`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import bpy

from .journal import Journal
from .settings import Say

# Blender 5 has no materials without nodes.
HAS_USE_NODES = bpy.app.version < (5, 0)
# Of surfaces without a material.
DEFAULT_COLOR = (0.8, 0.8, 0.8, 1.0)
# Nodes that let through what is behind them.
TRANSPARENT = {"BSDF_TRANSPARENT", "HOLDOUT", "SCRIPT"}
# Types of objects with a surface, whose data holds materials.
SURFACES = {"MESH", "CURVE", "SURFACE", "FONT", "META", "CURVES", "POINTCLOUD"}


@dataclass
class Wrapped:
    """What wrapping the materials found."""

    # Names of materials with coloured transparent shaders.
    tinted: list[str] = field(default_factory=list)
    # Names of materials, their node trees, and the input that the surface is linked to.
    surfaces: list[tuple[str, Any, Any]] = field(default_factory=list)


def used() -> Iterator[Any]:
    """The materials of the open file that anything uses, with nodes."""
    for material in bpy.data.materials:
        if material.users and not material.is_grease_pencil:
            yield material


def is_transparent(tree: Any, seen: frozenset[str] = frozenset()) -> bool:
    """Whether a material's node tree may let through what is behind it, unbent."""
    for node in tree.nodes:
        alpha = node.inputs["Alpha"] if node.type == "BSDF_PRINCIPLED" else None
        if node.type in TRANSPARENT or (alpha and (alpha.is_linked or alpha.default_value < 1.0)):
            return True
        inner = node.node_tree if node.type == "GROUP" else None
        if inner and inner.name not in seen and is_transparent(inner, seen | {tree.name}):
            return True
    return False


def give_nodes(journal: Journal) -> None:
    """Puts materials with nodes in the place of those without, as Cycles renders those: diffuse, in one colour."""
    for material in list(used()) if HAS_USE_NODES else []:
        if not material.use_nodes:
            plain = _plain_material(journal, material.diffuse_color[:])
            journal.on_restore(lambda plain=plain, material=material: plain.user_remap(material))
            material.user_remap(plain)


def fill_empty_slots(journal: Journal) -> None:
    """Gives what has no material the surface that Cycles gives it, so that it can be wrapped."""
    plain = None
    for ob in bpy.data.objects:
        if ob.type not in SURFACES or (ob.data.materials and all(slot.material for slot in ob.material_slots)):
            continue
        plain = plain or _plain_material(journal)
        if not ob.data.materials:
            materials = ob.data.materials
            journal.on_restore(materials.clear)
            materials.append(plain)
        for slot in ob.material_slots:
            if slot.material is None:
                journal.on_restore(lambda slot=slot: setattr(slot, "material", None))
                slot.material = plain


def _plain_material(journal: Journal, color: tuple[float, ...] = DEFAULT_COLOR) -> Any:
    """A diffuse material."""
    material = journal.made(bpy.data.materials, bpy.data.materials.new("thinlens default"))
    if HAS_USE_NODES:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    diffuse, output = (tree.nodes.new(kind) for kind in ("ShaderNodeBsdfDiffuse", "ShaderNodeOutputMaterial"))
    diffuse.inputs["Color"].default_value = color
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    return material


def wrap_all(group: Any, journal: Journal, say: Say) -> Wrapped:
    """Puts the node group before the output of every used material, and straightens coloured transparent shaders."""
    out, straightened = Wrapped(), set()
    for material in list(used()):
        tree = material.node_tree
        output = tree.get_output_node("CYCLES") if tree else None
        if output is None:
            continue
        try:
            if not is_transparent(tree):
                # Opaque to light it was, and stays so: shadow rays need not ask the nodes.
                # In Blender 4.2, that changes another property as well.
                journal.remember(material, "shadow_method")
                journal.set(material, "use_transparent_shadow", False)
            inputs = _wrap(tree, output, group, journal)
            out.surfaces += [(material.name, tree, target) for target in inputs]
            if _straighten(tree, journal, straightened):
                out.tinted.append(material.name)
        except (AttributeError, RuntimeError) as error:
            say(f"warning: material {material.name} cannot be changed and is in front in every peel ({error})")
    return out


def _wrap(tree: Any, output: Any, group: Any, journal: Journal) -> list[Any]:
    """Puts the node group before the surface of `output`, and returns the input that the surface is now linked to.

    A volume without a surface gets a clear one, and has no such input.
    """
    target = output.inputs["Surface"]
    source = target.links[0].from_socket if target.is_linked else None
    clear = tree.nodes.new("ShaderNodeBsdfTransparent")
    nodes = [clear]
    journal.on_restore(lambda: _unlink(tree, nodes, source, target))
    if source is None and output.inputs["Volume"].is_linked:
        tree.links.new(clear.outputs[0], target)
        return []
    show, mix = tree.nodes.new("ShaderNodeGroup"), tree.nodes.new("ShaderNodeMixShader")
    nodes += [show, mix]
    show.node_tree = group
    tree.links.new(show.outputs[0], mix.inputs[0])
    tree.links.new(clear.outputs[0], mix.inputs[1])
    if source:
        tree.links.new(source, mix.inputs[2])
    tree.links.new(mix.outputs[0], target)
    return [mix.inputs[2]]


def _unlink(tree: Any, nodes: list[Any], source: Any, target: Any) -> None:
    """Removes `nodes`, and links `source` to `target` again."""
    for node in nodes:
        tree.nodes.remove(node)
    if source:
        tree.links.new(source, target)


def _is_tinted(node: Any) -> bool:
    """Whether a transparent shader colours what is behind it."""
    if node.type != "BSDF_TRANSPARENT":
        return False
    color = node.inputs["Color"]
    return color.is_linked or len(set(color.default_value[:3])) > 1


def _straighten(tree: Any, journal: Journal, done: set[int]) -> bool:
    """Makes coloured transparent shaders show the camera, in their own colour, what is behind them.

    A peel has one alpha, which cannot colour. A refraction of index 1 does not bend, and the camera sees through it as
    through glass. Whether there are any; each tree in `done` is left alone.
    """
    found = False
    for node in list(tree.nodes):
        if node.type == "GROUP" and node.node_tree:
            found |= _straighten(node.node_tree, journal, done)
        elif _is_tinted(node) and node.outputs[0].is_linked:
            found = True
            if tree.as_pointer() not in done:
                _replace_for_camera(tree, node, journal)
    done.add(tree.as_pointer())
    return found


def _replace_for_camera(tree: Any, clear: Any, journal: Journal) -> None:
    """Puts a refraction of index 1 in the place of the transparent shader `clear`, for camera rays."""
    kinds = ("ShaderNodeLightPath", "ShaderNodeBsdfRefraction", "ShaderNodeMixShader")
    nodes = [tree.nodes.new(kind) for kind in kinds]
    path, straight, mix = nodes
    targets = [link.to_socket for link in clear.outputs[0].links]
    for target in targets:
        journal.on_restore(lambda target=target: tree.links.new(clear.outputs[0], target))
    journal.on_restore(lambda: [tree.nodes.remove(node) for node in nodes])
    straight.inputs["IOR"].default_value = 1.0
    straight.inputs["Roughness"].default_value = 0.0
    color = clear.inputs["Color"]
    straight.inputs["Color"].default_value = color.default_value[:]
    if color.is_linked:
        tree.links.new(color.links[0].from_socket, straight.inputs["Color"])
    tree.links.new(path.outputs["Is Camera Ray"], mix.inputs[0])
    tree.links.new(clear.outputs[0], mix.inputs[1])
    tree.links.new(straight.outputs[0], mix.inputs[2])
    for target in targets:
        tree.links.new(mix.outputs[0], target)
