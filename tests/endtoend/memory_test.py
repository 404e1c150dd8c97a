#!/usr/bin/env python3
"""Bakes whose maps memory is not to hold: the same bytes, the limit kept, and a disk that takes no more.

    memory_test.py --lmc BUILD/bin/lmc --source-dir SOURCE [--sanitized] [unittest's own arguments]
"""
import argparse
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
import unittest

OPTIONS = None
SAME_EVERY_TIME = ("ao.000.exr", "ao.003.png", "lightmap.000.exr", "lightmap.001.exr", "lightmap.002.exr", "lightmap.003.exr", "level.glb",
                   "level.lmc.json")
LIMIT_MB = 160
LONGEST_s = 2.0  # until a signal has ended a run: 1 s is asked for, the rest is for a machine that has other things to do
HOLDS = 1.1  # times the limit, at the peak


def content(folder):
    """{name: bytes} of the files of a folder; of none where there is no folder."""
    out = {}
    if not os.path.isdir(folder):
        return out
    for name in os.listdir(folder):
        with open(os.path.join(folder, name), "rb") as f:
            out[name] = f.read()
    return out


class Case(unittest.TestCase):
    # A goal that takes few rays: it is the texels' state that counts.
    FAST = ("--max-error", "50%", "--ao-error", "0.3", "--progress", "none")

    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory(prefix="lmc-memory-")
        cls.folder = cls.temporary.name
        cls.level = cls.make_level("load.glb", 512)

    @classmethod
    def make_level(cls, name, side):
        level = os.path.join(cls.folder, name)
        made = subprocess.run([sys.executable, os.path.join(OPTIONS.source_dir, "bench", "make_load.py"), level, "--triangles", "4000", "--maps", "4",
                               "--side", str(side), "--lamps", "3", "--fill", "0.35"], capture_output=True, text=True, timeout=120)
        assert made.returncode == 0, made.stderr
        return level

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    def start(self, out, *more, level=None, **how):
        return subprocess.Popen([OPTIONS.lmc, "bake", level or self.level, "-o", out, *self.FAST, *more], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                                stderr=subprocess.PIPE, text=True, **how)

    def bake(self, name, *more, **how):
        """Exit code, what it said, its peak in MB, its folder."""
        out = os.path.join(self.folder, name)
        process = self.start(out, *more, **how)
        said = process.stderr.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        process.stderr.close()
        return process.returncode, said, used.ru_maxrss / 1024.0, out


class Limit(Case):
    def test_a_limit_is_kept_and_the_bytes_are_the_same(self):
        code, said, free, whole = self.bake("whole")
        self.assertEqual(code, 0, said)
        code, said, held, small = self.bake("small", "--memory", f"{LIMIT_MB}M")
        self.assertEqual(code, 0, said)
        for name in SAME_EVERY_TIME:
            self.assertEqual(content(small)[name], content(whole)[name], name)
        self.assertEqual([n for n in os.listdir(small) if n.startswith(".")], [])
        forecasts = [json.loads(content(out)["report.json"])["forecast"] for out in (whole, small)]
        self.assertEqual(forecasts[1]["memory_bytes"], LIMIT_MB << 20)
        self.assertGreater(forecasts[0]["memory_bytes"], LIMIT_MB << 20)
        self.assertEqual([f["disk_bytes"] > 0 for f in forecasts], [False, True])
        if not OPTIONS.sanitized:  # its shadow is no memory of ours
            self.assertGreater(free, 1.25 * HOLDS * LIMIT_MB, "without a limit it takes so little that the limit proves nothing")
            self.assertLessEqual(held, HOLDS * LIMIT_MB)
        # Another number of threads lets other pages go.
        code, said, held, one = self.bake("one", "--memory", f"{LIMIT_MB}M", "-j", "1")
        self.assertEqual(code, 0, said)
        for name in SAME_EVERY_TIME:
            self.assertEqual(content(one)[name], content(whole)[name], name)

    def test_below_the_least_it_is_refused_with_the_least(self):
        code, said, _, out = self.bake("refused", "--memory", "16M")
        self.assertEqual(code, 8, said)
        self.assertIn("[LMC_MEMORY]", said)
        self.assertEqual(content(out), {})


class Disk(Case):
    def test_a_disk_without_room_is_told_before_the_work_and_nothing_is_left(self):
        # The limit of a file's size stands for a full disk: both are told by the call that sets room aside.
        def small_files():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (2 << 20, 2 << 20))
        code, said, _, out = self.bake("full", "--memory", f"{LIMIT_MB}M", preexec_fn=small_files)
        self.assertEqual(code, 8, said)
        self.assertIn("cannot set aside", said)
        self.assertEqual(said.count(" error: "), 1, said)
        self.assertEqual(content(out), {})

    def wait_for_files(self, running, out, least_mb):
        """Files in which pages lie are seen in the process's maps, and have no name in the folder."""
        until = time.monotonic() + 120.0
        while time.monotonic() < until and running.poll() is None:
            mapped = 0
            with open(f"/proc/{running.pid}/maps") as f:
                for line in f:
                    if out in line and "(deleted)" in line:
                        begin, end = (int(n, 16) for n in line.split()[0].split("-"))
                        mapped += end - begin
            if mapped >= least_mb << 20:
                return
            time.sleep(0.01)
        self.fail(f"no {least_mb} MB of {out} were seen; exit code {running.returncode}")

    def test_a_run_that_is_killed_leaves_nothing(self):
        out = os.path.join(self.folder, "killed")
        running = self.start(out, "--memory", f"{LIMIT_MB}M")
        self.wait_for_files(running, out, 1)
        running.kill()
        running.communicate()
        self.assertEqual(content(out), {})

    def test_a_signal_ends_a_run_that_holds_much_in_files_within_a_second(self):
        level = self.make_level("large.glb", 1024)
        for number, code in ((signal.SIGINT, 130), (signal.SIGTERM, 143)):
            out = os.path.join(self.folder, f"signal {code}")
            running = self.start(out, "--memory", "400M", level=level, start_new_session=True)
            self.wait_for_files(running, out, 500)
            asked = time.monotonic()
            running.send_signal(number)
            _, said = running.communicate(timeout=60)
            took = time.monotonic() - asked
            with self.subTest(signal=code):
                self.assertEqual(running.returncode, code, said)
                self.assertIn("stopped", said)
                self.assertLess(took, LONGEST_s)
                self.assertEqual(content(out), {})
                # What frees the files goes by itself.
                until = time.monotonic() + 30.0
                while self.runs_in(running.pid):
                    self.assertLess(time.monotonic(), until, "a process is left")
                    time.sleep(0.05)

    @staticmethod
    def runs_in(session):
        for pid in filter(str.isdigit, os.listdir("/proc")):
            try:
                with open(f"/proc/{pid}/stat") as f:
                    state, _, _, its_session = f.read().rsplit(")", 1)[1].split()[:4]
            except (FileNotFoundError, ProcessLookupError):
                continue
            if int(its_session) == session and state != "Z":
                return True
        return False


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--lmc", required=True)
    parser.add_argument("--source-dir", required=True)
    parser.add_argument("--sanitized", action="store_true")
    OPTIONS, rest = parser.parse_known_args()
    unittest.main(argv=[sys.argv[0], *rest])
