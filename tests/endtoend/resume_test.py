#!/usr/bin/env python3
"""Stop and go on: bakes that were killed, stopped or whose journal was damaged end with the bytes of an undisturbed run, and the work that is
in the journal is not done again.

    resume_test.py --lmc BUILD/bin/lmc --source-dir SOURCE [unittest's own arguments]
"""
import argparse
import json
import os
import random
import resource
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest

OPTIONS = None
SAME_EVERY_TIME = ("ao.exr", "ao.png", "lightmap.exr", "level.glb", "level.lmc.json")
HEADER, HEAD = 48, 48  # bytes before the first record, and before each payload (libscene/journal.cpp)
JOURNAL = os.path.join(".lmc-resume", "journal")


def sample(name):
    return os.path.join(OPTIONS.source_dir, "samples", name)


def outputs(folder):
    """{name: bytes} of what a bake promises to be the same every time; what is not there is left out."""
    out = {}
    for name in SAME_EVERY_TIME:
        if os.path.exists(os.path.join(folder, name)):
            with open(os.path.join(folder, name), "rb") as f:
                out[name] = f.read()
    return out


def ends_of_records(journal):
    """Where each record of a journal ends."""
    out, at = [], HEADER
    while at < len(journal):
        at += HEAD + struct.unpack_from("<Q", journal, at + 24)[0]
        out.append(at)
    assert at == len(journal)
    return out


class Case(unittest.TestCase):
    # A door that light comes through: guides are built. Openness, and an audit, too.
    LEVEL = "two_rooms.glb"
    QUICK = ("--map-size", "128", "--preset", "draft", "--audit", "--progress", "none")

    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="lmc-resume-")
        self.addCleanup(folder.cleanup)
        self.folder = folder.name
        self.out = self.path("out")

    def path(self, *names):
        return os.path.join(self.folder, *names)

    def command(self, *arguments, level=None, out=None):
        return [OPTIONS.lmc, "bake", level or sample(self.LEVEL), "-o", out or self.out, *(self.QUICK + arguments)]

    def bake(self, *arguments, level=None, out=None, code=0, **more):
        done = subprocess.run(self.command(*arguments, level=level, out=out), stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=300, **more)
        self.assertEqual(done.returncode, code, done.stderr)
        return done.stderr

    def start(self, *arguments, level=None, out=None):
        return subprocess.Popen(self.command(*arguments, level=level, out=out), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                                text=True)

    def report(self, out=None):
        with open(os.path.join(out or self.out, "report.json")) as f:
            return json.load(f)

    def journal_size(self, out=None):
        try:
            return os.path.getsize(os.path.join(out or self.out, JOURNAL))
        except FileNotFoundError:
            return 0

    def undisturbed(self, *arguments, level=None):
        """Outputs and report of a bake that keeps no journal."""
        out = self.path("undisturbed")
        self.bake("--no-resume", *arguments, level=level, out=out)
        result = outputs(out), self.report(out)
        shutil.rmtree(out)
        return result

    kept = {}  # what several tests compare with

    def plain(self):
        if "plain" not in Case.kept:
            Case.kept["plain"] = self.undisturbed()
        return Case.kept["plain"]

    def whole_journal(self):
        if "journal" not in Case.kept:
            Case.kept["journal"] = self.bake_a_journal()
        return Case.kept["journal"]

    def bake_a_journal(self):
        """The journal of a bake that did all but write its files, for a folder has the name of one."""
        os.makedirs(os.path.join(self.out, "level.lmc.json"))
        stderr = self.bake(code=2)
        self.assertIn("the same command goes on", stderr)
        os.rmdir(os.path.join(self.out, "level.lmc.json"))
        self.assertEqual(outputs(self.out), {})
        with open(os.path.join(self.out, JOURNAL), "rb") as f:
            journal = f.read()
        shutil.rmtree(self.out)
        return journal

    def place(self, journal):
        shutil.rmtree(self.out, ignore_errors=True)
        os.makedirs(os.path.dirname(os.path.join(self.out, JOURNAL)))
        with open(os.path.join(self.out, JOURNAL), "wb") as f:
            f.write(journal)

    def assert_outputs(self, expected, what, out=None):
        now = outputs(out or self.out)
        self.assertEqual(sorted(now), sorted(expected), what)
        for name in expected:
            self.assertTrue(now[name] == expected[name], f"{name} differs: {what}")
        self.assertFalse(os.path.lexists(os.path.join(out or self.out, ".lmc-resume")), f"a journal is left: {what}")


class Records(Case):
    def test_a_bake_goes_on_from_any_tile_with_the_same_bytes_and_rays(self):
        expected, report = self.plain()
        journal = self.whole_journal()
        ends = [HEADER] + ends_of_records(journal)
        self.assertGreater(len(ends), 40)
        random.seed(OPTIONS.seed + 1)
        # The last has all; each is cut at the end of a record, or within the next.
        for k, n in enumerate(sorted(random.sample(range(len(ends) - 1), 7)) + [len(ends) - 1]):
            cut = ends[n] + (random.randint(1, ends[n + 1] - ends[n] - 1) if k % 2 and n + 1 < len(ends) else 0)
            with self.subTest(tiles=n, cut=cut - ends[n]):
                self.place(journal[:cut])
                stderr = self.bake("-j", str(1 + k % 3))
                self.assert_outputs(expected, f"{n} tiles of {len(ends) - 1}")
                now = self.report()
                self.assertIn(f"going on with {n} tiles", stderr)
                self.assertEqual("cut or damaged" in stderr, cut > ends[n], stderr)
                # Every tile that is there is taken: none is computed again.
                self.assertEqual(now["resume"]["tiles_found"], n)
                self.assertEqual(now["resume"]["tiles_taken"], n)
                self.assertEqual(now["resume"]["tiles_kept"], len(ends) - 1)
                # The report counts rays as if nothing had happened, lamp by lamp.
                self.assertEqual(now["rays"], report["rays"])
                self.assertEqual([l["rays"] for l in now["lights"]], [l["rays"] for l in report["lights"]])
                self.assertEqual(now["error"], report["error"])

    def test_flipped_bits_never_give_other_bytes(self):
        expected, _ = self.plain()
        journal = self.whole_journal()
        random.seed(OPTIONS.seed + 2)
        for _ in range(5):
            bit = random.randrange(8 * len(journal))
            damaged = bytearray(journal)
            damaged[bit // 8] ^= 1 << bit % 8
            with self.subTest(bit=bit, of=8 * len(journal)):
                self.place(damaged)
                stderr = self.bake()
                self.assertRegex(stderr, "damaged|discarded")
                self.assert_outputs(expected, f"bit {bit}")


class Masked(Case):
    LEVEL = "textured.gltf"

    def test_looks_at_holes_come_back_with_their_rays(self):
        expected, report = self.undisturbed()
        self.assertGreater(report["alpha_tests"], 0)
        self.place(self.bake_a_journal())
        self.bake()
        self.assert_outputs(expected, "all tiles are there")
        self.assertGreater(self.report()["resume"]["tiles_taken"], 0)
        self.assertEqual(self.report()["rays"], report["rays"])
        self.assertEqual(self.report()["alpha_tests"], report["alpha_tests"])


class Others(Case):
    def test_a_journal_of_something_else_is_named_and_discarded(self):
        own = self.path("level.glb")
        shutil.copy(sample(self.LEVEL), own)
        journal = self.whole_journal()

        def edited(at, value):
            out = bytearray(journal)
            out[at:at + len(value)] = value
            return out

        def changed_level():
            # A lamp that is a little weaker, or whatever lies there: any other byte is another level.
            with open(own, "r+b") as f:
                data = f.read()
                at = data.rindex(b'"intensity":') + len(b'"intensity":')
                f.seek(at)
                f.write(b"1" if data[at:at + 1] != b"1" else b"2")
            return own

        cases = (
            ("another level", journal, (), changed_level()),
            ("other options", journal, ("--seed", "2"), None),
            ("other options", journal, ("--ao-error", "0.02"), None),
            ("another version", edited(16, b"another!"), (), None),
            ("another version", edited(8, b"\x7f"), (), None),
            ("damaged", edited(0, b"something"), (), None),
            ("damaged", edited(24, b"\0\0\0\0\0\0\0\0"), (), None),
            ("damaged", journal[:HEADER - 1], (), None),
        )
        for what, content, arguments, level in cases:
            with self.subTest(what=what, arguments=arguments):
                expected, _ = self.undisturbed(*arguments, level=level) if arguments or level else self.plain()
                self.place(content)
                stderr = self.bake(*arguments, level=level)
                self.assertRegex(stderr, f"note: the journal [^\n]*{what}[^\n]*discarded[^\n]*LMC_RESUME")
                self.assert_outputs(expected, what)
                self.assertEqual(self.report()["resume"]["tiles_taken"], 0)

    def test_options_that_change_no_byte_go_on(self):
        expected, _ = self.plain()
        journal = self.whole_journal()
        for arguments in (("-j", "1"), ("--memory", "4G"), ("--json",), ("--no-audit",), ("--explain", "3,3")):
            with self.subTest(arguments=arguments):
                self.place(journal)
                self.bake(*arguments)
                self.assertGreater(self.report()["resume"]["tiles_taken"], 0)
                self.assert_outputs(expected, arguments)

    def test_no_resume_discards_it(self):
        expected, _ = self.plain()
        self.place(self.whole_journal())
        stderr = self.bake("--no-resume")
        self.assertNotIn("LMC_RESUME", stderr)
        self.assertNotIn("resume", self.report())
        self.assert_outputs(expected, "--no-resume")

    def test_refused_levels_leave_it_alone(self):
        journal = self.whole_journal()
        self.place(journal)
        broken = self.path("broken.glb")
        with open(broken, "wb") as f:
            f.write(b"glTF")
        self.bake(level=broken, code=3)
        self.bake("--seed", "5", "--memory", "1M", code=8)  # found before the work, by the level's charts
        with open(os.path.join(self.out, JOURNAL), "rb") as f:
            self.assertTrue(f.read() == journal)

    def test_a_bake_in_a_given_time_keeps_none(self):
        running = subprocess.Popen([OPTIONS.lmc, "bake", sample(self.LEVEL), "-o", self.out, "--map-size", "64", "--time", "2s", "--progress", "none"],
                                   stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        looks = 0
        while running.poll() is None:
            self.assertFalse(os.path.lexists(os.path.join(self.out, ".lmc-resume")))
            looks += os.path.isdir(self.out)
            time.sleep(0.01)
        _, stderr = running.communicate()
        self.assertIn(running.returncode, (0, 5), stderr)
        self.assertGreater(looks, 10)
        self.assertNotIn("resume", self.report())

    def test_without_a_place_for_it_a_bake_goes_on_with_a_warning(self):
        expected, _ = self.plain()
        os.makedirs(self.out)
        with open(os.path.join(self.out, ".lmc-resume"), "w") as f:
            f.write("mine")
        stderr = self.bake()
        self.assertEqual(stderr.count("warning: trouble with the journal"), 1, stderr)
        os.remove(os.path.join(self.out, ".lmc-resume"))
        self.assert_outputs(expected, "a file in its place")
        # Files may have 400 kB: enough for the maps, not for the journal.
        largest = max(len(data) for data in expected.values())
        self.assertLess(largest, 400_000)
        shutil.rmtree(self.out)
        stderr = self.bake(preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000)))
        self.assertEqual(stderr.count("warning: trouble with the journal"), 1, stderr)
        self.assert_outputs(expected, "no room for it")


class Stopping(Case):
    def wait_for(self, running, size):
        """Until a journal of so many bytes is there; False when the bake was done before."""
        while running.poll() is None:
            if self.journal_size() >= size:
                return True
            time.sleep(0.002)
        return False

    def test_signals_keep_what_is_done(self):
        expected, report = self.plain()
        size = len(self.whole_journal())
        for k, (number, code) in enumerate(((signal.SIGINT, 130), (signal.SIGTERM, 143))):
            shutil.rmtree(self.out, ignore_errors=True)
            running = self.start()
            self.assertTrue(self.wait_for(running, (k + 1) * size // 4))
            asked = time.monotonic()
            running.send_signal(number)
            _, stderr = running.communicate(timeout=60)
            with self.subTest(signal=number):
                # The program's own limit is 0.25 s; the rest is for a machine that has other things to do.
                self.assertLess(time.monotonic() - asked, 2.0)
                self.assertEqual(running.returncode, code, stderr)
                self.assertIn("the same command goes on", stderr)
                self.assertEqual(outputs(self.out), {})
                self.assertGreaterEqual(self.journal_size(), (k + 1) * size // 4)
                self.assertRegex(self.bake("-j", str(k + 1)), "going on with [1-9][0-9]* tiles")
                self.assert_outputs(expected, f"signal {number}")
                self.assertEqual(self.report()["rays"], report["rays"])

    def test_a_second_signal_ends_it_at_once_and_keeps_what_is_done(self):
        expected, _ = self.plain()
        running = self.start()
        self.assertTrue(self.wait_for(running, 100_000))
        running.send_signal(signal.SIGINT)
        running.send_signal(signal.SIGTERM)
        _, stderr = running.communicate(timeout=60)
        self.assertIn(running.returncode, (130, 143))
        self.assertIn("the same command goes on", stderr)
        self.assertRegex(self.bake(), "going on with [1-9][0-9]* tiles")
        self.assert_outputs(expected, "two signals")

    def test_kills_at_random_times_lose_no_byte(self):
        expected, report = self.plain()
        start = time.monotonic()
        self.undisturbed()
        took = time.monotonic() - start
        random.seed(OPTIONS.seed + 4)
        kills = 0
        while kills < 20:
            running = self.start("-j", str(1 + kills % 3))
            try:
                # Time runs on from kill to kill: some get to the end of the work, where files are written.
                running.communicate(timeout=random.uniform(0.02, 0.7 * took))
                self.assertEqual(running.returncode, 0)
            except subprocess.TimeoutExpired:
                running.kill()
                running.communicate(timeout=60)
                kills += 1
                now = outputs(self.out)
                for name in now:
                    self.assertTrue(now[name] == expected[name], f"{name} is cut after kill {kills}")
                if running.returncode != 0:
                    continue
            # Done; the next one begins anew.
            self.assert_outputs(expected, f"after {kills} kills")
            self.assertEqual(self.report()["rays"], report["rays"])
            shutil.rmtree(self.out)
        # On a machine with other things to do, each of those may come before the first tile is done. This one does not.
        running = self.start()
        self.assertTrue(self.wait_for(running, 100_000))
        running.kill()
        running.communicate(timeout=60)
        self.assertRegex(self.bake(), "going on with [1-9][0-9]* tiles")
        self.assert_outputs(expected, "after the last kill")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--lmc", required=True)
    parser.add_argument("--source-dir", default=os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", ".."))
    parser.add_argument("--seed", type=int, default=0, help="other tiles, bits and moments than the suite's: scripts/soak")
    OPTIONS, rest = parser.parse_known_args()
    OPTIONS.lmc, OPTIONS.source_dir = map(os.path.abspath, (OPTIONS.lmc, OPTIONS.source_dir))
    unittest.main(argv=[sys.argv[0]] + rest)
