# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""Cryptomattes of a pixel's samples, merged into those of the pixel."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

# Ids that a pixel keeps, the largest first; two in a channel group, as everywhere.
MOST_IDS = 6
_ID = re.compile(r"(.*Crypto(?:Object|Material|Asset)\d\d)\.[rR]")


def merged(channels: Mapping[str, np.ndarray], per_axis: int) -> dict[str, np.ndarray]:
    """The cryptomattes in `channels`, of samples, at one sample a pixel; `[height][width]` each."""
    stems = sorted({match[1] for name in channels if (match := _ID.fullmatch(name))})
    out: dict[str, np.ndarray] = {}
    for base in sorted({stem[:-2] for stem in stems}):
        ids, shares = _fragments(channels, [stem for stem in stems if stem[:-2] == base], per_axis)
        for rank, (best, share) in enumerate(_ranked(ids, shares)):
            group = f"{base}{rank // 2:02d}"
            out[f"{group}.{'rb'[rank % 2]}"] = best.view(np.float32)
            out[f"{group}.{'ga'[rank % 2]}"] = share
    return out


def _fragments(channels: Mapping[str, np.ndarray], stems: list[str], per_axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Ids and shares of all samples of each pixel, `[height][width][fragment]`."""
    ids, shares = [], []
    for stem in stems:
        for id_end, share_end in (("r", "g"), ("b", "a")):
            ids.append(_samples(_plane(channels, stem, id_end), per_axis).view(np.uint32))
            shares.append(_samples(_plane(channels, stem, share_end), per_axis) / per_axis**2)
    return np.concatenate(ids, axis=-1), np.concatenate(shares, axis=-1)


def _plane(channels: Mapping[str, np.ndarray], stem: str, end: str) -> np.ndarray:
    name = f"{stem}.{end}"
    return channels[name if name in channels else f"{stem}.{end.upper()}"].astype(np.float32)


def _samples(plane: np.ndarray, per_axis: int) -> np.ndarray:
    """`[height][width][sample]` of a plane with `per_axis` samples of a pixel along each axis."""
    rows = [plane[y::per_axis, x::per_axis] for y in range(per_axis) for x in range(per_axis)]
    return np.ascontiguousarray(np.stack(rows, axis=-1))


def _ranked(ids: np.ndarray, shares: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """The ids with the largest shares, in pairs of ranks; id 0 with share 0 where there are no more."""
    left = np.where(shares > 0.0, shares, 0.0)
    out = []
    while len(out) < MOST_IDS and (len(out) % 2 or not out or left.any()):
        best, most = np.zeros(ids.shape[:2], np.uint32), np.zeros(ids.shape[:2], np.float32)
        for k in range(ids.shape[-1]):
            share = np.where(left[..., k] > 0.0, np.where(ids == ids[..., k : k + 1], left, 0.0).sum(axis=-1), 0.0)
            wins = share > most
            best, most = np.where(wins, ids[..., k], best), np.where(wins, share, most).astype(np.float32)
        left = np.where(ids == best[..., None], 0.0, left)
        out.append((best, most))
    return out
