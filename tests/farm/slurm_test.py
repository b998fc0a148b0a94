#!/usr/bin/env python3
"""tools/farm/slurm.sh: what it refuses, and whole pictures by a real Slurm (slurm_cluster.py).

    slurm_test.py script|slurm --program FIELDTRACE [unittest options]

Exit code 77 where Slurm is not installed.
"""

import argparse
import json
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import unittest

import slurm_cluster
from slurm_cluster import processes_of, wait_for

SCRIPT = pathlib.Path(__file__).resolve().parents[2] / "tools" / "farm" / "slurm.sh"
PROGRAM = ""
SLICES = 5

SCENE = """<scene version="3.0.0">
  <default name="light" value="40"/>
  <integrator type="path"><integer name="max_depth" value="3"/></integrator>
  <sensor type="perspective">
    <transform name="to_world"><lookat origin="0, 4, 3" target="0, 0, 0" up="0, 0, 1"/></transform>
    <sampler type="independent"><integer name="sample_count" value="4"/></sampler>
    <film type="hdrfilm">
      <integer name="width" value="150"/><integer name="height" value="120"/><rfilter type="box"/>
    </film>
  </sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="5"/></transform></shape>
  <shape type="ply"><string name="filename" value="ball.ply"/>
    <transform name="to_world"><translate z="1"/></transform></shape>
  <shape type="sphere"><point name="center" x="1" y="1" z="4"/><float name="radius" value="0.2"/>
    <emitter type="area"><rgb name="radiance" value="$light"/></emitter></shape>
</scene>
"""


class Folder(unittest.TestCase):
    """A folder with a scene, whose name no shell and no Slurm likes."""

    def setUp(self):
        self.temporary = tempfile.TemporaryDirectory(prefix="fieldtrace_farm")
        self.addCleanup(self.temporary.cleanup)
        self.folder = pathlib.Path(self.temporary.name).resolve() / "a b'$c%A;"
        self.folder.mkdir()
        (self.folder / "my scene.xml").write_text(SCENE)
        self.fieldtrace("mesh", "sphere", "-o", "ball.ply", "--around", "32", "--along", "16")

    def fieldtrace(self, *arguments):
        done = subprocess.run([PROGRAM, *arguments], cwd=self.folder, capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout


class Script(Folder):
    def refusal(self, *arguments, path=os.environ["PATH"], program=None):
        before = sorted(self.folder.iterdir())
        environment = {**os.environ, "PATH": path, "FIELDTRACE": program or PROGRAM}
        done = subprocess.run([SCRIPT, *arguments], cwd=self.folder, env=environment, capture_output=True, text=True)
        self.assertEqual(sorted(self.folder.iterdir()), before)
        self.assertEqual(done.stdout, "")
        return done.returncode, done.stderr

    def path_with(self, sbatch):
        """A PATH of what the script needs, and of this sbatch, if any."""
        folder = pathlib.Path(self.temporary.name) / "bin"
        folder.mkdir()
        for name in ("bash", "env", "basename", "dirname", "realpath", "mkdir", "rmdir", "sed"):
            (folder / name).symlink_to(f"/usr/bin/{name}")
        if sbatch:
            (folder / "sbatch").write_text(sbatch)
            (folder / "sbatch").chmod(0o755)
        return str(folder)

    def test_wrong_use_is_refused_before_anything_is_submitted(self):
        path = self.path_with('#!/usr/bin/env bash\necho 1; touch "submitted"\n')
        scene = "my scene.xml"
        cases = [
            (["my scene.xml"], "tools/farm/slurm.sh SCENE N"),
            ([scene, "0", "-o", "a.exr"], "'0' is no number of slices"),
            ([scene, "x", "-o", "a.exr"], "'x' is no number of slices"),
            ([scene, "3"], "say what to write: -o OUT.exr"),
            ([scene, "3", "-o"], "-o needs a value"),
            ([scene, "3", "-o", "a.exr", "--slice", "1/3"], "--slice is set by this script"),
            ([scene, "3", "-o", "a.exr", "--stats", "s.json"], "the statistics of slice K are"),
            ([scene, "99999", "-o", "a.exr"], "a picture has 1 to 65536 slices"),
            ([scene, "3", "-o", "a.exr", "--spp", "0"], "--spp: '0' is not a whole number"),
            ([scene, "3", "-o", "a.exr", "--denoise"], "--denoise needs the whole picture"),
            ([scene, "3", "-o", "a.exr", "--target-error", "0.1"], "--slice is for pictures of --spp samples"),
            ([scene, "3", "-o", "a.exr", "--exposure", "x"], "--exposure: 'x' is not a number"),
        ]
        for arguments, message in cases:
            with self.subTest(message):
                code, text = self.refusal(*arguments, path=path)
                self.assertEqual(code, 2, text)
                self.assertIn(message, text)
        for output, message in [("a.jpg", "end the name in .exr or .png"), ("none/a.exr", "cannot be written")]:
            code, text = self.refusal(scene, "3", "-o", "b.exr", "-o", output, path=path)
            self.assertEqual(code, 1, text)
            self.assertIn(message, text)
        code, text = self.refusal("none.xml", "3", "-o", "a.exr", path=path)
        self.assertEqual((code, text), (1, "slurm.sh: none.xml: no such file; check the name\n"))
        code, text = self.refusal(scene, "3", "-o", "a.exr", path=path, program="/none/fieldtrace")
        self.assertEqual(code, 1)
        self.assertIn("the program was not found", text)

    def test_without_slurm_it_says_what_to_do(self):
        code, text = self.refusal("my scene.xml", "3", "-o", "a.exr", path=self.path_with(None))
        self.assertEqual(code, 1)
        self.assertIn("there is no sbatch", text)
        self.assertIn("docs/farm.md", text)

    def test_what_sbatch_refuses_is_told(self):
        path = self.path_with("#!/usr/bin/env bash\necho 'sbatch: error: no partition' >&2; exit 1\n")
        code, text = self.refusal("my scene.xml", "3", "-o", "a.exr", path=path)
        self.assertEqual(code, 1)
        self.assertEqual(text, "sbatch: error: no partition\nslurm.sh: sbatch refused the slices; its message says why\n")


class Slurm(Folder):
    @classmethod
    def setUpClass(cls):
        cls.temporary_of_cluster = tempfile.TemporaryDirectory(prefix="fieldtrace_slurm")
        cls.addClassCleanup(cls.temporary_of_cluster.cleanup)
        cls.cluster = slurm_cluster.Cluster(cls.temporary_of_cluster.name)
        cls.addClassCleanup(cls.cluster.stop)

    def setUp(self):
        super().setUp()
        self.options = ["--spp", "64", "--aov", "depth,normal", "-D", "light=30", "--crop", "3,2,140,110"]
        self.parts = self.folder / "out put.exr.parts"

    def submit(self, *more):
        """Numbers of the two jobs."""
        command = [SCRIPT, "my scene.xml", str(SLICES), "-o", "out put.exr", "-o", "out.png", "--float32",
                   "--exposure", "1", *self.options, "--field-cache", "cache", *more]
        done = self.cluster.run("env", f"FIELDTRACE={PROGRAM}", *command, cwd=self.folder)
        self.assertEqual(done.returncode, 0, done.stderr)
        words = done.stdout.replace(";", " ").split()
        return int(words[2]), int(words[words.index("merge:") + 2])

    def finish(self, merge):
        try:
            self.cluster.wait(merge)
        except AssertionError as error:
            logs = [p.read_text() for p in sorted(self.parts.glob("*.log"))] if self.parts.exists() else []
            self.fail("\n".join([str(error), *logs, self.cluster.logs()]))

    def expect_picture(self):
        """That of one command: the PNG's bytes, and every value of the EXR."""
        self.fieldtrace("render", "my scene.xml", "-o", "whole.exr", "-o", "whole.png", "--float32", "--exposure", "1",
                        "--quiet", *self.options)
        self.assertEqual((self.folder / "out.png").read_bytes(), (self.folder / "whole.png").read_bytes())
        figures = json.loads(self.fieldtrace("compare", "out put.exr", "whole.exr", "--json"))
        self.assertEqual(figures["rmse"], 0.0)
        describe = lambda name: self.fieldtrace("info", name).split("\n", 1)[1]
        self.assertEqual(describe("out put.exr"), describe("whole.exr"))

    def part(self, k):
        return self.parts / f"{k}.exr"

    def stop_program(self, *slices):
        """The process that renders one of the slices, stopped in the middle; and which one."""
        def find():
            for k in slices:
                for process in processes_of(["render", f"{k}/{SLICES}", str(self.part(k))]):
                    os.kill(process, signal.SIGSTOP)
                    return process, k
        process, k = wait_for(find, "a slice that runs")
        self.assertFalse(self.part(k).exists())
        return process, k

    def test_a_requeued_slice_leaves_no_trace(self):
        slices, merge = self.submit()
        _, k = self.stop_program(*range(1, SLICES + 1))
        done = self.cluster.run("scontrol", "requeue", f"{slices}_{k}")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.finish(merge)
        self.assertEqual(self.cluster.states(slices, SLICES), ["COMPLETED"] * SLICES)
        self.assertEqual(self.cluster.job(f"{slices}_{k}")["Restarts"], "1")
        self.assertIn("fieldtrace: interrupted; the part was not written", (self.parts / f"{k}.log").read_text())
        self.expect_picture()
        self.assertEqual(json.loads((self.parts / f"{k}.json").read_text())["slice"], f"{k}/{SLICES}")
        self.assertTrue(list((self.folder / "cache").glob("*.vdb")))
        self.assertEqual(list(self.folder.rglob("*.tmp")), [])

    def test_only_what_is_missing_is_rendered_again(self):
        _, merge = self.submit()
        self.finish(merge)
        self.part(2).unlink()
        whole = self.part(4).read_bytes()
        self.part(4).write_bytes(whole[:-100])
        (self.folder / "out.png").unlink()
        times = {k: self.part(k).stat().st_mtime_ns for k in (1, 3, 5)}
        _, merge = self.submit()
        self.finish(merge)
        self.assertEqual({k: self.part(k).stat().st_mtime_ns for k in (1, 3, 5)}, times)
        self.assertEqual(self.part(4).read_bytes(), whole)
        self.expect_picture()

    def test_a_slice_that_fails_stops_the_merge_alone(self):
        slices, merge = self.submit("--quiet")
        process, k = self.stop_program(*range(1, SLICES + 1))
        os.kill(process, signal.SIGKILL)
        self.cluster.wait(merge, ("CANCELLED",))
        expected = ["FAILED" if i == k else "COMPLETED" for i in range(1, SLICES + 1)]
        wait_for(lambda: self.cluster.states(slices, SLICES) == expected, f"{expected}")
        self.assertFalse((self.folder / "out.png").exists())
        self.assertEqual([i for i in range(1, SLICES + 1) if not self.part(i).exists()], [k])
        _, merge = self.submit()
        self.finish(merge)
        self.expect_picture()

    def test_options_for_slurm_reach_it(self):
        slices, merge = self.submit("--", "--cpus-per-task=2", "--time=7")
        self.assertEqual(self.cluster.job(f"{slices}_1")["CPUs/Task"], "2")
        self.assertEqual(self.cluster.job(f"{slices}_1")["TimeLimit"], "00:07:00")
        self.finish(merge)
        self.assertEqual(json.loads((self.parts / "1.json").read_text())["threads"], 2)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=("script", "slurm"))
    parser.add_argument("--program", required=True)
    arguments, rest = parser.parse_known_args()
    PROGRAM = str(pathlib.Path(arguments.program).resolve())
    missing = slurm_cluster.missing_programs() if arguments.what == "slurm" else []
    if missing:
        print(f"skipped: {', '.join(missing)} not found; tools/install_packages.sh --with-slurm installs Slurm")
        sys.exit(77)
    unittest.main(argv=[sys.argv[0], *(rest or [arguments.what.capitalize()])])
