"""The program is found, called with the given flags, and its rejections are passed on."""

import os
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path
from unittest import mock

from source import alight, stand_in

from alight import _program


class Arguments(unittest.TestCase):
    def test_flags_as_the_command_line_has_them(self):
        flags = {"seed": 1, "motion_scale": 0.5, "keep_mean": True, "winds": [4, 6], "hull": None, "quick": False}
        written = ["--seed=1", "--motion-scale=0.5", "--keep-mean", "--winds=4,6"]
        self.assertEqual(_program.arguments(flags), written)

    def test_value_with_a_hyphen_is_no_flag(self):
        self.assertEqual(_program.arguments({"scenario": Path("-x.toml")}), ["--scenario=-x.toml"])


class Refusals(unittest.TestCase):
    def test_unknown_flag(self):
        with self.assertRaisesRegex(alight.AlightError, "--no-such-flag") as raised:
            alight.trial(no_such_flag=True)
        self.assertEqual(raised.exception.code, 2)

    def test_bad_value(self):
        for fly in (lambda: alight.trial(sea="loud"), lambda: alight.trials(2, sea="loud")):
            with self.assertRaisesRegex(alight.AlightError, "loud") as raised:
                fly()
            self.assertEqual(raised.exception.code, 2)

    def test_json_is_the_modules_own(self):
        with self.assertRaisesRegex(alight.AlightError, "--json") as raised:
            alight.trial(json=True)
        self.assertEqual(raised.exception.code, 2)

    def test_unknown_study(self):
        with self.assertRaisesRegex(alight.AlightError, "nonsense.*table2") as raised:
            alight.study("nonsense")
        self.assertEqual(raised.exception.code, 2)


class Place(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.places = {name: os.path.join(directory.name, name) for name in ("named", "scripts", "path")}
        for place in self.places.values():
            os.mkdir(place)
        self.programs = {name: stand_in(place, "echo '{}'") for name, place in self.places.items()}
        kept = {"PATH": self.places["path"], "ALIGHT": self.programs["named"]}
        for patch in (
            mock.patch.dict(os.environ, kept),
            mock.patch.object(_program, "_scripts", lambda: [self.places["scripts"]]),
        ):
            patch.start()
            self.addCleanup(patch.stop)

    def test_variable_then_scripts_then_path(self):
        self.assertEqual(alight.program(), self.programs["named"])
        del os.environ["ALIGHT"]
        self.assertEqual(alight.program(), self.programs["scripts"])
        os.remove(self.programs["scripts"])
        self.assertEqual(alight.program(), self.programs["path"])

    def test_nowhere_names_every_place(self):
        del os.environ["ALIGHT"]
        os.remove(self.programs["scripts"])
        os.remove(self.programs["path"])
        with self.assertRaises(alight.AlightError) as raised:
            alight.trial(seed=1)
        for part in (self.places["scripts"], "PATH", "ALIGHT"):
            self.assertIn(part, str(raised.exception))

    def test_variable_that_names_nothing(self):
        # The program on PATH is not used instead, because the caller has named another.
        os.environ["ALIGHT"] = os.path.join(self.places["named"], "other")
        with self.assertRaisesRegex(alight.AlightError, "ALIGHT=.*other"):
            alight.trial(seed=1)

    def test_time_that_ran_out(self):
        os.environ["PATH"] += ":/usr/bin:/bin"
        os.environ["ALIGHT"] = stand_in(self.places["named"], "exec sleep 60")
        with self.assertRaisesRegex(alight.AlightError, "timeout_s") as raised:
            alight.trial(seed=1, timeout_s=0.2)
        self.assertIsNone(raised.exception.code)

    def test_program_that_dies(self):
        os.environ["ALIGHT"] = stand_in(self.places["named"], "echo half an answer; kill -9 $$")
        with self.assertRaisesRegex(alight.AlightError, "alight trial --seed=1") as raised:
            alight.trial(seed=1)
        self.assertEqual(raised.exception.code, -9)

    def test_program_that_answers_no_json(self):
        os.environ["ALIGHT"] = stand_in(self.places["named"], "echo '{\"outcome\":'")
        with self.assertRaises(alight.AlightError):
            alight.trial(seed=1)


class Dependencies(unittest.TestCase):
    def test_without_any_package(self):
        # -S: a Python without site-packages. Finding the program and its rejections need no package.
        where = str(Path(alight.__file__).resolve().parents[1])
        asked = (
            "import sys; sys.path.insert(0, sys.argv[1]); import alight; alight.program()\n"
            "try: alight.trial(sea='loud')\n"
            "except alight.AlightError as error: assert error.code == 2, error\n"
            "try: alight.read(__import__('alight').__file__)\n"
            "except ImportError as error: print(error)\n"
        )
        environment = dict(os.environ, ALIGHT=alight.program())
        # A wheel's module is among the packages that must be missing, so a separate copy is used.
        with tempfile.TemporaryDirectory() as directory:
            shutil.copytree(Path(where) / "alight", Path(directory) / "alight")
            command = [sys.executable, "-S", "-c", asked, directory]
            done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=environment)
        self.assertEqual((done.returncode, b"pip install mcap" in done.stdout), (0, True), done.stdout)


if __name__ == "__main__":
    unittest.main()
