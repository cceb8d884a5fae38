# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""Denoising of peels with Open Image Denoise, by the compositor of a scene made for it.

Light that a surface emits has no noise, and a denoiser would spread and weaken lamps of a few pixels: it is taken
away before and added again after.
"""

from __future__ import annotations

import os
from typing import Any

import bpy
import numpy as np

from .journal import Journal
from .passes import Passes, Progress, render_to, write_float_exr

# The image that a compositor makes for its viewer, whether it has one or not.
VIEWER = "Viewer Node"
# Inputs of the compositor's node.
COLOR, ALBEDO, NORMAL = "Image", "Albedo", "Normal"


class Denoiser:
    """A scene with a compositor of one node, for pictures of `size` pixels. The journal removes it."""

    def __init__(self, size: tuple[int, int], threads: Any, folder: str, journal: Journal, progress: Progress) -> None:
        """`threads` is a scene whose number of threads is used."""
        self.size, self.progress = size, progress
        self.path = os.path.join(folder, "denoised.exr")
        self.scene = journal.made(bpy.data.scenes, bpy.data.scenes.new("thinlens denoise"))
        if VIEWER not in bpy.data.images:
            journal.on_restore(_remove_viewer)
        self._prepare_scene(threads.render, journal)
        images = bpy.data.images
        self.images = {
            name: journal.made(
                images, images.new(f"thinlens {name}", *size, alpha=False, float_buffer=True, is_data=True)
            )
            for name in (COLOR, ALBEDO, NORMAL)
        }
        self._build(_tree(self.scene, journal))

    def denoise(self, color: np.ndarray, passes: Passes, name: str, has_emission: bool = True) -> np.ndarray:
        """The denoised `color`, `[height][width][3]`, premultiplied, of a render with guides."""
        emitted = passes.emission() if has_emission else 0.0
        self._fill(COLOR, color - emitted)
        self._fill(ALBEDO, passes.vector("Denoising Albedo", "RGB"))
        self._fill(NORMAL, passes.vector("Denoising Normal", "XYZ"))
        self.progress(name)
        channels, _ = render_to(self.scene, self.path, name)
        planes = [next(plane for full, plane in channels.items() if full.endswith(f".{end}")) for end in "RGB"]
        return np.stack(planes, axis=-1).astype(np.float32) + emitted

    def _prepare_scene(self, like: Any, journal: Journal) -> None:
        render = self.scene.render
        render.engine = "CYCLES"
        render.resolution_x, render.resolution_y, render.resolution_percentage = *self.size, 100
        render.threads_mode, render.threads = like.threads_mode, like.threads
        render.use_compositing, render.use_sequencer = True, False
        write_float_exr(self.scene, self.path, journal)
        data = journal.made(bpy.data.cameras, bpy.data.cameras.new("thinlens denoise"))
        self.scene.camera = journal.made(bpy.data.objects, bpy.data.objects.new("thinlens denoise", data))

    def _build(self, tree: Any) -> None:
        node = tree.nodes.new("CompositorNodeDenoise")
        # Filtering albedo and normals first takes five times as long, and gains nothing for point samples.
        if "Prefilter" in node.inputs:
            node.inputs["Prefilter"].default_value = "Fast"
        else:
            node.prefilter = "FAST"
        for name, image in self.images.items():
            source = tree.nodes.new("CompositorNodeImage")
            source.image = image
            tree.links.new(source.outputs[0], node.inputs[name])
        kind = "NodeGroupOutput" if hasattr(self.scene, "compositing_node_group") else "CompositorNodeComposite"
        tree.links.new(node.outputs[0], tree.nodes.new(kind).inputs[0])

    def _fill(self, name: str, values: np.ndarray) -> None:
        """Fills an image with `values`, `[height][width][3]`, row 0 on top."""
        width, height = self.size
        pixels = np.ones((height, width, 4), np.float32)
        pixels[..., :3] = np.nan_to_num(values[::-1], posinf=0.0, neginf=0.0)
        self.images[name].pixels.foreach_set(pixels.reshape(-1))
        self.images[name].update()


def _remove_viewer() -> None:
    if VIEWER in bpy.data.images:
        bpy.data.images.remove(bpy.data.images[VIEWER])


def _tree(scene: Any, journal: Journal) -> Any:
    """An empty compositor of `scene`."""
    if not hasattr(scene, "compositing_node_group"):
        scene.use_nodes = True
        scene.node_tree.nodes.clear()
        return scene.node_tree
    groups = bpy.data.node_groups
    tree = journal.made(groups, groups.new("thinlens denoise", "CompositorNodeTree"))
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    scene.compositing_node_group = tree
    return tree
