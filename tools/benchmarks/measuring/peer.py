"""Mitsuba 3 for comparison, run through peer_worker.py."""

import json
import pathlib
import subprocess
import tempfile

from .programs import BenchmarkError

VARIANTS = ("llvm_ad_rgb", "scalar_rgb")


class Peer:
    """One scene in one variant of Mitsuba; a context manager. Raises BenchmarkError if the process ends early."""

    def __init__(self, python, variant, scene, defines, folders=()):
        settings = json.dumps([variant, str(scene), [str(f) for f in folders], {k: str(v) for k, v in defines}])
        worker = pathlib.Path(__file__).with_name("peer_worker.py")
        self.variant = variant
        self.log = tempfile.TemporaryFile(mode="w+")
        self.process = subprocess.Popen([python, str(worker), settings], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        stderr=self.log, text=True)
        about = self._answer()
        self.version, self.denoises = about["version"], about["denoises"]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.stdin.close()
        self.process.wait(timeout=60)
        self.process.stdout.close()
        self.log.close()

    def _answer(self):
        line = self.process.stdout.readline()
        if not line:
            self.process.wait(timeout=60)
            self.log.seek(0)
            lines = self.log.read().strip().splitlines()[:1] or ["nothing"]
            hint = ""
            if self.variant.startswith("llvm"):
                hint = "; LLVM 16 or later is needed, named by the environment variable DRJIT_LIBLLVM_PATH"
            raise BenchmarkError(f"Mitsuba ({self.variant}) stopped; it said: {lines[0]}{hint}")
        return json.loads(line)

    def render(self, spp, seed=0, integrator="direct", picture=None):
        """Seconds of one render without kernel compilation, which may be included if an image is requested."""
        job = {"spp": spp, "seed": seed, "integrator": integrator, "picture": str(picture) if picture else None}
        try:
            print(json.dumps(job), file=self.process.stdin, flush=True)
        except BrokenPipeError:
            pass  # _answer() reports the cause
        return self._answer()["seconds"]


def find_peer(python):
    """None if `python` can import the packages that the worker needs, else the reason."""
    if not python:
        return "no --peer-python was given"
    try:
        done = subprocess.run([python, "-c", "import mitsuba, numpy"], capture_output=True, text=True, timeout=120)
    except (OSError, subprocess.TimeoutExpired) as e:
        return f"{python} cannot be run: {e}"
    return None if done.returncode == 0 else f"{python} lacks the packages mitsuba and numpy"
