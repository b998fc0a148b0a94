"""Whole frames of N camera samples with one light sample each, as most pictures are made: seconds to an error.

Every method gets the samples that reach the error; between the two steps of the ladder around it, time is interpolated
along error (both logarithmic). Seconds are those of programs.frame_seconds, which leave out reading the scene, building
Embree's BVHs and writing the picture; Mitsuba's are of one render call without compiling.
"""

import contextlib
import dataclasses
import math

from .context import AT_LEAST, Figure, RowResult
from .peer import Peer
from .programs import ADAPTIVE, BenchmarkError, Shot, frame_seconds
from .search import fewest
from .timing import in_turn, summary

OTHER_SEED = 1000


@dataclasses.dataclass(frozen=True)
class Frame:
    """One scene: its file's text for a resolution, and {error: aims (against our Monte Carlo, against Mitsuba)}."""

    name: str
    text: object  # resolution -> str
    aims: dict
    peers: tuple = ("direct:1", "direct:4")  # Mitsuba's integrators; the quicker of `direct` or `path` counts
    reference_spp: int = 4096
    folders: tuple = ()


def time_to(aim, points):
    """Seconds to the error `aim`, from [(error, seconds)] of the last step above it and the first below it."""
    (above, slow), (below, fast) = points[0], points[-1]
    if len(points) == 1 or above <= below:
        return points[-1][1]
    share = math.log(above / aim) / math.log(above / below)
    return math.exp(math.log(slow) + share * (math.log(fast) - math.log(slow)))


def around_aim(aim, errors, found):
    """The ladder's steps on both sides of the aim that were measured: [spp, ...], fewest first."""
    before = [n for n in errors if n < found and errors[n] > aim]
    return ([max(before)] if before else []) + [found]


class Method:
    """A way to make the picture. error(spp): RMSE; seconds(spp): of one frame."""

    def __init__(self, error, seconds):
        self.error, self.seconds = error, seconds


def own_method(programs, shot, reference, is_warm=False):
    def with_cache(spp):
        wanted = shot.with_(spp=spp)
        return wanted, programs.cache_for(wanted) if is_warm else None

    def error(spp):
        wanted, cache = with_cache(spp)
        return programs.error(wanted, reference, cache)[0]

    def seconds(spp):
        wanted, cache = with_cache(spp)
        return frame_seconds(programs.render(wanted, cache=cache))

    return Method(error, seconds)


def peer_method(programs, peer, integrator, reference):
    picture = programs.work / "peer.exr"

    def error(spp):
        peer.render(spp, seed=1, integrator=integrator, picture=picture)
        return programs.compare(picture, reference)["rmse"]

    return Method(error, lambda spp: peer.render(spp, integrator=integrator))


def methods_of(context, stack, frame, shot, reference):
    programs = context.programs
    fields = shot.with_(method="hybrid")
    found = {"Monte Carlo": own_method(programs, shot, reference),
             "Monte Carlo, adaptive": own_method(programs, shot.with_(options=ADAPTIVE), reference),
             "cold": own_method(programs, fields, reference),
             "warm": own_method(programs, fields, reference, is_warm=True)}
    if not context.peer_missing:
        try:
            peer = Peer(context.peer_python, "llvm_ad_rgb", shot.scene, shot.defines, frame.folders)
            stack.enter_context(peer)
            for integrator in frame.peers:
                found[f"Mitsuba {integrator}"] = peer_method(programs, peer, integrator, reference)
        except BenchmarkError as e:
            context.log(f"  Mitsuba: {e}")
    return found


def measure_frame(context, frame):
    """Seconds of each method to each aim: {error: {method: summary}}."""
    programs = context.programs
    shot = Shot(programs.scene(frame.name, frame.text(context.resolution or (32 if context.quick else 512))))
    reference = programs.reference(shot.with_(spp=context.samples(frame.reference_spp), seed=OTHER_SEED))
    seconds = {}
    with contextlib.ExitStack() as stack:
        methods = methods_of(context, stack, frame, shot, reference)
        for aim in frame.aims:
            steps, errors = {}, {}
            for name, method in methods.items():
                found, measured = fewest(method.error, aim, 4)
                if found:
                    steps[name], errors[name] = around_aim(aim, measured, found), measured
            jobs = {(name, spp): lambda n=name, s=spp: methods[n].seconds(s) for name in steps for spp in steps[name]}
            times = in_turn(jobs, context.repeats)
            seconds[aim] = {}
            for name in steps:
                repeats = zip(*(times[name, spp] for spp in steps[name]))
                points = [errors[name][spp] for spp in steps[name]]
                seconds[aim][name] = {**summary(time_to(aim, list(zip(points, r))) for r in repeats),
                                      "spp": steps[name], "rmse": points}
            text = ", ".join(f"{name} {s['median']:.3f} s" for name, s in seconds[aim].items())
            context.log(f"  {frame.name} to {aim}: {text}")
    return seconds


def figures_of(frame, seconds):
    figures = []
    for aim, (own_target, peer_target) in frame.aims.items():
        medians = {name: s["median"] for name, s in seconds[aim].items()}
        best = lambda start: min((v for n, v in medians.items() if n.startswith(start)), default=None)

        def against(other, ours):
            return other / ours if other and ours else None

        def add(name, other, ours, aim_at_least=None, details=None):
            relation = AT_LEAST if aim_at_least else None
            figures.append(Figure(f"{frame.name}, to {aim:g}: {name}", against(other, medians.get(ours)), relation,
                                  aim_at_least, "x", details or {}))

        own = best("Monte Carlo")
        add("Monte Carlo's better / warm", own, "warm", own_target, seconds[aim])
        add("Monte Carlo's better / cold", own, "cold")
        if peer := best("Mitsuba direct") or best("Mitsuba path"):
            add("Mitsuba's better / warm", peer, "warm", peer_target)
        if denoised := best("Mitsuba denoised"):
            add("Mitsuba with its denoiser / warm", denoised, "warm")
    return figures


def whole(context, frames):
    frames = frames[:1] if context.quick else frames
    figures = [figure for frame in frames for figure in figures_of(frame, measure_frame(context, frame))]
    return RowResult(figures, [f"Mitsuba left out: {context.peer_missing}"] if context.peer_missing else [])
