"""Everything that Blender's file holds, as text, to see whether something has changed. Needs the bpy module."""

from __future__ import annotations

from typing import Any

import bpy

# Blender counts and caches these, or they are what every render makes.
PASSING = {"rna_type", "session_uid", "is_updated", "is_updated_data", "depsgraph", "is_dirty", "id_data", "bindcode"}
MADE_BY_RENDERS = {"Render Result"}
# The user interface.
NOT_THE_SCENE = {"window_managers", "screens", "workspaces"}
# Built from the rest when it is asked for.
DERIVED = {"original", "loop_triangles", "loop_triangle_polygons", "corner_normals", "preview"}
DERIVED |= {"uv_layer_clone", "uv_layer_stencil"}
# Brushes and the like: Blender 4.2 crashes when it is asked for some of them.
DERIVED |= {"tool_settings"}
# Longer collections are compared by their length.
LONGEST = 300


def fingerprint() -> dict[str, str]:
    """The values of all properties of all datablocks, by their path."""
    out: dict[str, str] = {}
    for collection in bpy.data.bl_rna.properties:
        if collection.type != "COLLECTION" or collection.identifier in NOT_THE_SCENE:
            continue
        for block in getattr(bpy.data, collection.identifier):
            if isinstance(block, bpy.types.ID) and block.name not in MADE_BY_RENDERS:
                _Describer(out).describe(block, f"{collection.identifier}[{block.name}]")
    return out


def changes(before: dict[str, str], after: dict[str, str]) -> list[str]:
    """What differs, a line each."""
    paths = [path for path in {**before, **after} if before.get(path) != after.get(path)]
    return [f"{path}: {before.get(path)} → {after.get(path)}" for path in sorted(paths)]


class _Describer:
    """Describes one datablock; what is found again in it is left out."""

    def __init__(self, out: dict[str, str]) -> None:
        self.out = out
        self.seen: set[tuple[int, str]] = set()

    def describe(self, thing: Any, path: str) -> None:
        key = (thing.as_pointer(), type(thing).__name__)
        if key in self.seen:
            return
        self.seen.add(key)
        if isinstance(thing, bpy.types.ID):
            self._custom(thing, path)
        for rna in thing.bl_rna.properties:
            name = rna.identifier
            if name in PASSING or name in DERIVED or name.startswith("bl_"):
                continue
            try:
                value = getattr(thing, name)
            except (AttributeError, ValueError, RuntimeError):
                continue
            if rna.type == "POINTER":
                self._pointer(value, f"{path}.{name}")
            elif rna.type == "COLLECTION":
                self._collection(value, f"{path}.{name}")
            else:
                self.out[f"{path}.{name}"] = repr(_flat(value) if getattr(rna, "is_array", False) else value)

    def _custom(self, thing: Any, path: str) -> None:
        """The custom properties. Those that add-ons register are described as properties."""
        for key in sorted(thing.keys()):
            if not key.startswith("cycles"):
                self.out[f"{path}[{key!r}]"] = repr(thing[key])

    def _pointer(self, value: Any, path: str) -> None:
        if value is None or isinstance(value, bpy.types.ID):
            self.out[path] = repr(value and value.name)
        if value is not None and (not isinstance(value, bpy.types.ID) or _is_embedded(value)):
            self.describe(value, path)

    def _collection(self, value: Any, path: str) -> None:
        self.out[f"{path}.length"] = repr(len(value))
        if len(value) > LONGEST:
            return
        if all(isinstance(item, bpy.types.NodeLink) for item in value):
            ends = [(i.from_node.name, i.from_socket.identifier, i.to_node.name, i.to_socket.identifier) for i in value]
            self.out[path] = repr(sorted(ends))
            return
        for index, item in enumerate(value):
            if item is None or isinstance(item, bpy.types.ID):
                self.out[f"{path}[{index}]"] = repr(item and item.name)
            else:
                self.describe(item, f"{path}[{index}]")


def _is_embedded(block: Any) -> bool:
    """Whether a datablock is part of another one."""
    return isinstance(block, bpy.types.NodeTree) and block.is_embedded_data


def _flat(value: Any) -> Any:
    """An array, of any number of dimensions, as tuples."""
    return tuple(_flat(item) for item in value) if hasattr(value, "__len__") else value
