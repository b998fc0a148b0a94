"""Runs the project's programs: renders with their statistics, errors against references, meshes, micro-benchmarks.

A Shot holds everything that an image depends on. Images are kept in the work folder as 32-bit float, so that rounding
does not count as error. Every failure is a BenchmarkError that names the command.
"""

import dataclasses
import hashlib
import json
import pathlib
import shlex
import shutil
import subprocess

LONGEST_RUN = 3600  # seconds per command
ADAPTIVE = ("--light-estimator", "adaptive")  # the other one of Monte Carlo's


class BenchmarkError(Exception):
    """A command failed, or one of its prerequisites is missing; the message names it and the remedy."""


@dataclasses.dataclass(frozen=True)
class Shot:
    """One image. `defines`: -D values as a tuple of (name, value); `options`: further command-line arguments."""

    scene: pathlib.Path
    method: str = "montecarlo"
    spp: int = 1
    light_samples: int = 1
    seed: int = 0
    defines: tuple = ()
    options: tuple = ()

    def with_(self, **changes):
        return dataclasses.replace(self, **changes)

    def words(self):
        words = ["render", str(self.scene), "--method", self.method, "--spp", str(self.spp),
                 "--light-samples", str(self.light_samples), "--seed", str(self.seed), *self.options]
        for name, value in self.defines:
            words += ["-D", f"{name}={value}"]
        return words

    def key(self):
        return hashlib.sha256(repr(self.words()).encode()).hexdigest()[:16]


def run(words, **options):
    """Runs a command and returns its stdout."""
    try:
        done = subprocess.run([str(w) for w in words], check=True, capture_output=True, text=True, timeout=LONGEST_RUN,
                              **options)
    except FileNotFoundError as e:
        raise BenchmarkError(f"{words[0]} is missing; build it (cmake --preset release -DFIELDTRACE_BENCHMARKS=ON && "
                             "cmake --build build/release), or name the program with --program") from e
    except subprocess.CalledProcessError as e:
        raise BenchmarkError(f"{shlex.join(map(str, words))} failed with {e.returncode}: {e.stderr.strip()}") from e
    except subprocess.TimeoutExpired as e:
        raise BenchmarkError(f"{shlex.join(map(str, words))} took more than {LONGEST_RUN} s") from e
    return done.stdout


def text_hash(text):
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def frame_seconds(stats):
    """Time of the whole frame, without reading the scene, building Embree's BVHs and writing the image."""
    t = stats["time"]
    return t["total"] - t["load"] - t["build"] - t["write"]


class Programs:
    """The executables beside `program`, and the work folder, where references are kept between runs."""

    def __init__(self, program, work):
        self.program = pathlib.Path(program)
        self.work = pathlib.Path(work)
        self.folder = self.program.parent
        self.last_command = ""
        if not self.program.is_file():
            raise BenchmarkError(f"{program} is missing; build it (tools/build.sh) or name it with --program")
        self.work.mkdir(parents=True, exist_ok=True)
        self.identity = hashlib.sha256(self.program.read_bytes()).hexdigest()[:16]

    def version(self):
        return run([self.program, "--version"]).strip()

    def render(self, shot, picture=None, cache=None):
        """Renders a shot to `picture`, or to a temporary file, and returns its statistics."""
        target = picture or self.work / "thrown_away.exr"
        stats = self.work / "stats.json"
        words = [self.program, *shot.words(), "--quiet", "--float32", "-o", target, "--stats", stats]
        if cache is not None:
            words += ["--field-cache", cache]
        run(words)
        self.last_command = shlex.join(["fieldtrace", *shot.words()])
        return json.loads(stats.read_text(encoding="utf-8"))

    def cache_for(self, shot):
        """A field cache with the fields that the shot needs, so that the next render with it is warm."""
        cache = self.work / f"cache-{shot.with_(seed=0).key()}"
        if not cache.is_dir():
            filling = cache.with_suffix(".filling")
            shutil.rmtree(filling, ignore_errors=True)
            filling.mkdir()
            self.render(shot, cache=filling)
            filling.rename(cache)
        return cache

    def drop_caches(self):
        """Removes the caches, which belong to one run: fields of another version must not count as warm."""
        for cache in self.work.glob("cache-*"):
            shutil.rmtree(cache, ignore_errors=True)

    def reference(self, shot, of_any_version=False):
        """The image of a shot, cached under a name that depends on the shot and, unless that of any will do, the
        program."""
        version = "" if of_any_version else f"{self.identity}-"
        path = self.work / f"reference-{version}{shot.key()}.exr"
        if not path.is_file():
            temporary = path.with_name("new-" + path.name)
            self.render(shot, picture=temporary)
            temporary.rename(path)
        return path

    def compare(self, picture, reference, crop=None, layer=None):
        """The figures of `fieldtrace compare`, within `crop` (X,Y,W,H) and of `layer` if given."""
        window = ["--crop", ",".join(map(str, crop))] if crop else []
        window += ["--layer", layer] if layer else []
        return json.loads(run([self.program, "compare", picture, reference, "--json", *window]))

    def error(self, shot, reference, cache=None, crop=None):
        """RMSE of a shot against a reference, and the shot's statistics."""
        picture = self.work / "picture.exr"
        stats = self.render(shot, picture=picture, cache=cache)
        return self.compare(picture, reference, crop)["rmse"], stats

    def scene(self, name, text):
        """A file with the text of a scene, under a name that depends on it, as references are kept by names."""
        path = self.work / f"{name.replace(' ', '_').replace(',', '')}-{text_hash(text)}.xml"
        path.write_text(text, encoding="utf-8")
        return path

    def mesh(self, name, words):
        """A mesh generated by `fieldtrace mesh`, once for all runs; `words`: its arguments as a string."""
        path = self.work / f"{name.replace(chr(32), chr(95))}-{text_hash(words)}.ply"
        if not path.is_file():
            run([self.program, "mesh", *words.split(), "-o", path])
        return path

    def crowd(self, words, count):
        """A folder with instances.xml: `count` instances of a mesh made of `words`, by tools/make_crowd.py."""
        script = pathlib.Path(__file__).resolve().parents[2] / "make_crowd.py"
        folder = self.work / f"crowd-{count}-{text_hash(script.read_text(encoding='utf-8') + words)}"
        if not (folder / "instances.xml").is_file():
            run([script, "--program", self.program, "-o", folder, "--mesh", words, "--instances", str(count)])
        return folder

    def stress_mesh(self, name):
        """A mesh of core/mesh/mesh_stress.h."""
        folder = self.work / "stress"
        if not (folder / f"{name}.ply").is_file():
            run([self.folder / "stress_meshes", folder])
        if not (folder / f"{name}.ply").is_file():
            raise BenchmarkError(f"stress_meshes makes no mesh named {name}; see core/mesh/mesh_stress.h for those it makes")
        return folder / f"{name}.ply"

    def lookup_benchmark(self, mesh, quick):
        """One run of lookup_benchmark; returns {name: counters} and the command."""
        out = self.work / "lookup.json"
        words = [self.folder / "lookup_benchmark", mesh, f"--benchmark_min_time={0.01 if quick else 0.3}",
                 f"--benchmark_out={out}", "--benchmark_out_format=json"]
        run(words)
        result = json.loads(out.read_text(encoding="utf-8"))
        return {b["name"]: b for b in result["benchmarks"]}

    def free_visibility(self, shot, threads):
        """Times of a frame with free visibility (tools/benchmarks/free_visibility.cpp)."""
        words = [self.folder / "free_visibility", shot.scene, shot.spp, shot.light_samples, threads]
        return json.loads(run(words + [f"{name}={value}" for name, value in shot.defines]))
