#!/usr/bin/env python3
"""What the program promises to a user: exit codes, messages, streams, files, the same bytes for any number of threads.

    cli_test.py --lmc BUILD/bin/lmc --source-dir SOURCE [unittest's own arguments]
"""
import argparse
import json
import math
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest

OPTIONS = None
VERBS = ("bake", "plan", "shade", "compare")
SAME_EVERY_TIME = ("ao.exr", "ao.png", "lightmap.exr", "level.glb", "level.lmc.json")
FAST = ("--preset", "draft")


def lmc(*arguments, **more):
    return subprocess.run([OPTIONS.lmc, *arguments], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=600, **more)


def sample(name):
    return os.path.join(OPTIONS.source_dir, "samples", name)


def read_glb(path):
    with open(path, "rb") as f:
        data = f.read()
    size = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20:20 + size]), data[20 + size:]


def write_glb(path, doc, rest):
    text = json.dumps(doc).encode()
    text += b" " * (-len(text) % 4)
    with open(path, "wb") as f:
        f.write(struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON") + text + rest)


def content(folder):
    """{path: bytes} of all files below a folder, but for the journal that a bake goes on from (resume_test.py); None when there is no folder."""
    if not os.path.isdir(folder):
        return None
    out = {}
    for root, folders, files in os.walk(folder):
        if ".lmc-resume" in folders:
            folders.remove(".lmc-resume")
        for name in files:
            path = os.path.join(root, name)
            with open(path, "rb") as f:
                out[os.path.relpath(path, folder)] = f.read()
    return out


class Case(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="lmc-cli-")
        self.addCleanup(folder.cleanup)
        self.folder = folder.name
        self.out = os.path.join(self.folder, "out")

    def path(self, *names):
        return os.path.join(self.folder, *names)

    def bake(self, level, *arguments, out=None):
        """A bake that must succeed, and its report."""
        done = lmc("bake", level, "-o", out or self.out, *FAST, *arguments)
        self.assertEqual(done.returncode, 0, done.stderr)
        with open(os.path.join(out or self.out, "report.json")) as f:
            return done, json.load(f)


class Refusals(Case):
    """Each with no OUT before, and over an OUT that was baked before: nothing is made, nothing is lost."""

    @classmethod
    def setUpClass(cls):
        cls.old = tempfile.TemporaryDirectory(prefix="lmc-cli-old-")
        done = lmc("bake", sample("furnace.glb"), "-o", os.path.join(cls.old.name, "out"), *FAST)
        assert done.returncode == 0, done.stderr

    @classmethod
    def tearDownClass(cls):
        cls.old.cleanup()

    def refused(self, level, code, *arguments, names=None):
        for had_outputs in (False, True):
            with self.subTest(had_outputs=had_outputs):
                if had_outputs:
                    shutil.copytree(os.path.join(self.old.name, "out"), self.out)
                before = content(self.out)
                done = lmc("bake", level, "-o", self.out, *arguments)
                self.assertEqual(done.returncode, code, done.stderr)
                errors = [line for line in done.stderr.splitlines() if "error:" in line]
                self.assertEqual(len(errors), 1, done.stderr)
                self.assertIn(names or os.path.basename(level), errors[0])
                self.assertEqual(done.stdout, "")
                # An empty folder that was made for the outputs is no output.
                self.assertEqual(content(self.out) or None, before)
        return errors[0]

    def test_level_that_is_not_there(self):
        self.refused(self.path("nowhere.glb"), 2)

    def test_level_that_is_a_folder(self):
        os.mkdir(self.path("folder.glb"))
        self.refused(self.path("folder.glb"), 2)

    def test_level_cut_short(self):
        with open(sample("two_rooms.glb"), "rb") as f:
            data = f.read()
        for share in (0.0, 0.25, 0.5, 0.99):
            with self.subTest(share=share):
                shutil.rmtree(self.out, ignore_errors=True)
                with open(self.path("cut.glb"), "wb") as f:
                    f.write(data[:int(share * len(data))])
                self.refused(self.path("cut.glb"), 3)

    def test_level_without_light_map_uvs(self):
        doc, rest = read_glb(sample("two_rooms.glb"))
        for mesh in doc["meshes"]:
            for primitive in mesh["primitives"]:
                del primitive["attributes"]["TEXCOORD_1"]
        write_glb(self.path("bare.glb"), doc, rest)
        self.assertIn("TEXCOORD_1", self.refused(self.path("bare.glb"), 4, "--uv", "keep"))

    def test_required_extension_that_nobody_knows(self):
        doc, rest = read_glb(sample("two_rooms.glb"))
        for k in ("extensionsUsed", "extensionsRequired"):
            doc.setdefault(k, []).append("EXT_from_tomorrow")
        write_glb(self.path("tomorrow.glb"), doc, rest)
        self.assertIn("EXT_from_tomorrow", self.refused(self.path("tomorrow.glb"), 4))

    def test_missing_texture(self):
        for name in ("textured.gltf", "textured.bin", "textured_tiles.png", "textured_panel.png"):   # the lattice is left behind
            shutil.copy(sample(name), self.folder)
        self.assertIn("textured_lattice.png", self.refused(self.path("textured.gltf"), 2))

    def test_overlapping_light_map_uvs(self):
        doc, rest = read_glb(sample("furnace.glb"))
        for mesh in doc["meshes"]:
            for primitive in mesh["primitives"]:
                primitive["attributes"]["TEXCOORD_1"] = primitive["attributes"]["TEXCOORD_0"]
        write_glb(self.path("overlap.glb"), doc, rest)
        self.refused(self.path("overlap.glb"), 3, "--uv", "keep")

    def test_unknown_option(self):
        self.refused(sample("furnace.glb"), 1, "--no-such-option", names="--no-such-option")

    def test_option_out_of_range(self):
        self.refused(sample("furnace.glb"), 1, "--max-error", "0", names="--max-error")

    def test_out_that_is_a_file(self):
        with open(self.out, "w") as f:
            f.write("mine")
        done = lmc("bake", sample("furnace.glb"), "-o", self.out, *FAST)
        self.assertEqual(done.returncode, 2, done.stderr)
        with open(self.out) as f:
            self.assertEqual(f.read(), "mine")

    def test_level_that_the_outputs_would_overwrite(self):
        shutil.copy(sample("furnace.glb"), self.path("level.glb"))
        before = content(self.folder)
        done = lmc("bake", self.path("level.glb"), "-o", self.folder, *FAST)
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertEqual(content(self.folder), before)

    def test_a_folder_in_the_place_of_an_output(self):
        shutil.copytree(os.path.join(self.old.name, "out"), self.out)
        os.remove(os.path.join(self.out, "report.json"))
        os.mkdir(os.path.join(self.out, "report.json"))
        before = content(self.out)
        done = lmc("bake", sample("furnace.glb"), "-o", self.out, *FAST, "--seed", "2")
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertEqual(content(self.out), before)

    def test_depfile_that_cannot_be_written(self):
        shutil.copytree(os.path.join(self.old.name, "out"), self.out)
        before = content(self.out)
        os.mkdir(self.path("d"))
        done = lmc("bake", sample("furnace.glb"), "-o", self.out, *FAST, "--seed", "2", "--depfile", self.path("d"))
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertEqual(content(self.out), before)

    def test_dense_solver_with_passes(self):
        self.refused(sample("furnace.glb"), 1, "--solver", "dense", "--passes", "2", names="--passes")

    def test_out_that_cannot_be_written(self):
        if os.geteuid() == 0:
            self.skipTest("root may write anywhere")
        os.mkdir(self.path("locked"), 0o555)
        done = lmc("bake", sample("furnace.glb"), "-o", self.path("locked", "out"), *FAST)
        self.assertEqual(done.returncode, 2, done.stderr)


class CommandLine(Case):
    def test_help_of_every_verb(self):
        for verb in ((),) + tuple((v,) for v in VERBS):
            with self.subTest(verb=verb):
                done = lmc(*verb, "--help")
                self.assertEqual((done.returncode, done.stderr), (0, ""))
                self.assertIn("lmc", done.stdout)

    def test_nothing_and_nonsense(self):
        for arguments in ((), ("frobnicate",), ("bake",), ("bake", sample("furnace.glb")), ("compare", "a")):
            with self.subTest(arguments=arguments):
                done = lmc(*arguments)
                self.assertEqual(done.returncode, 1, done.stderr)
                self.assertEqual(done.stdout, "")
                self.assertEqual(done.stderr.count("error:"), 1, done.stderr)

    def test_plan_writes_nothing_and_names_every_effect(self):
        before = content(os.path.dirname(sample("court.glb")))
        done = lmc("plan", sample("court.glb"), cwd=self.folder)
        self.assertEqual(done.returncode, 0, done.stderr)
        for effect in ("direct", "shadow", "area", "sky", "bounce"):
            self.assertIn(effect, done.stdout)
        self.assertEqual(content(self.folder), {})
        self.assertEqual(content(os.path.dirname(sample("court.glb"))), before)


class Bakes(Case):
    def test_streams_and_report(self):
        done, report = self.bake(sample("textured.gltf"), "--json")
        self.assertEqual(json.loads(done.stdout), report)
        self.assertEqual(sorted(content(self.out)), sorted(SAME_EVERY_TIME + ("report.json",)))
        self.assertNotIn("warning:", done.stderr)
        self.assertEqual(report["warnings"], [])
        self.assertLessEqual(report["error"]["estimate"], report["error"]["bound95"])
        self.assertLess(report["error"]["bound95"], 0.08)
        self.assertLess(abs(report["energy"]["balance"]), 0.005)
        self.assertGreater(report["rays"]["total"], 0)
        self.assertGreater(report["texels"]["covered"], 0)
        self.assertGreater(report["peak_memory_bytes"], 0)
        for stage in report["stages"]:
            self.assertGreaterEqual(stage["seconds"], 0.0)
            self.assertGreaterEqual(stage["rays"], 0)
        for step in report["plan"]:
            self.assertTrue(step["because"], step)
        quiet, _ = self.bake(sample("textured.gltf"))
        self.assertEqual(quiet.stdout, "")

    def test_same_bytes_for_any_number_of_threads(self):
        first = None
        for threads in ("1", "2", "7"):
            out = self.path("j" + threads)
            self.bake(sample("textured.gltf"), "-j", threads, out=out)
            files = {name: data for name, data in content(out).items() if name in SAME_EVERY_TIME}
            first = first or files
            for name in SAME_EVERY_TIME:
                if files[name] != first[name]:
                    at = next((i for i, (a, b) in enumerate(zip(files[name], first[name])) if a != b), min(len(files[name]), len(first[name])))
                    self.fail(f"{name} with -j {threads} differs from -j 1, first at byte {at}")

    def test_patches_are_dumped_as_a_mesh_and_a_picture(self):
        self.bake(sample("furnace.glb"))
        without = content(self.out)
        _, report = self.bake(sample("furnace.glb"), "--dump", "patches")
        files = content(self.out)
        self.assertEqual(sorted(set(files) - set(without)), ["patches.obj", "patches.png"])
        self.assertEqual(files["lightmap.exr"], without["lightmap.exr"])
        self.assertEqual(files["patches.png"][:8], b"\x89PNG\r\n\x1a\n")
        self.assertEqual(struct.unpack(">II", files["patches.png"][16:24]), (report["maps"][0]["width"], report["maps"][0]["height"]))
        vertices, faces, groups = [], 0, 0
        area = 0.0
        for line in files["patches.obj"].decode().splitlines():
            word = line.split()
            if word[0] == "v":
                vertices.append(tuple(map(float, word[1:])))
            elif word[0] == "g":
                groups += 1
            elif word[0] == "f":
                a, b, c = (vertices[int(i) - 1] for i in word[1:])
                u, v = [b[k] - a[k] for k in range(3)], [c[k] - a[k] for k in range(3)]
                n = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
                area += 0.5 * sum(x * x for x in n) ** 0.5
                faces += 1
        self.assertEqual((groups, faces), (report["patches"]["count"], report["patches"]["faces"]))
        self.assertAlmostEqual(area, 2.0 * (3.0 * 2.4 + 3.0 * 4.0 + 2.4 * 4.0), delta=1e-4)

    def test_seams_are_closed_where_the_surface_is_smooth(self):
        _, closed = self.bake(sample("curved.glb"), "--dump", "seams")
        files = content(self.out)
        side = closed["maps"][0]["width"]
        self.assertEqual(struct.unpack(">II", files["seams.png"][16:24]), (2 * side + 8, side))
        step = [s for s in closed["plan"] if s["effect"] == "seams"][0]
        seams = closed["seams"]
        self.assertEqual((step["run"], step["because"]), (True, f"{seams['pairs']} chart edges meet on smooth surfaces"))
        # Twelve edges of the ball's cube of eight quads each; the column's three cuts.
        self.assertEqual(seams["pairs"], 12 * 8 + 3)
        self.assertLess(seams["after"]["largest_lx"], seams["before"]["largest_lx"] / 5.0)
        self.assertLess(seams["after"]["rms"], seams["before"]["rms"] / 5.0)
        self.assertGreater(seams["texels_moved"], 0)
        self.assertLessEqual(seams["texels_moved"], seams["texels"])
        self.assertEqual(closed["padding"]["contested"], 0)
        _, left = self.bake(sample("curved.glb"), "--effects=-seams")
        self.assertEqual([s["because"] for s in left["plan"] if s["effect"] == "seams"], ["--effects -seams"])
        self.assertEqual(left["seams"]["samples"], 0)
        self.assertNotEqual(content(self.out)["lightmap.exr"], files["lightmap.exr"])
        # Creases alone: the stage changes no byte.
        _, none = self.bake(sample("two_rooms.glb"))
        self.assertEqual([s["because"] for s in none["plan"] if s["effect"] == "seams"], ["no smooth seam"])
        self.assertGreater(none["seams"]["creases"], 0)
        with_stage = content(self.out)["lightmap.exr"]
        self.bake(sample("two_rooms.glb"), "--effects=-seams")
        self.assertEqual(content(self.out)["lightmap.exr"], with_stage)

    def test_memory_never_changes_the_bytes(self):
        done, report = self.bake(sample("textured.gltf"), "--json")
        large = content(self.out)
        least = report["memory"]["least_bytes"]
        self.assertFalse(report["memory"]["compact"])
        self.assertLessEqual(report["memory"]["least_bytes"], report["memory"]["limit_bytes"])
        _, small = self.bake(sample("textured.gltf"), "--memory", str(least), out=self.path("small"))
        self.assertTrue(small["memory"]["compact"])
        self.assertEqual(small["memory"]["limit_bytes"], least)
        for name in SAME_EVERY_TIME:
            self.assertEqual(content(self.path("small"))[name], large[name], name)

    def test_memory_too_small_is_refused_with_the_least(self):
        self.bake(sample("textured.gltf"))
        before = content(self.out)
        done = lmc("bake", sample("textured.gltf"), "-o", self.out, "--memory", "1M", *FAST)
        self.assertEqual(done.returncode, 8, done.stderr)
        self.assertIn("[LMC_MEMORY]", done.stderr)
        self.assertEqual(content(self.out), before)
        named = re.search(r"--memory (\d+M) at least", done.stderr)
        self.assertTrue(named, done.stderr)
        self.bake(sample("textured.gltf"), "--memory", named.group(1))

    def test_outputs_name_no_place(self):
        self.bake(sample("furnace.glb"))
        for name, data in content(self.out).items():
            for secret in (self.folder, OPTIONS.source_dir, os.uname().nodename):
                self.assertNotIn(secret.encode(), data, name)

    def test_level_out_is_marked(self):
        self.bake(sample("two_rooms.glb"))
        doc, _ = read_glb(os.path.join(self.out, "level.glb"))
        nodes = {node.get("name"): node for node in doc["nodes"]}
        mark = nodes["floor"]["extras"]["lmc"]["lightmap"]
        self.assertEqual((mark["uri"], mark["scale"], mark["texCoord"]), ("lightmap.exr", 1.0, 1))
        self.assertIs(nodes["lamp"]["extras"]["lmc"]["baked"], True)
        with open(os.path.join(self.out, "level.lmc.json")) as f:
            sidecar = json.load(f)
        for entry in sidecar["files"]:
            self.assertEqual(os.path.getsize(os.path.join(self.out, entry["name"])), entry["bytes"])

    def test_furnace_agrees_with_the_closed_form(self):
        for albedo in (0.1, 0.5, 0.9, 0.99):
            with self.subTest(albedo=albedo):
                subprocess.run([sys.executable, sample("make_samples.py"), "--only", "furnace", "--furnace-albedo", str(albedo), "--out", self.folder],
                               check=True, stdout=subprocess.DEVNULL)
                done = lmc("bake", self.path("furnace.glb"), "-o", self.out)
                self.assertEqual(done.returncode, 0, done.stderr)
                with open(os.path.join(self.out, "report.json")) as f:
                    report = json.load(f)
                for got, radiance in zip(report["illuminance"]["mean"], (2.0, 1.0, 0.5)):
                    want = math.pi * radiance / (1.0 - albedo)
                    self.assertLess(abs(got / want - 1.0), 0.01, f"E = {got}, closed form {want}")
                # The same at each place: noise alone, and no corner or edge that stands out.
                self.assertLess(report["illuminance"]["max"] / (math.pi * 2.0 / (1.0 - albedo)), 1.1)
                self.assertGreater(report["illuminance"]["min"] / (math.pi * 0.5 / (1.0 - albedo)), 0.9)
                self.assertLess(abs(report["energy"]["balance"]), 0.005)

    def test_level_without_light_is_black_and_casts_no_ray(self):
        doc, rest = read_glb(sample("furnace.glb"))
        for material in doc["materials"]:
            del material["emissiveFactor"]
            material.pop("extensions", None)
        doc.pop("extensionsUsed", None)
        write_glb(self.path("dark.glb"), doc, rest)
        _, report = self.bake(self.path("dark.glb"))
        self.assertEqual(report["rays"]["total"], 0)
        self.assertEqual(report["illuminance"]["mean"], [0.0, 0.0, 0.0])
        self.assertEqual(report["illuminance"]["max"], 0.0)
        self.assertEqual([s["effect"] for s in report["plan"] if s["run"]], [])

    def test_no_sky_means_the_sun_alone(self):
        _, with_sky = self.bake(sample("court.glb"))
        _, without = self.bake(sample("court.glb"), "--sky", "none")
        self.assertTrue(all(a > b for a, b in zip(with_sky["illuminance"]["mean"], without["illuminance"]["mean"])))
        self.assertFalse(next(s["run"] for s in without["plan"] if s["effect"] == "sky"))

    def test_depfile_names_every_input(self):
        level = self.path("my level")
        os.mkdir(level)
        for name in os.listdir(os.path.dirname(sample("x"))):
            if name.startswith("textured"):
                shutil.copy(sample(name), level)
        done = lmc("bake", "my level/textured.gltf", "-o", "out", "--depfile", "d.d", *FAST, cwd=self.folder)
        self.assertEqual(done.returncode, 0, done.stderr)
        with open(self.path("d.d")) as f:
            text = f.read()
        target, inputs = text.replace("\\\n", " ").split(":", 1)
        self.assertEqual(target, "out/level.lmc.json")
        words = sorted(w.replace("\0", " ") for w in inputs.replace("\\ ", "\0").split())
        self.assertEqual(words, sorted("my level/" + n for n in ("textured.gltf", "textured.bin", "textured_tiles.png", "textured_panel.png", "textured_lattice.png")))

    def test_compare_and_shade(self):
        self.bake(sample("textured.gltf"))
        first = os.path.join(self.out, "lightmap.exr")
        self.assertEqual(lmc("compare", first, first, "--max-diff", "0").returncode, 0)
        other = self.path("other")
        self.bake(sample("textured.gltf"), "--seed", "2", out=other)
        done = lmc("compare", first, os.path.join(other, "lightmap.exr"), "--max-diff", "0")
        self.assertEqual(done.returncode, 7, done.stderr)
        self.assertTrue(done.stdout)
        self.assertEqual(lmc("compare", first, self.path("nowhere.exr")).returncode, 2)
        picture = self.path("picture.png")
        done = lmc("shade", self.out, "-o", picture, "--width", "160", "--height", "90")
        self.assertEqual((done.returncode, done.stdout), (0, ""), done.stderr)
        with open(picture, "rb") as f:
            header = f.read(24)
        self.assertEqual(header[:8], b"\x89PNG\r\n\x1a\n")
        self.assertEqual(struct.unpack(">II", header[16:24]), (160, 90))

    def test_missed_goal_is_said_and_maps_are_written(self):
        done = lmc("bake", sample("two_rooms.glb"), "-o", self.out, "--max-error", "1%", "--passes", "1")
        self.assertEqual(done.returncode, 5, done.stderr)
        self.assertIn("[LMC_GOAL]", done.stderr)
        self.assertTrue(os.path.exists(os.path.join(self.out, "lightmap.exr")))

    def test_passes_are_bounces(self):
        # In a furnace of albedo 1/2 k bounces give pi L (2 - 2^-k).
        for passes in (1, 2, 3):
            _, report = self.bake(sample("furnace.glb"), "--passes", str(passes), "--snapshot")
            want = math.pi * 2.0 * (2.0 - 0.5 ** passes)
            self.assertLess(abs(report["illuminance"]["mean"][0] / want - 1.0), 0.01)
            pictures = os.path.join(self.out, "passes")
            self.assertEqual(len(os.listdir(pictures)) if os.path.isdir(pictures) else 0, passes - 1)
            shutil.rmtree(pictures, ignore_errors=True)

    def test_passes_end_at_the_asked_bounce_tail(self):
        _, coarse = self.bake(sample("two_rooms.glb"), "--bounce-tail", "20%")
        _, fine = self.bake(sample("two_rooms.glb"), "--bounce-tail", "0.1%")
        self.assertLess(coarse["solver"]["passes"], fine["solver"]["passes"])
        self.assertLessEqual(coarse["solver"]["tail_bound"], 0.2)
        self.assertLessEqual(fine["solver"]["tail_bound"], 0.001)

    def test_dense_and_shooting_agree(self):
        _, dense = self.bake(sample("two_rooms.glb"), "--solver", "dense", "--patch-size", "0.8", "--effects", "auto")
        _, shot = self.bake(sample("two_rooms.glb"), "--solver", "shooting", "--patch-size", "0.8", out=self.path("shot"))
        self.assertEqual((dense["solver"]["method"], shot["solver"]["method"]), ("dense", "shooting"))
        for a, b in zip(dense["illuminance"]["mean"], shot["illuminance"]["mean"]):
            self.assertLess(abs(a / b - 1.0), 0.01)

    def test_stopped_bakes_leave_nothing(self):
        for number, code in ((signal.SIGINT, 130), (signal.SIGTERM, 143)):
            with self.subTest(code=code):
                shutil.rmtree(self.out, ignore_errors=True)
                running = subprocess.Popen([OPTIONS.lmc, "bake", sample("two_rooms.glb"), "-o", self.out, "--max-error", "0.05%", "--progress", "lines"],
                                           stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
                for line in running.stderr:      # a stage has ended, so the work has begun
                    if line.startswith("trace") or line.startswith("charts"):
                        break
                time.sleep(0.3)
                running.send_signal(number)
                asked = time.monotonic()
                _, rest = running.communicate(timeout=60)
                self.assertEqual(running.returncode, code, rest)
                self.assertLess(time.monotonic() - asked, 10.0)
                self.assertEqual(content(self.out) or {}, {})


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--lmc", required=True)
    parser.add_argument("--source-dir", default=os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", ".."))
    OPTIONS, rest = parser.parse_known_args()
    OPTIONS.lmc, OPTIONS.source_dir = map(os.path.abspath, (OPTIONS.lmc, OPTIONS.source_dir))
    unittest.main(argv=[sys.argv[0]] + rest)
