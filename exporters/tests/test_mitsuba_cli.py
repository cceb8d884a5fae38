"""The command line of the Mitsuba exporter. Skipped where the package mitsuba is not installed."""

import math
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

from thinlens_stack import exr

from . import mitsuba_package

SCRIPT = mitsuba_package.FOLDER / "export.py"
# A red lamp over half of the frame, 2 in front of a thinlens sensor, and sky. $depth is the lamp's distance.
SCENE = """
<scene version="3.0.0">
    <default name="depth" value="2"/>
    <integrator type="path"/>
    <sensor type="thinlens">
        <float name="fov" value="40"/> <string name="fov_axis" value="x"/>
        <float name="aperture_radius" value="0.1"/> <float name="focus_distance" value="4"/>
        <transform name="to_world"><lookat origin="0,0,0" target="0,0,-1" up="0,1,0"/></transform>
        <film type="hdrfilm">
            <integer name="width" value="16"/> <integer name="height" value="8"/> <rfilter type="gaussian"/>
        </film>
        <sampler type="independent"><integer name="sample_count" value="4"/></sampler>
    </sensor>
    <emitter type="constant"><rgb name="radiance" value="0.5"/></emitter>
    <shape type="rectangle">
        <transform name="to_world"><scale value="50"/><translate x="-50" z="-$depth"/></transform>
        <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
        <emitter type="area"><rgb name="radiance" value="2,0,0"/></emitter>
    </shape>
</scene>
"""


@unittest.skipUnless(mitsuba_package.is_installed(), "the package mitsuba is not installed")
class CommandLine(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        (self.folder / "scene.xml").write_text(SCENE)

    def export(self, *arguments: str, variant: str = "scalar_rgb", expected: int = 0) -> str:
        """Runs the script; returns what it says."""
        command = [sys.executable, str(SCRIPT), *arguments, "--variant", variant]
        done = subprocess.run(command, capture_output=True, text=True, cwd=self.folder, check=False)
        self.assertEqual(done.returncode, expected, done.stderr)
        return done.stderr

    def read(self, name: str) -> exr.Part:
        (part,) = exr.read(self.folder / name)
        return part

    def test_a_stack_has_its_layers_and_the_whole_lens(self):
        said = self.export("scene.xml", "-o", "stack.exr")
        self.assertEqual(len(said.splitlines()), 1, said)
        part = self.read("stack.exr")
        focal_length = 18.0 / math.tan(math.radians(20.0))
        expected = {
            "thinlens.kind": "coverage",
            "thinlens.depth_convention": "planar",
            "thinlens.sensor_distance": "focal_length",
            "thinlens.focal_length_mm": focal_length,
            "thinlens.f_number": focal_length / 200.0,
            "thinlens.sensor_width_mm": 36.0,
            "thinlens.focus_distance": 4.0,
        }
        for name, value in expected.items():
            found = part.attributes[name]
            self.assertTrue(found == value or abs(found / value - 1.0) < 1e-4, f"{name}: {found}, not {value}")
        # Lamp and sky reach over the frame's border by their blur, of at most 16 / 36 · 49.5 · 0.1 (1/2 - 1/4) = 0.55
        # px; the distance is rounded up by a pixel.
        self.assertEqual(part.display_window, (0, 0, 15, 7))
        self.assertEqual(part.data_window, (-2, -2, 17, 9))
        self.assertEqual(part.channels["Peel0.Combined.R"].dtype, np.float16)
        lamp, sky = (part.channels[f"Peel{peel}.Combined.R"] for peel in (0, 1))
        np.testing.assert_array_equal(lamp[:, :10], 2.0)
        np.testing.assert_array_equal(part.channels["Peel0.Combined.R"][:, 10:], 0.5)
        np.testing.assert_array_equal(sky[:, :10], 0.5)
        np.testing.assert_allclose(part.channels["Peel0.Depth.Z"][:, :10], 2.0, rtol=1e-5)
        np.testing.assert_array_equal(part.channels["Peel1.Depth.Z"], np.float32(1e10))

    def test_it_runs_from_a_folder_that_holds_the_shared_package_too(self):
        folder = self.folder / "exporter"
        shutil.copytree(SCRIPT.parent, folder)
        shutil.copytree(SCRIPT.parent.parent / "common" / "thinlens_stack", folder / "thinlens_stack")
        command = [sys.executable, str(folder / "export.py"), "scene.xml", "--variant", "scalar_rgb", "-o", "stack.exr"]
        done = subprocess.run(command, capture_output=True, text=True, cwd=self.folder, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("Peel1.Depth.Z", self.read("stack.exr").channels)

    def test_the_other_kinds_have_their_samples(self):
        self.export("scene.xml", "--kind", "supersampled", "--supersample", "3", "--overscan", "1", "-o", "s.exr")
        part = self.read("s.exr")
        self.assertEqual((part.data_window, part.display_window), ((-3, -3, 50, 26), (0, 0, 47, 23)))
        self.assertEqual(part.attributes["thinlens.supersample"], 3)
        self.export("scene.xml", "--kind", "point", "--overscan", "0", "--float", "-o", "p.exr")
        part = self.read("p.exr")
        self.assertEqual((part.data_window, part.attributes["thinlens.kind"]), ((0, 0, 15, 7), "point"))
        self.assertEqual(part.channels["Peel0.Combined.R"].dtype, np.float32)

    def test_frames_are_numbered_and_those_that_are_there_are_skipped(self):
        arguments = ("scene.xml", "-D", "depth=#", "--frames", "2-3", "--overscan", "0", "-o", "out/shot.####.exr")
        self.assertEqual(len(self.export(*arguments).splitlines()), 2)
        for frame in (2, 3):
            np.testing.assert_allclose(self.read(f"out/shot.000{frame}.exr").channels["Peel0.Depth.Z"][0, 0], frame)
        self.assertEqual(self.export(*arguments).count("is there already"), 2)

    def test_what_is_wrong_is_said_with_the_exit_code_of_thinlens(self):
        self.assertIn("missing.xml", self.export("missing.xml", "-o", "a.exr", expected=1))
        self.assertIn("1 sensors", self.export("scene.xml", "--sensor", "2", "-o", "a.exr", expected=1))
        wrong = ("scene.xml", "--kind", "point", "--supersample", "2", "-o", "a.exr")
        self.assertIn("one sample", self.export(*wrong, expected=2))
        self.assertIn("list of frames", self.export("scene.xml", "--frames", "x", "-o", "a.#.exr", expected=2))
        self.assertIn("not from", self.export("scene.xml", "--peels", "0", "-o", "a.exr", expected=2))
        (self.folder / "empty.xml").write_text(re.sub("<shape.*</shape>", "", SCENE, flags=re.DOTALL))
        self.assertIn("no shapes", self.export("empty.xml", "-o", "a.exr", expected=1))
        self.assertEqual(list(self.folder.glob("*.exr")), [])

    def test_the_same_command_makes_the_same_file(self):
        lamps = SCENE.replace('value="50"', 'value="0.3"')
        lamp = lamps[lamps.index("<shape") : lamps.index("</scene>")]
        more = "".join(lamp.replace('x="-50"', f'x="{x}"').replace("2,0,0", f"{x + 2},1,0") for x in (-1, 0, 1))
        floor = lamp[: lamp.index("<emitter")].replace('x="-50" z="-$depth"', 'y="-0.3"') + "</shape>"
        floor = floor.replace('<scale value="0.3"/>', '<scale value="3"/><rotate x="1" angle="-90"/>')
        floor = floor.replace('"reflectance" value="0"', '"reflectance" value="0.5"')
        (self.folder / "lamps.xml").write_text(SCENE[: SCENE.index("<shape")] + more + floor + "</scene>")
        files = [f"{i}.exr" for i in range(4)]
        for name in files:
            self.export("lamps.xml", "--overscan", "0", "-o", name)
        first, *others = ((self.folder / name).read_bytes() for name in files)
        self.assertEqual(others, [first, first, first])

    def test_scalar_and_llvm_variants_agree(self):
        self.export("scene.xml", "-o", "scalar.exr")
        try:
            self.export("scene.xml", "-o", "llvm.exr", variant="llvm_ad_rgb")
        except AssertionError as error:
            self.skipTest(f"the variant llvm_ad_rgb does not run here: {str(error).splitlines()[-1]}")
        scalar, llvm = self.read("scalar.exr"), self.read("llvm.exr")
        self.assertEqual(sorted(scalar.channels), sorted(llvm.channels))
        for name, plane in scalar.channels.items():
            np.testing.assert_allclose(plane, llvm.channels[name], rtol=1e-5, err_msg=name)
