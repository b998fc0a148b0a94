"""The input of every row (programs, scenes by name, repeats, sizes) and its result."""

import dataclasses
import json
import pathlib

from .programs import Programs, Shot

ROOT = pathlib.Path(__file__).resolve().parents[3]

AT_LEAST, AT_MOST = "at least", "at most"


@dataclasses.dataclass
class Figure:
    """One measured number with its target. `measured` is None if no run reached the required error."""

    what: str
    measured: float | None
    relation: str | None = None  # AT_LEAST, AT_MOST; None: reported only
    target: float | None = None
    unit: str = ""
    details: dict = dataclasses.field(default_factory=dict)

    def met(self):
        """Whether the target is met; None if there is no target."""
        if self.target is None:
            return None
        if self.measured is None:
            return False
        return self.measured >= self.target if self.relation == AT_LEAST else self.measured <= self.target


@dataclasses.dataclass
class RowResult:
    figures: list
    notes: list = dataclasses.field(default_factory=list)
    skipped: str | None = None  # why nothing was measured


def light(angle):
    """-D values for a light of about 4 or 20 degrees in the bunny scenes, at equal power."""
    radius = {4: 0.16, 20: 0.8}[angle]
    return (("light_radius", radius), ("light_radiance", 300.0 * (0.16 / radius) ** 2))


@dataclasses.dataclass
class Context:
    programs: Programs
    repeats: int
    quick: bool
    tolerance: float | None = None  # of the hybrid in the rows of equal error; None: the program's default
    resolution: int | None = None  # for all scenes; None: each row's own
    peer_python: str | None = None
    peer_missing: str | None = None  # why there is no peer; None: there is one
    peer_version: str | None = None
    meshes: pathlib.Path = ROOT / "tools/benchmarks/meshes.json"
    log: object = print
    memo: dict = dataclasses.field(default_factory=dict)

    def size(self, wanted):
        return ("resolution", self.resolution or (64 if self.quick else wanted))

    def samples(self, wanted):
        """Samples of a reference: an eighth in a quick run."""
        return max(wanted // 8, 1) if self.quick else wanted

    def shot(self, scene, size, defines=(), **fields):
        return Shot(ROOT / "scenes" / scene, defines=(self.size(size), *defines), **fields)

    def once(self, key, measure):
        """Calls measure() once per run: rows that share a measurement show the same numbers."""
        if key not in self.memo:
            self.memo[key] = measure()
        return self.memo[key]

    def three_objects(self):
        """-D values for scenes/three_objects.xml: its meshes, generated as in tools/demo.sh."""
        lobes = "--m 7 --n1 0.6 --n2 1.2 --n3 1.2 --m-lat 3 --n1-lat 1.2 --n2-lat 1.6 --n3-lat 1.6"
        box = "--m 5 --n1 0.4 --n2 1.7 --n3 1.7 --m-lat 4 --n1-lat 10 --n2-lat 10 --n3-lat 10"
        make = self.programs.mesh
        return (("shape1", make("shape1", f"supershape {lobes}")), ("shape2", make("shape2", f"supershape {box}")),
                ("knot", make("knot24k", "knot --along 512 --around 24")))

    def listed_meshes(self):
        """The meshes of meshes.json as (name, path, -D values)."""
        for entry in json.loads(self.meshes.read_text(encoding="utf-8"))["meshes"]:
            if "file" in entry:
                path = (self.meshes.parent / entry["file"]).resolve()
            elif "stress" in entry:
                path = self.programs.stress_mesh(entry["stress"])
            else:
                path = self.programs.mesh(entry["name"], entry["make"])
            yield entry["name"], path, tuple(entry.get("defines", {}).items())
