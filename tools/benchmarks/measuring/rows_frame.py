"""Rows on whole frames: the upper bound, a second light, a second thread."""

import os

from .context import AT_LEAST, AT_MOST, Figure, RowResult, light
from .programs import frame_seconds
from .timing import in_turn, ratio, summary


def ceiling_of(context, name, shot):
    programs = context.programs
    threads = len(os.sched_getaffinity(0))
    fields = shot.with_(method="hybrid")
    cache = programs.cache_for(fields)
    runs = in_turn({"monte_carlo": lambda: programs.render(shot),
                    "free": lambda: programs.free_visibility(shot, threads),
                    "hybrid_warm": lambda: programs.render(fields, cache=cache)}, context.repeats)
    # free_visibility reads before its clock starts and writes nothing.
    for run in runs["free"]:
        run["time"].update(load=0.0, write=0.0)
    frames = {method: summary(map(frame_seconds, results)) for method, results in runs.items()}
    shadow = {method: summary([r["time"]["secondary"] for r in results]) for method, results in runs.items()}
    details = {"command": programs.last_command, "frame": frames, "secondary": shadow,
               "primary": summary([r["time"]["primary"] for r in runs["monte_carlo"]])}
    return [Figure(f"{name}: frame, Monte Carlo / free visibility",
                   ratio(frames["monte_carlo"], frames["free"])["value"], None, None, "x", details),
            Figure(f"{name}: frame, Monte Carlo / hybrid, warm",
                   ratio(frames["monte_carlo"], frames["hybrid_warm"])["value"], None, None, "x"),
            Figure(f"{name}: share of Monte Carlo's frame in time.secondary",
                   shadow["monte_carlo"]["median"] / frames["monte_carlo"]["median"], None, None, "")]


def ceiling(context):
    """Upper bound on the gain of any shadow answerer: the same frame with visibility for free."""
    shots = {"bunny, 1 x 64, 4 degrees": context.shot("bunny_floor.xml", 1024, light(4), light_samples=64),
             "bunny, 1 x 64, 20 degrees": context.shot("bunny_floor.xml", 1024, light(20), light_samples=64),
             "bunny, 64 x 1, 4 degrees": context.shot("bunny_floor.xml", 512, light(4), spp=64),
             "three objects, 4 x 16": context.shot("three_objects.xml", 512, context.three_objects(), spp=4,
                                                   light_samples=16)}
    if context.quick:
        shots = dict(list(shots.items())[:1])
    figures = [figure for name, shot in shots.items() for figure in ceiling_of(context, name, shot)]
    return RowResult(figures, ["Free: no shading point has anything between itself and a light; all light samples are still "
                               "drawn, weighted and added up."])


def second_light(context):
    """Growth of the whole frame by a second light of the same size; warm, Monte Carlo beside it."""
    programs = context.programs
    jobs = {}
    for scene in ("bunny_floor.xml", "bunny_two_lights.xml"):
        base = context.shot(scene, 1024, light(4), light_samples=64)
        fields = base.with_(method="hybrid")
        cache = programs.cache_for(fields)
        jobs[scene, "montecarlo"] = lambda base=base: frame_seconds(programs.render(base))
        jobs[scene, "hybrid"] = lambda f=fields, c=cache: frame_seconds(programs.render(f, cache=c))
    runs = {name: summary(values) for name, values in in_turn(jobs, context.repeats).items()}
    figures = []
    for method, target in (("hybrid", 1.3), ("montecarlo", None)):
        growth = ratio(runs["bunny_two_lights.xml", method], runs["bunny_floor.xml", method])
        figures.append(Figure(f"frame with two lights / with one, {method}{', warm' if target else ''}",
                              growth["value"], AT_MOST if target else None, target, "x",
                              {"one": runs["bunny_floor.xml", method], "two": runs["bunny_two_lights.xml", method],
                               "command": programs.last_command}))
    return RowResult(figures)


def threads(context):
    """The whole frame on one thread over that on two."""
    programs = context.programs
    if len(os.sched_getaffinity(0)) < 2:
        return RowResult([], skipped="this machine has one core")
    base = context.shot("bunny_floor.xml", 1024, light(4), light_samples=64)
    fields = base.with_(method="hybrid")
    jobs = {}
    for method, shot, cache in (("hybrid, warm", fields, programs.cache_for(fields)),
                                ("hybrid, cold", fields, None), ("montecarlo", base, None)):
        for count in (1, 2):
            threaded = shot.with_(options=("--threads", str(count)))
            jobs[method, count] = lambda t=threaded, c=cache: frame_seconds(programs.render(t, cache=c))
    runs = {name: summary(values) for name, values in in_turn(jobs, context.repeats).items()}
    figures = []
    for method in ("hybrid, warm", "hybrid, cold", "montecarlo"):
        speedup = ratio(runs[method, 1], runs[method, 2])
        target = 1.8 if method == "hybrid, warm" else None
        figures.append(Figure(f"frame on 1 thread / on 2, {method}", speedup["value"], AT_LEAST if target else None,
                              target, "x", {"one": runs[method, 1], "two": runs[method, 2], "ratio": speedup}))
    return RowResult(figures)
