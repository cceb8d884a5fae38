"""What the exporters write against the program, whose path is in the environment variable THINLENS."""

import json
import os
import subprocess
import tempfile
import tomllib
import unittest
from pathlib import Path

import numpy as np

from thinlens_stack import VERSION, exr, stack
from thinlens_stack.lens import NOTHING_HIT, Lens
from thinlens_stack.merge import Layer, interleave, merge, split

MANIFEST = Path(__file__).resolve().parents[2] / "Cargo.toml"
EXTENSION = Path(__file__).resolve().parents[1] / "blender" / "blender_manifest.toml"
PROGRAM = os.environ.get("THINLENS")
# CoC radii from -6 to 6 px in the scene below.
LENS = Lens(focal_length_mm=100.0, sensor_width_mm=20.0, f_number=1.0, focus_distance=2.0, blades=6, rotation_deg=10.0)
FRAME = stack.Frame(48, 32, 4)


def scene(samples: int) -> list[Layer]:
    """Three layers of slanted cards with splinters and holes, glass and sky, with S × S samples a pixel."""
    width, height = (samples * length for length in FRAME.wide())
    y, x = np.mgrid[:height, :width] / samples
    random = np.random.default_rng(5)
    layers = []
    for k, nearest in enumerate((1.0, 1.8, 3.5)):
        holes = np.sin(0.3 * x + 2 * k) + np.cos(0.37 * y - k) > (0.4, -0.2, -1.2)[k]
        # Splinters, a fifth of the samples, lie somewhere else.
        splinters = np.where(random.random(x.shape) < 0.2, random.uniform(1.0, 1.5, x.shape), 1.0)
        depth = (nearest + 0.02 * x + 0.013 * y * (k - 1)) * splinters
        alpha = np.where(holes, 1.0, 0.0) * (0.5 if k == 1 else 1.0)
        color = alpha[..., None] * random.uniform(0.1, 0.7, 3) * (1.0 + 0.2 * np.sin(x + y))[..., None]
        layers.append(Layer(color, alpha, np.where(holes, depth, NOTHING_HIT)))
    sky = np.where(np.sin(0.2 * x) > 0.0, 0.3, 0.0)[..., None] + np.zeros(3)
    layers.append(Layer(sky, np.ones_like(x), np.full_like(x, NOTHING_HIT)))
    return [Layer(*(plane.astype(np.float32) for plane in (layer.color, layer.alpha, layer.depth))) for layer in layers]


class Version(unittest.TestCase):
    @unittest.skipUnless(MANIFEST.is_file(), "the exporters are not in the project's tree")
    def test_the_exporters_have_the_version_of_the_program(self):
        self.assertEqual(tomllib.loads(MANIFEST.read_text())["package"]["version"], VERSION)
        self.assertEqual(tomllib.loads(EXTENSION.read_text())["version"], VERSION)


@unittest.skipUnless(PROGRAM, "THINLENS does not name the program")
class Program(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def run_program(self, *arguments: str) -> str:
        done = subprocess.run([PROGRAM, *arguments], capture_output=True, text=True, cwd=self.folder, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def write(self, name: str, layers: list[Layer], kind: stack.Kind, half: bool = False):
        stack.write(self.folder / name, stack.channels(layers, half=half), FRAME, kind, LENS, {})

    def render(self, name: str) -> np.ndarray:
        """The picture by a method that merges supersampled stacks first and then takes every layer."""
        self.run_program(
            "-q", "render", name, "--method", "recursive-gaussian", "--precision", "float", "-o", "out.exr"
        )
        (part,) = exr.read(self.folder / "out.exr")
        return np.stack([part.channels[name] for name in "RGBA"], axis=-1)

    def test_it_merges_a_supersampled_stack_into_the_same_layers(self):
        for samples in (2, 3):
            layers = scene(samples)
            merged = merge(split(layers, samples), LENS, FRAME.width)
            self.assertEqual(len(merged), 6, "two more than the stack has")
            self.write("samples.exr", layers, stack.Kind("supersampled", samples))
            expected = self.render("samples.exr")
            self.assertGreater(expected[..., :3].std(), 0.05, "there is something to see")
            for half, tolerance in ((False, 2e-5), (True, 1e-3)):
                self.write("coverage.exr", merged, stack.Kind("coverage"), half)
                difference = np.abs(self.render("coverage.exr") - expected)
                # Splinters whose distance is a surface's gap up to rounding may go either way.
                self.assertLess(difference.max(), 2e-3)
                self.assertLess(np.mean(difference > tolerance), 0.005)
            # The comparison sees a single layer that is missing in the back.
            self.write("coverage.exr", merged[:-1], stack.Kind("coverage"))
            self.assertGreater(np.abs(self.render("coverage.exr") - expected).max(), 1e-2)

    def test_interleaved_phases_are_a_supersampled_stack(self):
        layers = scene(2)
        again = interleave(split(layers, 2))
        for before, after in zip(layers, again, strict=True):
            np.testing.assert_array_equal(before.color, after.color)

    def test_it_finds_the_lens_and_the_kind_in_the_header(self):
        self.write("stack.exr", merge(split(scene(2), 2), LENS, FRAME.width), stack.Kind("coverage"))
        found = json.loads(self.run_program("inspect", "stack.exr", "--json"))
        text = json.dumps(found)
        for value in ("coverage", "planar"):
            self.assertIn(value, text)
        lens = found["lens"]
        for key, expected in (("focal_length_mm", 100.0), ("f_number", 1.0), ("sensor_width_mm", 20.0), ("blades", 6)):
            self.assertAlmostEqual(lens[key]["value"], expected, places=5)
            self.assertIn("header", json.dumps(lens[key]["origin"]).lower())
