"""OpenEXR files: what is written is read again, by this package and by the reference library."""

import struct
import tempfile
import unittest
from pathlib import Path

import numpy as np

from thinlens_stack import exr
from thinlens_stack.errors import ExportError

try:
    import OpenEXR
except ImportError:
    OpenEXR = None

DATA, DISPLAY = (-3, -2, 33, 40), (0, 0, 30, 38)
ATTRIBUTES = {"thinlens.kind": "coverage", "thinlens.blades": 6, "thinlens.f_number": 1.5, "size": (36.0, 24.0)}


def picture() -> dict[str, np.ndarray]:
    """Channels of all types, of the size of `DATA`, smooth and noisy."""
    random = np.random.default_rng(1)
    height, width = DATA[3] - DATA[1] + 1, DATA[2] - DATA[0] + 1
    ramp = np.linspace(0.0, 4.0, height * width).reshape(height, width)
    return {
        "Peel0.Combined.R": ramp.astype(np.float16),
        "Peel0.Depth.Z": (1e10 * (ramp > 2.0) + ramp).astype(np.float32),
        "noise": random.random((height, width)).astype(np.float32),
        "id": random.integers(0, 2**32, (height, width), np.uint32),
        "a name of more than thirty-one characters": ramp.astype(np.float32),
    }


class RoundTrip(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name) / "new folder" / "picture.exr"

    def write(self, channels=None, attributes=ATTRIBUTES):
        exr.write(self.path, picture() if channels is None else channels, DATA, DISPLAY, attributes)

    def test_what_was_written_is_read(self):
        self.write()
        (part,) = exr.read(self.path)
        self.assertEqual((part.data_window, part.display_window), (DATA, DISPLAY))
        for name, value in ATTRIBUTES.items():
            self.assertEqual(part.attributes[name], value)
        self.assertEqual(sorted(part.channels), sorted(picture()))
        for name, plane in picture().items():
            self.assertEqual(part.channels[name].dtype, plane.dtype)
            np.testing.assert_array_equal(part.channels[name], plane)

    @unittest.skipIf(OpenEXR is None, "the package OpenEXR is not installed")
    def test_the_reference_library_reads_what_was_written(self):
        self.write()
        with OpenEXR.File(str(self.path), separate_channels=True) as file:
            for name, plane in picture().items():
                np.testing.assert_array_equal(file.channels()[name].pixels, plane)
            self.assertEqual(file.header()["thinlens.kind"], "coverage")

    @unittest.skipIf(OpenEXR is None, "the package OpenEXR is not installed")
    def test_what_the_reference_library_writes_is_read_in_every_compression_and_part(self):
        channels = {name: plane for name, plane in picture().items() if name != "id"}
        for compression in (
            OpenEXR.NO_COMPRESSION,
            OpenEXR.RLE_COMPRESSION,
            OpenEXR.ZIPS_COMPRESSION,
            OpenEXR.ZIP_COMPRESSION,
        ):
            for names in ([""], ["a", "b"]):
                header = {"compression": compression, "type": OpenEXR.scanlineimage}
                parts = [OpenEXR.Part({**header}, dict(channels), name=name) for name in names]
                self.path.parent.mkdir(exist_ok=True)
                OpenEXR.File(parts).write(str(self.path))
                found = exr.read(self.path)
                self.assertEqual([part.name for part in found], names)
                for part in found:
                    for name, plane in channels.items():
                        np.testing.assert_array_equal(part.channels[name], plane, f"{compression} {name}")

    def test_a_file_that_cannot_be_written_leaves_the_old_one_and_no_rest(self):
        self.write()
        before = self.path.read_bytes()
        with self.assertRaisesRegex(ExportError, "float64"):
            self.write({"R": np.zeros((43, 37))})
        with self.assertRaisesRegex(ExportError, r"\(43, 37\)"):
            self.write({"R": np.zeros((2, 2), np.float32)})
        self.assertEqual(self.path.read_bytes(), before)
        self.assertEqual([file.name for file in self.path.parent.iterdir()], ["picture.exr"])

    def test_damaged_and_foreign_files_are_named(self):
        self.write()
        whole = self.path.read_bytes()
        for data in (b"", b"PNG and more", whole[:100], whole[:-200], whole[:12] + b"\xff" * 40):
            self.path.write_bytes(data)
            with self.assertRaisesRegex(ExportError, "picture.exr"):
                exr.read(self.path)
        with self.assertRaisesRegex(ExportError, "missing.exr"):
            exr.read(self.path.parent / "missing.exr")

    def test_only_an_openexr_file_is_complete(self):
        self.assertFalse(exr.is_complete(self.path))
        self.write()
        self.assertTrue(exr.is_complete(self.path))
        self.path.write_bytes(struct.pack("<I", 1))
        self.assertFalse(exr.is_complete(self.path))
