"""Rows about glossy reflection.

Error is that of the lobe samples alone, as in rows_error: references have the same camera rays and many times the lobe
samples.
"""

from .context import AT_LEAST, AT_MOST, Figure, RowResult
from .programs import frame_seconds
from .search import fewest
from .timing import in_turn, ratio, summary

REFERENCE_FACTOR = 16
IDENTICAL_DB = 200.0  # stands for the PSNR of a picture against itself
SAMPLES = 64


def lobes(shot, count, *options):
    return shot.with_(options=("--lobe-samples", str(count), *options))


def frame_without_bake(stats):
    return frame_seconds(stats) - stats["time"]["bake"]


def glossy(context):
    """A bunny over rough metal (GGX .2): the frame to the error of Monte Carlo with 64 lobe samples."""
    programs = context.programs
    shot = context.shot("glossy_floor.xml", 1024, light_samples=4)
    reference = programs.reference(lobes(shot, SAMPLES * context.samples(REFERENCE_FACTOR)))
    aim, _ = programs.error(lobes(shot, SAMPLES), reference)
    hybrid = shot.with_(method="hybrid")

    def error_of(count):
        error, stats = programs.error(lobes(hybrid, count), reference)
        context.log(f"  hybrid, {count} lobe samples: RMSE {error:.5f}, aim {aim:.5f}; {frame_seconds(stats):.2f} s")
        return error

    found, errors = fewest(error_of, aim, SAMPLES)
    jobs = {"monte_carlo": lambda: programs.render(lobes(shot, SAMPLES)),
            "same_samples": lambda: programs.render(lobes(hybrid, SAMPLES))}
    if found is not None:
        jobs["hybrid"] = lambda: programs.render(lobes(hybrid, found))
    runs = in_turn(jobs, context.repeats)
    base = summary(map(frame_seconds, runs["monte_carlo"]))
    details = {"command": programs.last_command, "monte_carlo": {"rmse": aim, "frame": base},
               "errors": {str(n): e for n, e in errors.items()}, "lobe_samples": found}
    figures = [Figure("RMSE at equal samples, hybrid / Monte Carlo", errors[SAMPLES] / aim, AT_MOST, 1.3, "x", details)]
    for name, what in (("hybrid", "equal error"), ("same_samples", "equal samples")):
        cold = without = None
        if name in runs:
            frames = {"frame": summary(map(frame_seconds, runs[name])),
                      "without_bake": summary(map(frame_without_bake, runs[name]))}
            details[name] = {**frames, "rays": runs[name][0]["rays"], "field": runs[name][0]["field"]}
            cold = ratio(base, frames["frame"])["value"]
            without = ratio(base, frames["without_bake"])["value"]
        aims = (6.0, 2.0) if name == "hybrid" else (None, None)
        relation = AT_LEAST if aims[0] else None
        figures.append(Figure(f"frame at {what}, Monte Carlo / hybrid, bake left out", without, relation, aims[0], "x"))
        figures.append(Figure(f"frame at {what}, Monte Carlo / hybrid, bake counted", cold, relation, aims[1], "x"))
    return RowResult(figures)


def glossy_converged(context):
    """Converged hybrid against converged Monte Carlo over rough metal (GGX .2), at two tolerances."""
    programs = context.programs
    shot = context.shot("glossy_floor.xml", 256, light_samples=16)
    count = context.samples(2048)
    reference = programs.reference(lobes(shot, count))
    picture = programs.work / "picture.exr"
    figures = []
    for tolerance, target in ((0.1, 45.0), (0.5, 35.0)):
        programs.render(lobes(shot.with_(method="hybrid"), count, "--tolerance", str(tolerance)), picture=picture)
        found = programs.compare(picture, reference)
        psnr = IDENTICAL_DB if found["psnr"] is None else found["psnr"]
        figures.append(Figure(f"tolerance {tolerance}: PSNR", psnr, AT_LEAST, target, "dB",
                              {**found, "command": programs.last_command}))
    return RowResult(figures)
