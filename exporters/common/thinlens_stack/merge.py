"""Merging: point samples of a pixel become coverage layers, as thinlens merges a supersampled stack.

The fragments of a pixel's samples are sorted by CoC radius and grouped into surfaces, nearest first. A fragment joins
the surface before it if it is near enough to its last and its first fragment, and if its sample is not in that
surface yet. A surface's alpha is the sum of its fragments' alpha over the number of samples, its colour likewise
(premultiplied), its depth the harmonic mean. Background makes one layer, the last of its pixel, with its own opacity
and not its share of the pixel: it continues behind whatever hides it from other samples. A pixel keeps at most
`EXTRA_LAYERS` layers more than its samples have; the least visible surfaces are dropped, never the background.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from .errors import ExportError
from .lens import BACKGROUND, NOTHING_HIT, Lens

# Layers that merging may add: the samples of a pixel at an edge hit different surfaces.
EXTRA_LAYERS = 2
# Fragments of one surface follow each other within so many pixels of CoC radius, or within this share of the radius.
GAP_PX = 0.5
GAP_SHARE = 0.02
# Largest difference within a surface, in those gaps.
MOST_GAPS = 2.0
# Share of its alpha by which a surface hides what is behind it when the least visible is chosen: lens rays pass
# beside it.
HIDING_SHARE = 0.9
# Pixels that are merged at a time; bounds the memory.
PIXELS_AT_A_TIME = 1 << 16


@dataclass
class Layer:
    """One peel: arrays `[height][width]`, colour `[height][width][3]`.

    Colour and `sums` are premultiplied. `depth` is planar; from `BACKGROUND` on it is background. Samples of alpha 0
    are empty. `means` are averaged over the fragments of a surface.
    """

    color: np.ndarray
    alpha: np.ndarray
    depth: np.ndarray
    sums: dict[str, np.ndarray] = field(default_factory=dict)
    means: dict[str, np.ndarray] = field(default_factory=dict)

    def rows(self, start: int, end: int) -> Layer:
        """The rows from `start` to before `end`."""
        return self._mapped(lambda plane: plane[start:end])

    def reshaped(self, height: int, width: int) -> Layer:
        """The layer with its samples, in whatever shape, as rows of pixels."""
        return self._mapped(lambda plane: plane.reshape(height, width, *plane.shape[self.alpha.ndim :]))

    def _mapped(self, change: Callable[[np.ndarray], np.ndarray]) -> Layer:
        sums, means = ({name: change(plane) for name, plane in more.items()} for more in (self.sums, self.means))
        return Layer(change(self.color), change(self.alpha), change(self.depth), sums, means)


def interleave(phases: Sequence[Sequence[Layer]]) -> list[Layer]:
    """The layers of S² phases as layers of S times the size.

    Phase `i` holds the samples in column `i mod S` and row `i div S` of every pixel.
    """
    per_axis = samples_per_axis(len(phases))

    def woven(planes: Sequence[np.ndarray]) -> np.ndarray:
        height, width, *rest = planes[0].shape
        out = np.empty((height * per_axis, width * per_axis, *rest), planes[0].dtype)
        for i, plane in enumerate(planes):
            out[i // per_axis :: per_axis, i % per_axis :: per_axis] = plane
        return out

    return [_joined(parts, woven) for parts in zip(*phases, strict=True)]


def _joined(parts: Sequence[Layer], join: Callable[[Sequence[np.ndarray]], np.ndarray]) -> Layer:
    """One layer of several, channel by channel."""
    color, alpha, depth = (join([getattr(part, name) for part in parts]) for name in ("color", "alpha", "depth"))
    sums, means = (
        {name: join([getattr(part, group)[name] for part in parts]) for name in getattr(parts[0], group)}
        for group in ("sums", "means")
    )
    return Layer(color, alpha, depth, sums, means)


def split(layers: Sequence[Layer], per_axis: int) -> list[list[Layer]]:
    """The S² phases of layers of S times the size: undoes `interleave`."""
    return [
        [layer._mapped(lambda plane, y=y, x=x: plane[y::per_axis, x::per_axis]) for layer in layers]
        for y in range(per_axis)
        for x in range(per_axis)
    ]


def samples_per_axis(phases: int) -> int:
    """S of S² phases. Raises `ExportError` for a number that is not a square."""
    per_axis = round(phases**0.5)
    if per_axis < 1 or per_axis**2 != phases:
        raise ExportError("samples form a square grid in the pixel", found=f"{phases} samples", wanted="1, 4, 9, 16, …")
    return per_axis


def merge(phases: Sequence[Sequence[Layer]], lens: Lens, width_px: float, peels: int | None = None) -> list[Layer]:
    """Coverage layers of `phases`: for each sample of the pixel, ordered as in `interleave`, its layers by distance.

    All layers are of one size. The lens and the width of its frame in pixels give the CoC radii that say what is one
    surface. A stack is often rendered with another lens later: pass `lens.for_merging()`. At most `EXTRA_LAYERS` more
    than `peels` are kept, which is the number of each sample's layers where it is not given.
    """
    samples_per_axis(len(phases))
    most = (len(phases[0]) if peels is None else peels) + EXTRA_LAYERS
    height, width = phases[0][0].alpha.shape
    out = [_empty_like(phases[0][0]) for _ in range(most)]
    used = 1
    rows = max(1, PIXELS_AT_A_TIME // width)
    for start in range(0, height, rows):
        end = min(height, start + rows)
        band = _Band([[layer.rows(start, end) for layer in phase] for phase in phases])
        used = max(used, band.merge(lens, width_px, [layer.rows(start, end) for layer in out]))
    return out[:used]


def stacked(bands: Sequence[Sequence[Layer]]) -> list[Layer]:
    """The layers of bands of rows, one below the other; a band with fewer layers than another is empty in the rest."""
    count = max(map(len, bands))
    filled = [[*band, *(_empty_like(band[0]) for _ in range(count - len(band)))] for band in bands]
    return [_joined(parts, np.concatenate) for parts in zip(*filled, strict=True)]


def _empty_like(layer: Layer) -> Layer:
    out = layer._mapped(lambda plane: np.zeros(plane.shape, np.float32))
    out.depth.fill(NOTHING_HIT)
    return out


class _Band:
    """Some rows of all phases, as arrays `[fragment][pixel]`. Fragments are ordered by layer, then by sample."""

    def __init__(self, phases: Sequence[Sequence[Layer]]) -> None:
        self.samples = len(phases)
        # The layers of the fragments.
        self.layers = [phase[peel] for peel in range(len(phases[0])) for phase in phases]
        self.alpha = np.stack([layer.alpha.reshape(-1) for layer in self.layers]).astype(np.float32)
        depth = np.stack([layer.depth.reshape(-1) for layer in self.layers]).astype(np.float64)
        is_hit = (depth > 0.0) & (depth < BACKGROUND)
        self.inverse = np.where(is_hit, 1.0 / np.where(is_hit, depth, 1.0), 0.0)
        self.is_surface = (self.alpha > 0.0) & is_hit
        self.is_background = (self.alpha > 0.0) & ~is_hit

    def merge(self, lens: Lens, width_px: float, out: Sequence[Layer]) -> int:
        """Fills the layers `out`; returns how many of them are used."""
        surface = self._surfaces(lens, width_px)
        count = int(surface.max(initial=-1)) + 1
        alpha = self._sum(self.alpha, surface, count) / self.samples
        weights = self._background_weights()
        has_background = (weights * self.is_background).any(axis=0)
        kept = _most_visible(alpha, surface_counts(surface), len(out) - has_background)
        slot = np.where(kept, np.cumsum(kept, axis=0) - 1, -1)
        last = np.where(has_background, kept.sum(axis=0), -1)
        self._write_surfaces(surface, slot, out)
        self._write_background(weights, last, out)
        return int(max(slot.max(initial=-1), last.max(initial=-1))) + 1

    def _surfaces(self, lens: Lens, width_px: float) -> np.ndarray:
        """The number of each fragment's surface in its pixel, nearest first; -1 for none."""
        offset = 0.0 if lens.focus_distance is None else 1.0 / lens.focus_distance
        coc = lens.coc_scale_px(width_px) * (offset - self.inverse)
        order = np.argsort(np.where(self.is_surface, coc, np.inf), axis=0, kind="stable")
        fragments, pixels = coc.shape
        at = np.arange(pixels)
        surface = np.full((fragments, pixels), -1, np.int32)
        # Of the last surface of each pixel.
        number = np.full(pixels, -1, np.int32)
        first, last = np.zeros(pixels), np.zeros(pixels)
        has_sample = np.zeros((self.samples, pixels), bool)
        for fragment in order:
            present = self.is_surface[fragment, at]
            if not present.any():
                break
            radius, sample = coc[fragment, at], fragment % self.samples
            gap = np.maximum(GAP_PX, GAP_SHARE * np.abs(radius))
            joins = (number >= 0) & (radius - last < gap) & (radius - first < MOST_GAPS * gap)
            joins &= ~has_sample[sample, at]
            opens = present & ~joins
            number += opens
            first = np.where(opens, radius, first)
            last = np.where(present, radius, last)
            has_sample &= ~opens
            has_sample[sample[present], at[present]] = True
            surface[fragment[present], at[present]] = number[present]
        return surface

    def _sum(self, values: np.ndarray, surface: np.ndarray, count: int) -> np.ndarray:
        """The sums over the fragments of each surface, `[surface][pixel]`, of values `[fragment][pixel]`."""
        out = np.zeros((count, surface.shape[1]), np.float64)
        for row, numbers in zip(values, surface, strict=True):
            at = np.flatnonzero(numbers >= 0)
            out[numbers[at], at] += row[at]
        return out

    def _write_surfaces(self, surface: np.ndarray, slot: np.ndarray, out: Sequence[Layer]) -> None:
        """Writes the surfaces into the layers `slot`, `[surface][pixel]`; those of slot -1 are dropped."""
        # The layer of each fragment.
        count, pixels = slot.shape
        if count == 0:
            return
        target = np.where(surface >= 0, slot[np.maximum(surface, 0), np.arange(pixels)], -1)
        fragments = self._sum(np.ones(target.shape), target, len(out))
        is_used = fragments > 0
        inverse = self._sum(self.inverse, target, len(out)) / np.maximum(fragments, 1)
        _put(out, "depth", is_used, 1.0 / np.where(is_used, inverse, 1.0))
        for name, planes in _planes(self.layers).items():
            values = self._sum(planes, target, len(out))
            is_mean = name[0] == "means"
            _put(out, name, is_used, values / (np.maximum(fragments, 1) if is_mean else self.samples))

    def _background_weights(self) -> np.ndarray:
        """The weight of each background fragment, `[fragment][pixel]`; 0 for others.

        A sample composites its own background. It counts by what it shows of the background: all where it is seen or
        where nothing else is, nothing where the sample's surfaces end without it.
        """
        peels = len(self.layers) // self.samples
        shape = (peels, self.samples, -1)
        alpha = self.alpha.reshape(shape)
        passes = np.where(self.is_surface.reshape(shape), 1.0 - alpha, 1.0).prod(axis=0)
        back = np.where(self.is_background.reshape(shape), alpha, 0.0)
        before = np.cumprod(np.concatenate([np.ones((1, *back.shape[1:])), 1.0 - back[:-1]]), axis=0)
        share = np.maximum(passes, (before * back).sum(axis=0))
        total = share.sum(axis=0)
        weight = before * (share / np.where(total > 0.0, total, 1.0))
        return np.where(self.is_background, weight.reshape(self.alpha.shape), 0.0)

    def _write_background(self, weights: np.ndarray, slot: np.ndarray, out: Sequence[Layer]) -> None:
        """Writes the background into the layer `slot` of each pixel; none where that is -1."""
        at = np.flatnonzero(slot >= 0)
        is_used = np.zeros((len(out), len(slot)), bool)
        is_used[slot[at], at] = True
        for name, planes in _planes(self.layers).items():
            value = (weights * planes).sum(axis=0)
            if name[0] == "means":
                value /= np.maximum(weights.sum(axis=0), 1e-30)
            _put(out, name, is_used, np.broadcast_to(value, is_used.shape))


def surface_counts(surface: np.ndarray) -> np.ndarray:
    """The number of surfaces of each pixel, from their numbers `[fragment][pixel]`."""
    return surface.max(axis=0, initial=-1) + 1


def _planes(layers: Sequence[Layer]) -> dict[tuple[str, str | int], np.ndarray]:
    """The values of all fragments but their depth, `[fragment][pixel]`, by the group and the name of the channel."""
    channels = [("alpha", ""), *(("color", k) for k in range(3))]
    channels += [(group, name) for group in ("sums", "means") for name in getattr(layers[0], group)]
    return {channel: np.stack([_plane(layer, channel).reshape(-1) for layer in layers]) for channel in channels}


def _plane(layer: Layer, channel: str | tuple[str, str | int]) -> np.ndarray:
    """One channel of a layer, as a view."""
    match channel:
        case "depth" | ("alpha", _):
            return layer.depth if channel == "depth" else layer.alpha
        case ("color", k):
            return layer.color[..., k]
        case (group, name):
            return getattr(layer, group)[name]
    raise KeyError(channel)


def _put(out: Sequence[Layer], channel: str | tuple[str, str | int], where: np.ndarray, values: np.ndarray) -> None:
    """Writes `values` into a channel of all layers; both arrays are `[layer][pixel]`."""
    for layer, is_used, own in zip(out, where, values, strict=True):
        plane = _plane(layer, channel)
        plane[is_used.reshape(plane.shape)] = own[is_used]


def _most_visible(alpha: np.ndarray, counts: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Which surfaces are kept, `[surface][pixel]`: at most `most` of the `counts` of each pixel.

    The least visible are dropped one after another; of several, the farthest.
    """
    kept = np.arange(len(alpha))[:, None] < counts
    while True:
        over = np.flatnonzero(kept.sum(axis=0) > most)
        if len(over) == 0:
            return kept
        own, alive = alpha[:, over], kept[:, over]
        hidden = np.where(alive, 1.0 - HIDING_SHARE * own, 1.0)
        passing = np.cumprod(np.concatenate([np.ones((1, len(over))), hidden[:-1]]), axis=0)
        visibility = np.where(alive, passing * own, np.inf)
        farthest = len(alpha) - 1 - np.argmin(visibility[::-1], axis=0)
        kept[farthest, over] = False
