"""Everything that Blender's file holds, as text, to see whether something has changed. Needs the bpy module."""

from __future__ import annotations

from typing import Any

import bpy

# Blender counts and caches these, or they are what every render makes.
PASSING = {"rna_type", "session_uid", "is_updated", "is_updated_data", "depsgraph", "is_dirty", "id_data", "bindcode"}
MADE_BY_RENDERS = {"Render Result"}
# The user interface.
NOT_THE_SCENE = {"window_managers", "screens", "workspaces"}
# Longer collections are compared by their length.
LONGEST = 300
DEEPEST = 7


def fingerprint() -> dict[str, str]:
    """The values of all properties of all datablocks, by their path."""
    out: dict[str, str] = {}
    for collection in bpy.data.bl_rna.properties:
        if collection.type != "COLLECTION" or collection.identifier in NOT_THE_SCENE:
            continue
        blocks = getattr(bpy.data, collection.identifier)
        for block in blocks:
            if isinstance(block, bpy.types.ID) and block.name not in MADE_BY_RENDERS:
                _describe(block, f"{collection.identifier}[{block.name}]", out, 0)
    return out


def changes(before: dict[str, str], after: dict[str, str]) -> list[str]:
    """What differs, a line each."""
    paths = [path for path in {**before, **after} if before.get(path) != after.get(path)]
    return [f"{path}: {before.get(path)} → {after.get(path)}" for path in sorted(paths)]


def _describe(thing: Any, path: str, out: dict[str, str], depth: int) -> None:
    if depth > DEEPEST:
        return
    if hasattr(thing, "keys"):
        try:
            for key in thing.keys():  # noqa: SIM118: custom properties have no other way in
                out[f"{path}[{key!r}]"] = repr(thing[key])
        except TypeError:
            pass
    for rna in thing.bl_rna.properties:
        if rna.identifier in PASSING:
            continue
        try:
            value = getattr(thing, rna.identifier)
        except (AttributeError, ValueError, RuntimeError):
            continue
        own = f"{path}.{rna.identifier}"
        if rna.type == "POINTER":
            _pointer(value, own, out, depth)
        elif rna.type == "COLLECTION":
            _collection(value, own, out, depth)
        else:
            is_array = getattr(rna, "is_array", False)
            out[own] = repr(_flat(value)) if is_array else repr(value)


def _flat(value: Any) -> Any:
    """An array, of any number of dimensions, as tuples."""
    return tuple(_flat(item) for item in value) if hasattr(value, "__len__") else value


def _pointer(value: Any, path: str, out: dict[str, str], depth: int) -> None:
    if value is None or isinstance(value, bpy.types.ID):
        is_embedded = isinstance(value, bpy.types.NodeTree) and value.is_embedded_data
        out[path] = repr(value and value.name)
        if is_embedded:
            _describe(value, path, out, depth + 1)
    else:
        _describe(value, path, out, depth + 1)


def _collection(value: Any, path: str, out: dict[str, str], depth: int) -> None:
    out[f"{path}.length"] = repr(len(value))
    if len(value) > LONGEST:
        return
    if path.endswith(".links") and all(hasattr(item, "from_socket") for item in value):
        ends = [(i.from_node.name, i.from_socket.identifier, i.to_node.name, i.to_socket.identifier) for i in value]
        out[path] = repr(sorted(ends))
        return
    for index, item in enumerate(value):
        if item is None or isinstance(item, bpy.types.ID):
            out[f"{path}[{index}]"] = repr(item and item.name)
        else:
            _describe(item, f"{path}[{index}]", out, depth + 1)
