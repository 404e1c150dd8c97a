#!/usr/bin/env python3
"""An engine build that uses an installed lmc: the first build bakes, the second does no work, a touched texture bakes again.

    bake_twice_test.py --build-dir BUILD --source-dir SOURCE      BUILD: an lmc build that is up to date
"""
import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
import unittest

OPTIONS = None
OUTPUTS = ("level.lmc.json", "lightmap.exr", "level.glb", "report.json")


def run(*command):
    done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode != 0:
        raise AssertionError(f"exit code {done.returncode}: {' '.join(command)}\n{done.stdout}")
    return done.stdout


class BakeTwice(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="lmc bake twice ")   # spaces: paths must survive Make syntax
        cls.prefix = os.path.join(cls.folder.name, "prefix")
        run("cmake", "--install", OPTIONS.build_dir, "--prefix", cls.prefix)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def test_installation_is_complete(self):
        for path in ("bin/lmc", "share/lmc/cmake/lmc_bake.cmake", "share/lmc/shaders/LICENSE", "include/lmc/libscene/scene.h"):
            self.assertTrue(os.path.exists(os.path.join(self.prefix, path)), path)
        self.assertIn("bake", run(os.path.join(self.prefix, "bin", "lmc"), "--help"))

    def test_ninja(self):
        if not shutil.which("ninja"):
            self.skipTest("ninja is not installed")
        self.bake_twice("Ninja", lambda text: self.assertIn("no work to do", text))

    def test_unix_makefiles(self):
        if not shutil.which("make"):
            self.skipTest("make is not installed")
        self.bake_twice("Unix Makefiles", lambda text: self.assertNotIn("Baking", text))

    def bake_twice(self, generator, second_build_says):
        project, build = (os.path.join(self.folder.name, generator, name) for name in ("project", "build"))
        shutil.copytree(os.path.join(OPTIONS.source_dir, "cmake", "sample_project"), project)
        samples = os.path.join(OPTIONS.source_dir, "samples")
        for name in os.listdir(samples):
            if name.startswith("textured"):
                shutil.copy(os.path.join(samples, name), project)
        run("cmake", "-S", project, "-B", build, "-G", generator, "-DCMAKE_PREFIX_PATH=" + self.prefix,
            "-DLEVEL=" + os.path.join(project, "textured.gltf"))
        maps = os.path.join(build, "maps")

        def times():
            return {name: os.stat(os.path.join(maps, name)).st_mtime_ns for name in OUTPUTS}

        def touch(name):
            time.sleep(1.1)   # file systems and Make may count whole seconds
            os.utime(os.path.join(project, name))

        self.assertIn("Baking", run("cmake", "--build", build))
        first = times()
        second_build_says(run("cmake", "--build", build))
        self.assertEqual(times(), first, "the second build wrote outputs")
        # Under Make the depfile takes part from the second build on: that build, too, must find nothing to do.
        second_build_says(run("cmake", "--build", build))
        self.assertEqual(times(), first, "the third build wrote outputs")

        for name in ("textured_tiles.png", "textured.bin", "textured.gltf"):
            before = times()
            touch(name)
            self.assertIn("Baking", run("cmake", "--build", build), f"touched {name}")
            self.assertNotEqual(times()["level.lmc.json"], before["level.lmc.json"], f"touched {name}")
            after = times()
            second_build_says(run("cmake", "--build", build))
            self.assertEqual(times(), after, f"the build after the one for {name} wrote outputs")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--build-dir", required=True)
    parser.add_argument("--source-dir", required=True)
    OPTIONS, rest = parser.parse_known_args()
    OPTIONS.build_dir, OPTIONS.source_dir = map(os.path.abspath, (OPTIONS.build_dir, OPTIONS.source_dir))
    unittest.main(argv=[sys.argv[0]] + rest)
