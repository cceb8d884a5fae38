"""Evaluation of a function of many lanes, in scalar and in vectorised variants of Mitsuba."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import drjit as dr
import mitsuba as mi
import numpy as np

# Lanes that are evaluated at a time; bounds the memory.
LANES_AT_A_TIME = 1 << 20


def is_scalar() -> bool:
    """Whether the variant works on one lane at a time."""
    return mi.variant().startswith("scalar")


def evaluate(
    function: Callable[..., Sequence],
    columns: Sequence[np.ndarray],
    prepare: Callable[[int, int], None] = lambda first, count: None,
    per_block: int = 1,
) -> list[np.ndarray]:
    """`function` of the numbers in `columns`, arrays `[lane]`; its results as float64 arrays `[lane]`.

    The function gets one `mi.Float` a column and returns `mi.Float`s or masks. Before each block of lanes, of a
    multiple of `per_block`, `prepare` is called with its first lane and their number; a scalar variant has a block a
    lane.
    """
    count = len(columns[0])
    if is_scalar():
        rows = []
        for i in range(count):
            prepare(i, 1)
            rows.append(function(*(float(column[i]) for column in columns)))
        return [np.array(column, np.float64) for column in zip(*rows, strict=True)]
    block = max(1, LANES_AT_A_TIME // per_block) * per_block
    parts = []
    for first in range(0, count, block):
        lanes = min(block, count - first)
        prepare(first, lanes)
        found = function(*(mi.Float(column[first : first + lanes].astype(np.float32)) for column in columns))
        dr.eval(*found)
        parts.append([np.broadcast_to(np.array(value, np.float64), (lanes,)) for value in found])
    return [np.concatenate(column) for column in zip(*parts, strict=True)]
