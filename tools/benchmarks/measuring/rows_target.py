"""Row on pictures to an error: --target-error beside the best mix of fixed samples, and both methods beside each other.

The error found is free of the references' own noise: with two references A and B of other seeds, the mean square error
of a picture P is (mse(P, A) + mse(P, B) - mse(A, B)) / 2, as the noise of A and B is independent. A fixed mix is camera
samples, fewest that reach the target, with 1 or 4 light samples each, by either method and either estimator of Monte
Carlo's; all in turn with the pictures to the error, fields from a cache.
"""

import math

from .context import AT_LEAST, AT_MOST, ROOT, Figure, RowResult
from .programs import ADAPTIVE, Shot, frame_seconds
from .rows_whole import light_frames, sky_frames
from .search import fewest
from .timing import in_turn, summary
from .whole_frames import around_aim, time_to

SEEDS = (1000, 2000)
LIGHT_TARGETS, SKY_TARGETS = (0.01, 0.005, 0.0025), (0.02, 0.01, 0.005)
COMPARED = 0.005  # the methods' times are compared there
# Of Monte Carlo's time with the same option; "demo" is the project's demo.
AIMS = {"demo": 2.0, "three objects, three lights": 2.0, "three objects, sixteen lights": 2.5,
        "three objects, constant sky": 8.0, "three objects, bright horizon": 8.0, "three objects, horizon and sun": 8.0}
MIXES = {"hybrid": ("hybrid", 1, ()), "Monte Carlo": ("montecarlo", 1, ()),
         "Monte Carlo, adaptive": ("montecarlo", 1, ADAPTIVE), "Monte Carlo, 4 light samples": ("montecarlo", 4, ())}


def scenes(context):
    """(name, shot, targets) of every scene; the demo's meshes are those of the rows on three objects."""
    resolution = context.resolution or (32 if context.quick else 512)
    for frames, targets in ((light_frames(context), LIGHT_TARGETS), (sky_frames(context), SKY_TARGETS)):
        for frame in frames:
            if frame.name.startswith("crowd"):
                continue
            yield frame.name, Shot(context.programs.scene(frame.name, frame.text(resolution))), targets
    size = (("width", resolution), ("height", max(resolution * 9 // 16, 1)))
    yield "demo", Shot(ROOT / "scenes/demo.xml", defines=(*context.three_objects()[:2], *size)), LIGHT_TARGETS


class Truth:
    """Two references of a scene. of_any_version: as for Programs.reference()."""

    def __init__(self, programs, shot, spp, of_any_version=False):
        self.programs = programs
        self.references = [programs.reference(shot.with_(spp=spp, seed=seed), of_any_version) for seed in SEEDS]
        self.noise = self._mse(*self.references)

    def _mse(self, picture, reference):
        return self.programs.compare(picture, reference)["rmse"] ** 2

    def error(self, picture):
        return math.sqrt(max(sum(self._mse(picture, r) for r in self.references) - self.noise, 0.0) / 2.0)


def to_target(shot, target):
    return shot.with_(spp=4096, options=(*shot.options, "--target-error", f"{target:g}"))


def measure_scene(context, name, shot, targets):
    programs = context.programs
    truth = Truth(programs, shot, context.samples(1024))
    picture = programs.work / "picture.exr"

    def cache_of(wanted):
        return programs.cache_for(wanted) if wanted.method == "hybrid" else None

    def error(wanted):
        stats = programs.render(wanted, picture=picture, cache=cache_of(wanted))
        return truth.error(picture), stats

    rows = {}
    for target in targets[:1] if context.quick else targets:
        jobs, points, row = {}, {}, {"estimates": {}}
        for method in ("hybrid", "montecarlo"):
            wanted = to_target(shot.with_(method=method), target)
            found, stats = error(wanted)
            row["estimates"][method] = {"estimated": stats["error"]["estimate"], "found": found, "target": target}
            jobs[method, None] = wanted
        for mix, (method, light_samples, options) in MIXES.items():
            fixed = shot.with_(method=method, light_samples=light_samples, options=options)
            found, errors = fewest(lambda n: error(fixed.with_(spp=n))[0], target, 4)
            for spp in around_aim(target, errors, found) if found else []:
                jobs[mix, spp] = fixed.with_(spp=spp)
                points.setdefault(mix, []).append((spp, errors[spp]))
        times = in_turn({job: lambda w=wanted: frame_seconds(programs.render(w, cache=cache_of(w)))
                         for job, wanted in jobs.items()}, context.repeats)
        row["seconds"] = {method: summary(times[method, None]) for method in ("hybrid", "montecarlo")}
        row["fixed"] = {
            mix: summary(time_to(target, list(zip((e for _, e in at), repeat)))
                         for repeat in zip(*(times[mix, spp] for spp, _ in at))) for mix, at in points.items()}
        rows[target] = row
        text = ", ".join(f"{n} {s['median']:.3f} s" for part in ("seconds", "fixed") for n, s in row[part].items())
        context.log(f"  {name} to {target:g}: {text}")
    return rows


def figures_of(name, rows):
    figures = []
    for target, row in rows.items():
        for method, e in row["estimates"].items():
            figures.append(Figure(f"{name}, to {target:g}, {method}: estimated / found",
                                  e["estimated"] / e["found"] if e["found"] > 0.0 else None, None, None, "", e))
        ours = row["seconds"]["hybrid"]["median"]
        best = min((s["median"] for s in row["fixed"].values()), default=None)
        figures.append(Figure(f"{name}, to {target:g}: by target / best fixed mix", best and ours / best, AT_MOST, 1.1, "",
                              row))
        if target == COMPARED:
            aim = AIMS.get(name)
            figures.append(Figure(f"{name}, to {target:g}: Monte Carlo by target / hybrid by target",
                                  row["seconds"]["montecarlo"]["median"] / ours, AT_LEAST if aim else None, aim, "x"))
    return figures


def targets(context):
    """Pictures by --target-error: estimates, and time beside the best fixed mix and beside Monte Carlo's."""
    all_scenes = list(scenes(context))
    figures = []
    for name, shot, wanted in all_scenes[:1] if context.quick else all_scenes:
        figures += figures_of(name, measure_scene(context, name, shot, wanted))
    return RowResult(figures)
