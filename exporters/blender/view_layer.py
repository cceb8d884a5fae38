# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""The view layer that is rendered for peels: one that stands in for the user's.

The user's own is not changed: the compositor's nodes would get the outputs of its passes.
"""

from __future__ import annotations

from typing import Any

from .journal import Journal
from .settings import Say
from .shared import ExportError

# Surfaces of less alpha have no depth.
ALPHA_THRESHOLD = 0.01
# Ranks of a cryptomatte in a render with one sample a pixel.
CRYPTOMATTE_RANKS = 2
# What a view layer shows of the scene.
SHOWN = ("use_sky", "use_solid", "use_strand", "use_volumes", "world_override")
SHOWN_OF_COLLECTION = ("exclude", "holdout", "indirect_only", "hide_viewport")


def find(scene: Any, name: str | None, say: Say) -> Any:
    """The view layer `name`, or the first that is rendered. Raises `ExportError` if there is none."""
    layers = [layer for layer in scene.view_layers if (layer.use if name is None else layer.name == name)]
    if not layers:
        names = ", ".join(layer.name for layer in scene.view_layers)
        found = "none that is used for rendering" if name is None else f'"{name}"'
        raise ExportError("there is no such view layer", where=f"scene {scene.name}", found=found, wanted=names)
    if len(layers) > 1:
        say(f"note: only view layer {layers[0].name} is exported, of {len(layers)}; choose another with --view-layer")
    if layers[0].material_override:
        say(f"note: the material override of view layer {layers[0].name} is left out")
    return layers[0]


def stand_in(scene: Any, layer: Any, journal: Journal) -> Any:
    """A view layer that shows what `layer` shows, with colour and depth alone, of point samples."""
    own = journal.made(scene.view_layers, scene.view_layers.new("thinlens"))
    for name in SHOWN:
        if hasattr(layer, name):
            setattr(own, name, getattr(layer, name))
    for key in sorted(layer.keys()):
        if not key.startswith("cycles"):
            own[key] = layer[key]
    _copy_collections(layer.layer_collection, own.layer_collection)
    for name in sorted(own.bl_rna.properties.keys()):
        if name.startswith("use_pass_"):
            setattr(own, name, name in ("use_pass_combined", "use_pass_z"))
    own.pass_alpha_threshold = ALPHA_THRESHOLD
    own.pass_cryptomatte_depth = CRYPTOMATTE_RANKS
    return own


def _copy_collections(source: Any, target: Any) -> None:
    """Shows and hides the collections below `target` as those below `source`."""
    for name in SHOWN_OF_COLLECTION:
        if getattr(target, name) != getattr(source, name):
            setattr(target, name, getattr(source, name))
    for child in source.children:
        _copy_collections(child, target.children[child.name])
