"""Scenes whose reflections blur with a depth of their own, for Mitsuba 3: meshes, textures, lights, all made here.

    python scenes.py FOLDER                FOLDER/stone, teapot, facing, unfolded, facing_full and unfolded_full
    python scenes.py FOLDER --scene stone  one of them

Each gets `scene.xml`, with the parameters `focus`, `aperture` (radius; scene units) and `spp`, and a preset for each
focus: `preset.toml` is on a surface, `preset_far.toml` on what is seen in it.

`facing` is a perfect mirror square to the camera with emissive objects reflected in it, and `unfolded` the same without
the mirror: the reflected objects stand behind the hole. Both give the same picture through every lens. In the two
`_full` scenes the mirror fills more than the frame and nothing hides anything else in it, so that the stacks hold all
that a lens can see.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass, field
from pathlib import Path

import mitsuba as mi
import numpy as np

SIZE = (320, 180)
FOCAL_LENGTH_MM, SENSOR_WIDTH_MM = 85.0, 36.0
FIELD_DEG = 2.0 * math.degrees(math.atan(0.5 * SENSOR_WIDTH_MM / FOCAL_LENGTH_MM))
Point = tuple[float, float, float]


@dataclass
class Mesh:
    """Vertices, normals, texture coordinates and triangles."""

    points: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    faces: np.ndarray

    def moved(self, place: Point) -> Mesh:
        """The mesh with its origin at `place`."""
        return Mesh(self.points + np.asarray(place), self.normals, self.uv, self.faces)

    def turned(self, axis: int, angle_deg: float) -> Mesh:
        """The mesh turned about a coordinate axis."""
        turn = np.eye(3)
        a, b = (axis + 1) % 3, (axis + 2) % 3
        cosine, sine = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
        turn[a, a], turn[a, b], turn[b, a], turn[b, b] = cosine, -sine, sine, cosine
        return Mesh(self.points @ turn.T, self.normals @ turn.T, self.uv, self.faces)

    def mirrored(self, z: float) -> Mesh:
        """The mesh as a mirror in the plane at `z` shows it."""
        flip = np.array([1.0, 1.0, -1.0])
        return Mesh(
            self.points * flip + np.array([0.0, 0.0, 2.0 * z]), self.normals * flip, self.uv, self.faces[:, ::-1]
        )

    def write(self, path: Path) -> None:
        """Writes a PLY file."""
        names = ("x", "y", "z", "nx", "ny", "nz", "u", "v")
        vertices = np.concatenate([self.points, self.normals, self.uv], axis=1).astype("<f4")
        faces = np.empty(len(self.faces), [("count", "u1"), ("corners", "<i4", 3)])
        faces["count"], faces["corners"] = 3, self.faces
        header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
        header += [f"property float {name}" for name in names]
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
        path.write_bytes("\n".join([*header, ""]).encode() + vertices.tobytes() + faces.tobytes())


def surface(points: np.ndarray, uv_scale: tuple[float, float] = (1.0, 1.0)) -> Mesh:
    """A mesh of a grid of points, `[row][column][3]`, with smooth normals. Closed directions repeat their first points.

    Seen from outside, columns run to the right where rows run up.
    """
    rows, columns = points.shape[:2]

    def slopes(axis: int) -> np.ndarray:
        grid = np.moveaxis(points, axis, 0)
        if np.allclose(grid[0], grid[-1]):
            padded = np.concatenate([grid[-2:-1], grid, grid[1:2]])
            found = padded[2:] - padded[:-2]
        else:
            found = np.gradient(grid, axis=0)
        return np.moveaxis(found, 0, axis)

    along, up = slopes(1), slopes(0)
    # At a pole the columns meet: the normal is that of the row beside it, averaged.
    normals = np.cross(along, up)
    lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
    normals = normals / np.where(lengths > 0.0, lengths, 1.0)
    for pole, beside in ((0, 1), (-1, -2)):
        if np.allclose(points[pole], points[pole, :1]):
            mean = normals[beside, :-1].mean(axis=0)
            normals[pole] = mean / np.linalg.norm(mean)
    u, v = np.meshgrid(np.linspace(0.0, uv_scale[0], columns), np.linspace(0.0, uv_scale[1], rows))
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).reshape(-1)
    lower = np.stack([corner, corner + 1, corner + columns + 1], axis=1)
    upper = np.stack([corner, corner + columns + 1, corner + columns], axis=1)
    faces = np.concatenate([lower, upper])
    flat = points.reshape(-1, 3)
    areas = np.linalg.norm(
        np.cross(flat[faces[:, 1]] - flat[faces[:, 0]], flat[faces[:, 2]] - flat[faces[:, 0]]), axis=1
    )
    return Mesh(flat, normals.reshape(-1, 3), np.stack([u, v], axis=-1).reshape(-1, 2), faces[areas > 1e-14])


def revolved(profile: list[tuple[float, float]], steps: int = 128, smooth: int = 12) -> Mesh:
    """The surface of revolution about +Y of a profile `(radius, height)` from bottom to top, as a smooth curve."""
    curve = spline(np.array([(r, y, 0.0) for r, y in profile]), smooth)
    angle = np.linspace(0.0, 2.0 * math.pi, steps + 1)
    radius, height = np.maximum(curve[:, :1], 0.0), np.broadcast_to(curve[:, 1:2], (len(curve), steps + 1))
    points = np.stack([radius * np.sin(angle), height, radius * np.cos(angle)], axis=-1)
    points[:, -1] = points[:, 0]
    return surface(points)


def ball(radius: float, uv_scale: tuple[float, float] = (1.0, 1.0)) -> Mesh:
    """A sphere."""
    up, around = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 65), np.linspace(0.0, 2.0 * math.pi, 129)
    points = np.stack(
        [
            np.cos(up)[:, None] * np.sin(around),
            np.broadcast_to(np.sin(up)[:, None], (65, 129)),
            np.cos(up)[:, None] * np.cos(around),
        ],
        axis=-1,
    )
    points[:, -1] = points[:, 0]
    made = surface(radius * points, uv_scale)
    return Mesh(made.points, made.points / radius, made.uv, made.faces)


def rectangle(width: float, height: float, uv_scale: tuple[float, float] = (1.0, 1.0)) -> Mesh:
    """A rectangle in the plane z = 0 that faces +Z."""
    x, y = np.meshgrid([-0.5 * width, 0.5 * width], [-0.5 * height, 0.5 * height])
    return surface(np.stack([x, y, np.zeros_like(x)], axis=-1), uv_scale)


def box(width: float, height: float, depth: float) -> list[Mesh]:
    """The six faces of a box that stands on the origin."""
    middle = (0.0, 0.5 * height, 0.0)
    sides = [(0, width, depth), (90, depth, width), (180, width, depth), (270, depth, width)]
    faces = [rectangle(w, height).moved((0, 0, 0.5 * d)).turned(1, angle) for angle, w, d in sides]
    faces += [rectangle(width, depth).moved((0, 0, 0.5 * height)).turned(0, angle) for angle in (-90, 90)]
    return [face.moved(middle) for face in faces]


def joined(meshes: list[Mesh]) -> Mesh:
    """Several meshes as one."""
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes[:-1])])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)])
    parts = ([getattr(mesh, name) for mesh in meshes] for name in ("points", "normals", "uv"))
    return Mesh(*(np.concatenate(part) for part in parts), faces)


def spline(points: np.ndarray, steps: int) -> np.ndarray:
    """A Catmull-Rom curve through `points`, `[n][3]`. A point that is there twice in a row is a corner."""
    points = np.asarray(points, np.float64)
    is_corner = np.append(np.all(np.isclose(points[1:], points[:-1]), axis=1), False)
    pieces, start = [], 0
    for end in [*np.flatnonzero(is_corner), len(points) - 1]:
        piece = points[start : end + 1]
        start = end + 1
        padded = np.concatenate([2.0 * piece[:1] - piece[1:2], piece, 2.0 * piece[-1:] - piece[-2:-1]])
        t = np.linspace(0.0, 1.0, steps, endpoint=False)[:, None]
        for a, b, c, d in zip(padded, padded[1:], padded[2:], padded[3:], strict=False):
            pieces.append(
                0.5
                * (2.0 * b + (c - a) * t + (2.0 * a - 5.0 * b + 4.0 * c - d) * t**2 + (3.0 * (b - c) + d - a) * t**3)
            )
        pieces.append(piece[-1:])
    return np.concatenate(pieces)


def tube(path: list[Point], radii: list[float], steps: int = 48, smooth: int = 12) -> Mesh:
    """A tube along a smooth path in a plane z = constant."""
    curve = spline(np.array([(x, y, r) for (x, y, _), r in zip(path, radii, strict=True)]), smooth)
    radius, line = curve[:, 2], np.stack([curve[:, 0], curve[:, 1], np.full(len(curve), path[0][2])], axis=1)
    along = np.gradient(line, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(along, (0.0, 0.0, 1.0))
    angle = np.linspace(0.0, 2.0 * math.pi, steps + 1)[None, :, None]
    ring = np.cos(angle) * across[:, None] - np.sin(angle) * np.array([0.0, 0.0, 1.0])
    points = line[:, None] + radius[:, None, None] * ring
    points[:, -1] = points[:, 0]
    return surface(points)


@dataclass
class Scene:
    """A scene file under construction, with the files it names in `folder`."""

    folder: Path
    # The camera: its place and where it looks.
    eye: Point
    target: Point
    f_number: float
    # On a surface, and on what is seen in it; along the optical axis.
    focus: float
    focus_far: float
    max_depth: int
    parts: list[str] = field(default_factory=list)
    count: int = 0

    def add(self, mesh: Mesh, bsdf: str, radiance: str = "") -> None:
        """A mesh with a material and, if it shines, the XML of its radiance."""
        name = f"mesh{self.count}.ply"
        self.count += 1
        mesh.write(self.folder / name)
        light = f'<emitter type="area">{radiance}</emitter>' if radiance else ""
        self.parts.append(f'<shape type="ply"><string name="filename" value="{name}"/>{bsdf}{light}</shape>')

    def texture(
        self, name: str, property_name: str, picture: np.ndarray, tiles: tuple[float, float] = (1.0, 1.0)
    ) -> str:
        """The XML of a texture; `picture` is linear, `[row][column][3]`, from 0 to 1."""
        path = self.folder / f"{name}.png"
        bitmap = mi.Bitmap(picture.astype(np.float32)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.UInt8, True)
        bitmap.write(str(path))
        return (
            f'<texture type="bitmap" name="{property_name}"><string name="filename" value="{path.name}"/>'
            f'<transform name="to_uv"><scale x="{tiles[0]}" y="{tiles[1]}"/></transform></texture>'
        )

    def environment(self, picture: np.ndarray) -> None:
        """The surroundings, `[row][column][3]`; its left edge is at −Z, its middle at +Z."""
        mi.Bitmap(picture.astype(np.float32)).write(str(self.folder / "environment.exr"))
        self.parts.append('<emitter type="envmap"><string name="filename" value="environment.exr"/></emitter>')

    def write(self) -> None:
        """Writes `scene.xml` and the presets."""
        radius = 0.5e-3 * FOCAL_LENGTH_MM / self.f_number
        eye, target = (", ".join(f"{x:.6g}" for x in point) for point in (self.eye, self.target))
        head = f"""<scene version="3.0.0">
<default name="spp" value="1024"/>
<default name="focus" value="{self.focus:.6g}"/>
<default name="aperture" value="{radius:.6g}"/>
<integrator type="path"><integer name="max_depth" value="{self.max_depth}"/>
<integer name="rr_depth" value="64"/></integrator>
<sensor type="thinlens">
<float name="fov" value="{FIELD_DEG:.8g}"/><string name="fov_axis" value="x"/>
<float name="focus_distance" value="$focus"/><float name="aperture_radius" value="$aperture"/>
<transform name="to_world"><lookat origin="{eye}" target="{target}" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="{SIZE[0]}"/><integer name="height" value="{SIZE[1]}"/>
<rfilter type="box"/><string name="component_format" value="float32"/></film>
<sampler type="independent"><integer name="sample_count" value="$spp"/></sampler>
</sensor>
"""
        (self.folder / "scene.xml").write_text("\n".join([head, *self.parts, "</scene>\n"]), encoding="utf-8")
        for name, focus in (("preset", self.focus), ("preset_far", self.focus_far)):
            (self.folder / f"{name}.toml").write_text(
                f"""# {self.folder.name}: 1 unit = 1 m
[lens]
focal_length_mm = {FOCAL_LENGTH_MM:g}
f_number = {self.f_number:g}
focus_distance = {focus:.6g}
sensor_width_mm = {SENSOR_WIDTH_MM:g}
sensor_distance = "focal_length"

[aperture]
blades = 0
rotation_deg = 0

[depth]
convention = "planar"
metres_per_unit = 1.0
""",
                encoding="utf-8",
            )


def rgb(name: str, *color: float) -> str:
    """The XML of a colour."""
    return f'<rgb name="{name}" value="{", ".join(f"{x:g}" for x in color)}"/>'


def matt(*color: float) -> str:
    """A diffuse material of a colour."""
    return f'<bsdf type="twosided"><bsdf type="diffuse">{rgb("reflectance", *color)}</bsdf></bsdf>'


def glossy(alpha: float, *color: float) -> str:
    """Paint under a clear coat."""
    return (
        f'<bsdf type="roughplastic"><string name="distribution" value="ggx"/><float name="alpha" value="{alpha}"/>'
        f"{rgb('diffuse_reflectance', *color)}</bsdf>"
    )


BLACK = matt(0.0, 0.0, 0.0)
MIRROR = '<bsdf type="conductor"><string name="material" value="none"/></bsdf>'


def noise(height: int, width: int, seed: int, waves: int = 40, most: int = 9) -> np.ndarray:
    """A smooth random picture that repeats at its edges, of mean 0 and variance about 1."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width] / np.array([height, width]).reshape(2, 1, 1)
    found = np.zeros((height, width))
    for _ in range(waves):
        a, b = random.integers(-most, most + 1, 2)
        size = 1.0 / math.sqrt(1.0 + 0.3 * (a * a + b * b))
        found += size * np.cos(2.0 * math.pi * (a * x + b * y + random.random()))
    return found / max(found.std(), 1e-9)


def checks(columns: int, rows: int, one: Point, other: Point, size: int = 32) -> np.ndarray:
    """A checkered picture."""
    y, x = np.mgrid[: rows * size, : columns * size] // size
    return np.where(((x + y) % 2)[..., None] == 0, np.array(one), np.array(other))


def labels(seed: int, columns: int = 8, rows: int = 6, size: int = 32) -> np.ndarray:
    """A picture of coloured tiles, each with a ring or a cross, none like its mirror image."""
    random = np.random.default_rng(seed)
    out = np.zeros((rows * size, columns * size, 3))
    y, x = (np.mgrid[:size, :size] + 0.5) / size
    for row in range(rows):
        for column in range(columns):
            ground, mark = random.uniform(0.05, 0.5, 3), random.uniform(0.3, 1.0, 3)
            ring = np.abs(np.hypot(x - 0.4, y - 0.55) - 0.25) < 0.07
            cross = (np.abs(x - 0.6) < 0.08) | (np.abs(y - x * 0.5 - 0.3) < 0.06)
            is_mark = ring if random.random() < 0.5 else cross
            tile = np.where(is_mark[..., None], mark, ground)
            out[row * size : (row + 1) * size, column * size : (column + 1) * size] = tile
    return out


def room(windows: list[tuple[float, float, float, float, Point]], ground: Point, sky: Point, top: Point) -> np.ndarray:
    """Surroundings, 512 × 256: a gradient, and windows `(u, v, width, height, radiance)`, in shares of the picture."""
    v, u = (np.mgrid[:256, :512] + 0.5) / np.array([256, 512]).reshape(2, 1, 1)
    up = np.clip(1.0 - 2.0 * v, -1.0, 1.0)[..., None]
    out = np.where(up > 0.0, np.array(sky) + (np.array(top) - np.array(sky)) * up, np.array(ground) * (1.0 + 0.5 * up))
    for middle_u, middle_v, width, height, radiance in windows:
        du = np.abs((u - middle_u + 0.5) % 1.0 - 0.5)
        dv = np.abs(v - middle_v)
        # Bars divide a window into six panes.
        bars = (np.abs(dv) < 0.04 * height) | (np.abs(du - width / 6.0) < 0.02 * width)
        inside = (du < 0.5 * width) & (dv < 0.5 * height) & ~bars
        out = np.where(inside[..., None], np.array(radiance), out)
    return out


def stone(folder: Path) -> Scene:
    """A polished dark floor, nearly a mirror, seen at a grazing angle; what stands on it is from 1.4 to 5 m away."""
    scene = Scene(folder, (0.0, 0.3, 0.0), (0.0, 0.115, -2.0), 1.4, 1.62, 3.6, 6)
    veins = np.exp(-np.abs(noise(512, 512, 3, 60, 7)) * 14.0)[..., None]
    cloud = 0.5 + 0.5 * np.tanh(noise(512, 512, 5, 60, 12))[..., None]
    picture = 0.012 + 0.03 * cloud * np.array([0.8, 0.9, 1.1]) + 0.25 * veins * np.array([1.0, 0.9, 0.75])
    texture = scene.texture("stone", "diffuse_reflectance", np.clip(picture, 0.0, 1.0), (8.0, 8.0))
    floor = (
        '<bsdf type="roughplastic"><string name="distribution" value="ggx"/><float name="alpha" value="0.008"/>'
        f'<float name="int_ior" value="1.7"/>{texture}</bsdf>'
    )
    scene.add(rectangle(8.0, 8.0).turned(0, -90.0).moved((0.0, 0.0, -4.5)), floor)
    shaft = [(0.0, 0.0), (0.075, 0.0), (0.075, 0.0), (0.075, 0.03), (0.055, 0.045), (0.05, 0.1)]
    shaft += [(0.043, 0.45), (0.06, 0.5), (0.08, 0.52), (0.08, 0.52), (0.08, 0.55), (0.08, 0.55), (0.0, 0.55)]
    bands = scene.texture("bands", "reflectance", checks(1, 12, (0.55, 0.12, 0.08), (0.75, 0.7, 0.6)))
    striped = f'<bsdf type="twosided"><bsdf type="diffuse">{bands}</bsdf></bsdf>'
    for place in ((-0.33, 0.0, -2.2), (0.42, 0.0, -3.1), (-0.75, 0.0, -4.4)):
        scene.add(revolved(shaft, smooth=6).moved(place), striped)
    tiles = scene.texture("tiles", "reflectance", labels(7, 12, 6))
    scene.add(
        ball(0.075).moved((-0.05, 0.075, -1.62)), f'<bsdf type="twosided"><bsdf type="diffuse">{tiles}</bsdf></bsdf>'
    )
    scene.add(joined(box(0.13, 0.22, 0.13)).turned(1, 25.0).moved((0.17, 0.0, -2.0)), matt(0.1, 0.35, 0.5))
    scene.add(joined(box(0.3, 0.1, 0.2)).turned(1, -15.0).moved((0.12, 0.0, -4.2)), matt(0.5, 0.4, 0.08))
    stem, lamp = [(0.0, 0.0), (0.03, 0.0), (0.03, 0.0), (0.008, 0.012), (0.006, 0.1), (0.006, 0.16)], 0.022
    glows = ((1.0, 0.6, 0.25), (0.5, 0.75, 1.0), (1.0, 0.85, 0.5))
    for k, (x, z) in enumerate(((0.24, -1.5), (0.02, -2.6), (-0.18, -3.5), (0.75, -4.9), (0.3, -3.7))):
        scene.add(revolved(stem, 48, 6).moved((x, 0.0, z)), matt(0.2, 0.2, 0.2))
        color = tuple(14.0 * c for c in glows[k % 3])
        scene.add(ball(lamp).moved((x, 0.17, z)), BLACK, rgb("radiance", *color))
    scene.environment(
        room(
            [(0.08, 0.36, 0.07, 0.2, (5.0, 4.6, 4.0)), (0.62, 0.3, 0.15, 0.25, (6.0, 6.0, 6.5))],
            (0.05,) * 3,
            (0.25, 0.3, 0.4),
            (0.5, 0.6, 0.8),
        )
    )
    return scene


def teapot(folder: Path) -> Scene:
    """A pot of polished metal on a checkered table, coloured things around it, windows behind the camera."""
    scene = Scene(folder, (0.0, 0.19, 0.74), (0.0, 0.072, 0.0), 1.6, 0.672, 0.712, 6)
    squares = scene.texture(
        "table", "reflectance", checks(2, 2, (0.6, 0.55, 0.45), (0.08, 0.1, 0.13), 16), (12.0, 12.0)
    )
    scene.add(
        rectangle(1.8, 1.8).turned(0, -90.0), f'<bsdf type="twosided"><bsdf type="diffuse">{squares}</bsdf></bsdf>'
    )
    metal = '<bsdf type="conductor"><string name="material" value="Ag"/></bsdf>'
    body = [(0.0, 0.0), (0.045, 0.0), (0.045, 0.0), (0.047, 0.006), (0.05, 0.01), (0.068, 0.03), (0.078, 0.055)]
    body += [(0.073, 0.082), (0.055, 0.102), (0.046, 0.108), (0.044, 0.108), (0.044, 0.108), (0.0, 0.108)]
    scene.add(revolved(body), metal)
    lid = [
        (0.0, 0.1085),
        (0.045, 0.1085),
        (0.045, 0.1085),
        (0.0455, 0.111),
        (0.04, 0.117),
        (0.022, 0.124),
        (0.007, 0.127),
    ]
    lid += [(0.005, 0.131), (0.009, 0.137), (0.011, 0.143), (0.008, 0.149), (0.0, 0.151)]
    scene.add(revolved(lid), metal)
    spout = [(0.055, 0.045, 0.0), (0.085, 0.05, 0.0), (0.105, 0.075, 0.0), (0.118, 0.1, 0.0), (0.132, 0.108, 0.0)]
    scene.add(tube(spout, [0.022, 0.018, 0.011, 0.009, 0.0085]), metal)
    handle = [
        (-0.052, 0.095, 0.0),
        (-0.085, 0.106, 0.0),
        (-0.118, 0.09, 0.0),
        (-0.116, 0.055, 0.0),
        (-0.09, 0.034, 0.0),
        (-0.066, 0.03, 0.0),
    ]
    scene.add(tube(handle, [0.006, 0.007, 0.0075, 0.0075, 0.007, 0.006]), metal)
    tiles = scene.texture("tiles", "reflectance", labels(11, 12, 6))
    scene.add(ball(0.03).moved((0.1, 0.03, 0.1)), f'<bsdf type="twosided"><bsdf type="diffuse">{tiles}</bsdf></bsdf>')
    scene.add(ball(0.035).moved((-0.13, 0.035, 0.09)), matt(0.6, 0.08, 0.05))
    scene.add(joined(box(0.05, 0.05, 0.05)).turned(1, 30.0).moved((-0.06, 0.0, 0.2)), matt(0.08, 0.4, 0.15))
    scene.add(joined(box(0.06, 0.16, 0.06)).turned(1, 20.0).moved((0.17, 0.0, -0.12)), matt(0.7, 0.5, 0.06))
    scene.add(joined(box(0.08, 0.1, 0.05)).turned(1, -20.0).moved((-0.2, 0.0, -0.2)), matt(0.1, 0.2, 0.6))
    # Behind the camera's plane or above the frame: seen in the pot only.
    scene.add(joined(box(0.1, 0.25, 0.1)).turned(1, 40.0).moved((0.3, 0.0, 0.45)), matt(0.55, 0.15, 0.45))
    scene.add(ball(0.06).moved((-0.3, 0.06, 0.4)), matt(0.1, 0.5, 0.5))
    windows = [
        (0.42, 0.33, 0.1, 0.2, (9.0, 8.6, 8.0)),
        (0.6, 0.33, 0.1, 0.2, (9.0, 8.6, 8.0)),
        (0.2, 0.3, 0.08, 0.24, (5.0, 5.6, 7.0)),
    ]
    scene.environment(room(windows, (0.12, 0.1, 0.09), (0.35, 0.36, 0.38), (0.7, 0.75, 0.85)))
    return scene


MIRROR_Z = -2.0


def reflected_objects(scene: Scene) -> list[tuple[Mesh, str, bool]]:
    """What `facing` reflects: mesh, radiance, and whether the camera sees it directly, too, in front of the mirror."""
    back = scene.texture("back", "radiance", labels(21, 16, 10) * 0.8)
    card = scene.texture("card", "radiance", checks(9, 7, (0.8, 0.7, 0.5), (0.05, 0.1, 0.3)))
    globe = scene.texture("globe", "radiance", labels(22, 12, 6))
    things = [(rectangle(7.0, 4.0).turned(1, 180.0).moved((0.0, 0.0, 2.5)), back, False)]
    things += [(rectangle(0.55, 0.4).turned(1, 200.0).moved((-0.38, 0.13, 0.4)), card, False)]
    things += [(ball(0.13).moved((0.4, -0.15, 0.9)), globe, False)]
    things += [(ball(0.05).moved((0.13, 0.1, -1.45)), globe, True)]
    things += [
        (ball(0.015).moved((x, y, z)), rgb("radiance", 6.0, 5.0, 3.0), False)
        for x, y, z in ((0.35, 0.3, 1.6), (-0.1, -0.33, 1.2))
    ]
    return things


def facing(folder: Path, unfolded: bool = False) -> Scene:
    """A mirror square to the camera in a hole of a black wall, or that hole with what it reflects behind it."""
    scene = Scene(folder, (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 1.4, -MIRROR_Z, -2.0 * MIRROR_Z + 0.4, 3)
    width, height = 0.7, 0.38
    if not unfolded:
        scene.add(rectangle(width, height).moved((0.0, 0.0, MIRROR_Z)), MIRROR)
    wall = [rectangle(2.0, 2.0).moved((side * (1.0 + 0.5 * width), 0.0, MIRROR_Z)) for side in (-1, 1)]
    wall += [rectangle(width, 2.0).moved((0.0, side * (1.0 + 0.5 * height), MIRROR_Z)) for side in (-1, 1)]
    # Its edge shines a little, so that the focus on the mirror's plane shows.
    scene.add(joined(wall), BLACK, rgb("radiance", 0.1, 0.08, 0.06))
    for mesh, radiance, is_seen in reflected_objects(scene):
        if is_seen or not unfolded:
            scene.add(mesh, BLACK, radiance)
        if unfolded:
            scene.add(mesh.mirrored(MIRROR_Z), BLACK, radiance)
    return scene


def facing_full(folder: Path, unfolded: bool = False) -> Scene:
    """A mirror larger than the frame; in it one wavy textured surface that hides no part of itself."""
    scene = Scene(folder, (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 1.4, -MIRROR_Z, -2.0 * MIRROR_Z + 0.9, 3)
    y, x = np.mgrid[-1.5:1.5:121j, -2.5:2.5:201j]
    depth = 0.9 + 0.5 * x + 0.12 * np.sin(5.0 * y + 1.0)
    # Facing −Z: columns run to the left.
    # Off the middle: rays through the middles of pixels must not meet edges of triangles, which let a few of them pass.
    sheet = surface(np.stack([-x, y, depth], axis=-1)).moved((0.00371, 0.00229, 0.0))
    radiance = scene.texture("sheet", "radiance", labels(31, 40, 24))
    scene.add(sheet.mirrored(MIRROR_Z) if unfolded else sheet, BLACK, radiance)
    if not unfolded:
        scene.add(rectangle(3.0, 2.0).moved((0.0113, 0.0271, MIRROR_Z)), MIRROR)
    return scene


SCENES = {
    "stone": stone,
    "teapot": teapot,
    "facing": facing,
    "unfolded": lambda folder: facing(folder, True),
    "facing_full": facing_full,
    "unfolded_full": lambda folder: facing_full(folder, True),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--scene", choices=SCENES, help="one scene; default: all")
    options = parser.parse_args()
    mi.set_variant("scalar_rgb")
    for name in [options.scene] if options.scene else SCENES:
        folder = options.folder / name
        folder.mkdir(parents=True, exist_ok=True)
        SCENES[name](folder).write()


if __name__ == "__main__":
    main()
