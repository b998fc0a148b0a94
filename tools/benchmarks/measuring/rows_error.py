"""Rows on the time of shadow rays at equal error.

Only the error of light samples counts: references have the same camera rays (same seed, one camera sample) and 64 times
Monte Carlo's light samples. Another seed would move the camera rays, whose noise along silhouettes is thirty times the
error measured here. The image's samples are the first of the reference's, which lowers both methods' errors by about
1 %.
"""

import math

from .context import AT_LEAST, Figure, RowResult, light
from .programs import frame_seconds
from .search import fewest
from .timing import in_turn, ratio, summary

REFERENCE_FACTOR = 64


def secondary(stats):
    return stats["time"]["secondary"]


def secondary_and_bake(stats):
    return stats["time"]["secondary"] + stats["time"]["bake"]


def describe(samples, error, runs):
    return {"light_samples": samples, "rmse": error, "secondary": summary(map(secondary, runs)),
            "bake": summary([r["time"]["bake"] for r in runs]),
            "cache": summary([r["time"]["cache"] for r in runs]), "frame": summary(map(frame_seconds, runs)),
            "exact_fraction": runs[0]["exact_fraction"], "field": runs[0]["field"]}


def equal_error(context, scene, angle, samples, size=1024):
    """Monte Carlo with `samples` light samples, and the hybrid with the fewest that reach its error, warm and cold."""
    programs = context.programs
    monte_carlo = context.shot(scene, size, light(angle), light_samples=samples)
    factor = context.samples(REFERENCE_FACTOR)
    reference = programs.reference(monte_carlo.with_(light_samples=samples * factor))
    aim, _ = programs.error(monte_carlo, reference)

    def hybrid(m):
        options = () if context.tolerance is None else ("--tolerance", str(context.tolerance))
        return monte_carlo.with_(method="hybrid", light_samples=m, options=options)

    def error_of(m):
        error, stats = programs.error(hybrid(m), reference, programs.cache_for(hybrid(m)))
        context.log(f"  hybrid, {m} light samples: RMSE {error:.7f}, aim {aim:.7f}; {secondary(stats):.3f} s")
        return error

    found, errors = fewest(error_of, aim, samples)
    jobs = {"monte_carlo": lambda: programs.render(monte_carlo)}
    # At the same number of samples too: what users see who only switch the method.
    for name, count in (("same_samples", samples), ("hybrid", found)):
        if count is None or (name == "hybrid" and count == samples):
            continue
        shot = hybrid(count)
        jobs[f"{name}_warm"] = lambda shot=shot: programs.render(shot, cache=programs.cache_for(shot))
        jobs[f"{name}_cold"] = lambda shot=shot: programs.render(shot)
    runs = in_turn(jobs, context.repeats)
    if found == samples:
        runs["hybrid_warm"], runs["hybrid_cold"] = runs["same_samples_warm"], runs["same_samples_cold"]

    details = {"command": programs.last_command, "monte_carlo": describe(samples, aim, runs["monte_carlo"]),
               "hybrid_errors": {str(m): e for m, e in errors.items()}}
    result = {"warm": None, "cold": None, "details": details}
    base = summary(map(secondary, runs["monte_carlo"]))
    for name, count in (("same_samples", samples), ("hybrid", found)):
        if f"{name}_warm" not in runs:
            continue
        warm, cold = runs[f"{name}_warm"], runs[f"{name}_cold"]
        ratios = {"warm": ratio(base, summary(map(secondary, warm))),
                  "cold": ratio(base, summary(map(secondary_and_bake, cold)))}
        details[f"{name}_warm"] = describe(count, errors[count], warm)
        details[f"{name}_cold"] = describe(count, errors[count], cold)
        details[f"{name}_ratios"] = ratios
        if name == "hybrid":
            result["warm"], result["cold"] = ratios["warm"]["value"], ratios["cold"]["value"]
    if found is None:
        details["not_reached"] = f"the hybrid's least error was {min(errors.values()):.6f}"
    # A check of the reference: its error is about this share of Monte Carlo's (error falls as samples^-3/4).
    details["reference_error_share"] = math.pow(factor, -0.75)
    return result


def figure_of(result, what, key, target):
    return Figure(what, result[key], AT_LEAST, target, "x", result["details"])


def both_lights(context):
    return {angle: context.once(("equal_error", "bunny_floor", angle, 64),
                                lambda angle=angle: equal_error(context, "bunny_floor.xml", angle, 64))
            for angle in ((4,) if context.quick else (4, 20))}


def warm(context):
    """time.secondary, Monte Carlo with 64 light samples over the hybrid at its error; warm."""
    return RowResult([figure_of(r, f"light of {angle} degrees", "warm", 15.0)
                      for angle, r in both_lights(context).items()])


def cold(context):
    """The same, the bake counted: Monte Carlo's time.secondary over the hybrid's time.secondary + time.bake."""
    return RowResult([figure_of(r, f"light of {angle} degrees", "cold", 4.0)
                      for angle, r in both_lights(context).items()])


def wide_light(context):
    """The same with 256 light samples under the light of 20 degrees, warm."""
    result = equal_error(context, "bunny_floor.xml", 20, 256)
    return RowResult([figure_of(result, "light of 20 degrees", "warm", 25.0)])


def closeup(context):
    """Shading points on the object itself: a close-up, equal error, warm."""
    result = equal_error(context, "bunny_closeup.xml", 4, 64)
    return RowResult([figure_of(result, "light of 4 degrees", "warm", 6.0)])
