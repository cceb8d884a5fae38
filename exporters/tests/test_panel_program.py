"""The program thinlens is found, or the user is told where it was looked for."""

import os
import stat
import tempfile
import unittest
from pathlib import Path
from unittest import mock

from blender import program
from blender.shared import ExportError


def script(folder: str, text: str, name: str = "thinlens") -> str:
    """A shell script that can be run."""
    path = Path(folder) / name
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


@unittest.skipIf(os.name == "nt", "shell scripts stand for programs")
class Program(unittest.TestCase):
    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name

    def refusal(self, preferred: str) -> str:
        with self.assertRaises(ExportError) as caught:
            program.check(preferred)
        return str(caught.exception)

    def test_a_preferred_program_is_taken_with_its_version(self) -> None:
        path = script(self.folder, "echo thinlens 7.8.9")
        self.assertEqual(program.check(path), program.Program(path, "7.8.9"))

    def test_a_folder_stands_for_the_program_in_it(self) -> None:
        path = script(self.folder, "echo thinlens 1.0.0")
        self.assertEqual(program.find(self.folder), path)

    def test_without_a_preference_it_is_looked_for_on_the_search_path(self) -> None:
        path = script(self.folder, "echo thinlens 1.0.0")
        with mock.patch.dict(os.environ, {"PATH": self.folder}):
            self.assertEqual(program.find(), path)

    def test_a_short_search_path_is_completed_by_the_folder_of_cargo(self) -> None:
        cargo = Path(self.folder) / ".cargo" / "bin"
        cargo.mkdir(parents=True)
        path = script(str(cargo), "echo thinlens 1.0.0")
        with mock.patch.dict(os.environ, {"PATH": "/nowhere", "HOME": self.folder}):
            self.assertEqual(program.find(), path)

    def test_a_missing_program_is_an_error_that_says_what_to_do(self) -> None:
        with mock.patch.dict(os.environ, {"PATH": "/nowhere", "HOME": self.folder}):
            text = self.refusal("")
        self.assertIn("was not found", text)
        self.assertIn("help: install thinlens", text)

    def test_a_preferred_program_that_is_missing_is_not_replaced_by_another(self) -> None:
        script(self.folder, "echo thinlens 1.0.0")
        with mock.patch.dict(os.environ, {"PATH": self.folder}):
            self.assertIn("found: /nowhere/thinlens", self.refusal("/nowhere/thinlens"))

    def test_a_file_that_cannot_be_run_is_an_error(self) -> None:
        path = Path(self.folder) / "thinlens"
        path.write_text("thinlens 1.0.0")
        self.assertIn("is not a program", self.refusal(str(path)))

    def test_another_program_is_an_error_that_says_what_it_printed(self) -> None:
        text = self.refusal(script(self.folder, "echo lens grinder"))
        self.assertIn("is not thinlens", text)
        self.assertIn("found: lens grinder", text)

    def test_a_program_that_fails_is_an_error(self) -> None:
        self.assertIn("exit code 3", self.refusal(script(self.folder, "exit 3")))


if __name__ == "__main__":
    unittest.main()
