# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""Volumes, which scatter rays before they find a surface: they are taken out while distances are rendered."""

from __future__ import annotations

from typing import Any

import bpy

from .journal import Journal
from .materials import used


class Volumes:
    """The volumes of the open file's materials and of a scene's world."""

    def __init__(self, scene: Any, journal: Journal) -> None:
        """The journal puts them back in the end."""
        self.names: list[str] = []
        # Node tree, output and input of each link to a volume.
        self._links: list[tuple[Any, Any, Any]] = []
        self._are_shown = True
        for material in used():
            self._find(material, f"material {material.name}")
        if scene.world:
            self._find(scene.world, f"world {scene.world.name}")
        journal.on_restore(lambda: self.show(True))

    def show(self, are_shown: bool) -> None:
        """Renders with the volumes, or without."""
        if are_shown == self._are_shown:
            return
        self._are_shown = are_shown
        for tree, source, target in self._links:
            if are_shown:
                tree.links.new(source, target)
            else:
                tree.links.remove(target.links[0])

    def _find(self, owner: bpy.types.ID, name: str) -> None:
        """Notes the volume of a material or a world."""
        output = owner.node_tree.get_output_node("CYCLES") if owner.node_tree else None
        volume = output and output.inputs["Volume"]
        if volume and volume.is_linked:
            self.names.append(name)
            self._links.append((owner.node_tree, volume.links[0].from_socket, volume))
