# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""Reflectance at normal incidence and roughness of a material, as values in its node tree, read from its shaders.

A shader that is not read here, one in a node group among them, is taken as one that reflects nothing specularly.
Coats, sheen and thin films are left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from .peel_nodes import Maths

# A number, or the output of a node; a colour, or the output of a node.
Number, Color = Any, Any

BLACK, WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
# Sums of reflectances below this have no roughness.
LEAST = 1e-6
# Shaders without a specular reflection.
DULL = {
    "BACKGROUND",
    "BSDF_DIFFUSE",
    "BSDF_REFRACTION",
    "BSDF_SHEEN",
    "BSDF_TRANSLUCENT",
    "BSDF_TRANSPARENT",
    "EMISSION",
    "HOLDOUT",
    "SUBSURFACE_SCATTERING",
}
SUMS: dict[str, Callable[[float, float], float]] = {
    "ADD": lambda a, b: a + b,
    "SUBTRACT": lambda a, b: a - b,
    "MULTIPLY": lambda a, b: a * b,
    "DIVIDE": lambda a, b: a / b if b else 0.0,
    "MAXIMUM": max,
}


@dataclass(frozen=True)
class Reflectance:
    """How a shader reflects: its colour at normal incidence, and the root of its GGX α."""

    color: Color
    roughness: Number


NONE = Reflectance(BLACK, 1.0)


class Reader:
    """Reads the shaders of one node tree; adds nodes to it for what is not a plain number."""

    def __init__(self, tree: Any) -> None:
        self.maths = Maths(tree)
        # Whether every shader could be read.
        self.is_whole = True

    def read(self, target: Any) -> Reflectance:
        """What is linked to the input `target` of a shader."""
        output = _source(target)
        if output is None:
            return NONE
        node = output.node
        readers = {
            "BSDF_PRINCIPLED": self._principled,
            "BSDF_GLOSSY": self._glossy,
            "BSDF_GLASS": self._glass,
            "BSDF_METALLIC": self._metallic,
            "MIX_SHADER": self._mixed,
            "ADD_SHADER": self._added,
        }
        if node.type in readers:
            return readers[node.type](node)
        self.is_whole &= node.type in DULL
        return NONE

    def _principled(self, node: Any) -> Reflectance:
        level = self._op("MULTIPLY", self._of_index(_value(node, "IOR")), 2.0)
        level = self._op("MULTIPLY", level, _value(node, "Specular IOR Level"))
        clear = self._scaled(_value(node, "Specular Tint"), level)
        color = self._lerp(clear, _value(node, "Base Color"), _value(node, "Metallic"))
        return Reflectance(color, _value(node, "Roughness"))

    def _glossy(self, node: Any) -> Reflectance:
        return Reflectance(_value(node, "Color"), _value(node, "Roughness"))

    def _glass(self, node: Any) -> Reflectance:
        color = self._scaled(_value(node, "Color"), self._of_index(_value(node, "IOR")))
        return Reflectance(color, _value(node, "Roughness"))

    def _metallic(self, node: Any) -> Reflectance:
        roughness = _value(node, "Roughness")
        if node.fresnel_type == "F82":
            return Reflectance(_value(node, "Base Color"), roughness)
        index, extinction = _value(node, "IOR"), _value(node, "Extinction")
        absorbed = self._vector("MULTIPLY", extinction, extinction)
        sides = [self._vector(way, index, WHITE) for way in ("SUBTRACT", "ADD")]
        parts = [self._vector("ADD", self._vector("MULTIPLY", side, side), absorbed) for side in sides]
        return Reflectance(self._vector("DIVIDE", *parts), roughness)

    def _mixed(self, node: Any) -> Reflectance:
        share = self._share(node.inputs[0])
        first, second = self.read(node.inputs[1]), self.read(node.inputs[2])
        return self._sum(first, second, self._op("SUBTRACT", 1.0, share), share)

    def _added(self, node: Any) -> Reflectance:
        return self._sum(self.read(node.inputs[0]), self.read(node.inputs[1]), 1.0, 1.0)

    def _share(self, target: Any) -> Number:
        """The factor of a mix, at normal incidence where it is plainly that of the angle."""
        output = _source(target)
        if output is None:
            return min(max(float(target.default_value), 0.0), 1.0)
        if output.node.type == "FRESNEL":
            return self._of_index(_value(output.node, "IOR"))
        if output.node.type == "LAYER_WEIGHT":
            if output.name == "Facing":
                return 0.0
            rest = self._op("MAXIMUM", self._op("SUBTRACT", 1.0, _value(output.node, "Blend")), 1e-5)
            return self._of_index(self._op("DIVIDE", 1.0, rest))
        return output

    def _of_index(self, index: Number) -> Number:
        """Reflectance of a surface with this index of refraction."""
        root = self._op("DIVIDE", self._op("SUBTRACT", index, 1.0), self._op("ADD", index, 1.0))
        return self._op("MULTIPLY", root, root)

    def _sum(self, first: Reflectance, second: Reflectance, one: Number, other: Number) -> Reflectance:
        """Two shaders with their weights; the roughness of what reflects more counts more."""
        colors = self._scaled(first.color, one), self._scaled(second.color, other)
        weights = [self._mean(color) for color in colors]
        # Smoothness: nothing where nothing is reflected.
        parts = [
            self._op("MULTIPLY", weight, self._op("SUBTRACT", 1.0, part.roughness))
            for weight, part in zip(weights, (first, second), strict=True)
        ]
        total = self._op("MAXIMUM", self._op("ADD", *weights), LEAST)
        smooth = self._op("DIVIDE", self._op("ADD", *parts), total)
        return Reflectance(self._vector("ADD", *colors), self._op("SUBTRACT", 1.0, smooth))

    def _lerp(self, first: Color, second: Color, share: Number) -> Color:
        rest = self._op("SUBTRACT", 1.0, share)
        return self._vector("ADD", self._scaled(first, rest), self._scaled(second, share))

    def _mean(self, color: Color) -> Number:
        if isinstance(color, tuple):
            return sum(color) / 3.0
        return self.maths.vector("DOT_PRODUCT", color, (1.0 / 3.0,) * 3)

    def _scaled(self, color: Color, factor: Number) -> Color:
        if factor == 0.0:
            return BLACK
        if isinstance(factor, float):
            return self._vector("MULTIPLY", color, (factor,) * 3)
        # A number that is linked to a vector is all three of its components.
        return self.maths.vector("MULTIPLY", color, factor)

    def _op(self, operation: str, first: Number, second: Number) -> Number:
        if isinstance(first, float) and isinstance(second, float):
            return SUMS[operation](first, second)
        return self.maths.op(operation, first, second)

    def _vector(self, operation: str, first: Color, second: Color) -> Color:
        if isinstance(first, tuple) and isinstance(second, tuple):
            return tuple(map(SUMS[operation], first, second))
        return self.maths.vector(operation, first, second)


def _source(target: Any) -> Any:
    """The output that is linked to an input, past reroutes; None where nothing is."""
    while target.is_linked:
        output = target.links[0].from_socket
        if output.node.type != "REROUTE":
            return output
        target = output.node.inputs[0]
    return None


def _value(node: Any, name: str) -> Any:
    """A number or colour of a shader, or the output that is linked to it."""
    target = node.inputs[name]
    output = _source(target)
    if output is not None:
        return output
    value = target.default_value
    return float(value) if isinstance(value, int | float) else tuple(map(float, value[:3]))
