"""Rows against Mitsuba 3: the baseline at equal samples, and whole frames at equal error.

Ours: the wall time of the frame (programs.frame_seconds). Mitsuba: one mi.render() call in a process that has loaded
the scene and compiled its kernels. Errors are against our converged Monte Carlo image with another seed, which averages
over camera rays too; the deviation of Mitsuba's mean from it is in the details.
"""

import contextlib

from .context import AT_LEAST, AT_MOST, Figure, RowResult, light
from .peer import VARIANTS, Peer
from .programs import ADAPTIVE, BenchmarkError, frame_seconds
from .search import LADDER, fewest, staircase
from .timing import in_turn, ratio, summary

INTEGRATORS = ("direct", "path")
# Our methods: {name: (--method, further options)}. The quicker of the first two counts as our Monte Carlo.
OUR_METHODS = {"montecarlo": ("montecarlo", ()), "montecarlo adaptive": ("montecarlo", ADAPTIVE),
               "hybrid": ("hybrid", ())}
OWN_MONTE_CARLO = ("montecarlo", "montecarlo adaptive")
OTHER_SEED = 1000


def peer_error(context, peer, spp, integrator, reference):
    picture = context.programs.work / "peer.exr"
    peer.render(spp, seed=1, integrator=integrator, picture=picture)
    return context.programs.compare(picture, reference)


def baseline_under(context, angle):
    programs = context.programs
    spp = 64
    shot = context.shot("bunny_floor.xml", 512, light(angle), spp=spp)
    reference = programs.reference(shot.with_(spp=context.samples(1024), light_samples=4, seed=OTHER_SEED))
    with Peer(context.peer_python, "llvm_ad_rgb", shot.scene, shot.defines) as peer:
        jobs = {"ours": lambda: frame_seconds(programs.render(shot))}
        for integrator in INTEGRATORS:
            jobs[integrator] = lambda integrator=integrator: peer.render(spp, integrator=integrator)
        runs = {name: summary(values) for name, values in in_turn(jobs, context.repeats).items()}
        error, stats = programs.error(shot, reference)
        theirs = {i: peer_error(context, peer, spp, i, reference) for i in INTEGRATORS}
    figures = []
    for integrator in INTEGRATORS:
        # The target applies to the integrator that does the same work.
        aims = (1.3, 1.1) if integrator == "direct" else (None, None)
        relation = AT_MOST if aims[0] else None
        time = ratio(runs["ours"], runs[integrator])
        details = {"command": programs.last_command, "ours": runs["ours"], "mitsuba": runs[integrator],
                   "ratio": time, "rmse": error, "mitsuba_compare": theirs[integrator], "our_times": stats["time"]}
        what = f"light of {angle} degrees, Mitsuba's `{integrator}`"
        figures.append(Figure(f"time, {what}", time["value"], relation, aims[0], "x", details))
        figures.append(Figure(f"RMSE, {what}", error / theirs[integrator]["rmse"], relation, aims[1], "x",
                              {"rmse": error, "mitsuba_rmse": theirs[integrator]["rmse"]}))
    return figures


def baseline(context):
    """Monte Carlo against Mitsuba (llvm_ad_rgb, multijitter), 64 camera samples with one light sample each."""
    if context.peer_missing:
        return RowResult([], skipped=context.peer_missing)
    notes = ["Ours: time.total less time.load, time.build and time.write: camera rays, light samples, shadow rays, "
             "shading. Mitsuba: one render call; load, build and kernel compilation left out. `direct` takes one light "
             "sample and none of the material, as ours does for diffuse surfaces; `path` (max_depth 2) takes both."]
    return RowResult(baseline_under(context, 4) + baseline_under(context, 20), notes)


def cheapest(context, name, base, reference, aim, is_warm):
    """The quickest (spp, light samples) of our method `name` that reach the error; None if none does."""
    programs = context.programs

    def measure(spp, light_samples):
        shot = base.with_(spp=spp, light_samples=light_samples)
        cache = programs.cache_for(shot) if is_warm else None
        error, stats = programs.error(shot, reference, cache)
        seconds = frame_seconds(stats)
        context.log(f"  {name}, {spp} x {light_samples}: RMSE {error:.5f}, {seconds:.3f} s")
        return error, seconds

    reached = staircase(measure, aim, 16 if context.quick else 512, 8 if context.quick else 64)
    return reached[0] if reached else None


def start_peers(context, stack, shot, folders):
    """Mitsuba's variants on the shot's scene: {variant: Peer}, and failures: {name: {"error": text}}."""
    peers, failed = {}, {}
    for variant in VARIANTS:
        try:
            peer = stack.enter_context(Peer(context.peer_python, variant, shot.scene, shot.defines, folders))
            peer.render(1)  # fails here if LLVM is too old
            peers[variant] = peer
        except BenchmarkError as e:
            context.log(f"  {variant}: {e}")
            failed[f"{variant} failed"] = {"error": str(e)}
    return peers, failed


def peer_jobs(context, peers, reference, aim):
    """Each variant and integrator with the fewest samples for the error: {name: (job, details)}.

    The variants draw the same samples, so the search uses the quickest one (kernels of large scenes compile for
    half a minute).
    """
    jobs = {}
    for integrator in INTEGRATORS:
        if not peers:
            break
        first = LADDER[6]
        quickest = min(peers.values(), key=lambda peer: peer.render(first, integrator=integrator))

        def error_of(spp, peer=quickest, integrator=integrator):
            error = peer_error(context, peer, spp, integrator, reference)["rmse"]
            context.log(f"  {peer.variant} {integrator}, {spp} samples: RMSE {error:.5f}")
            return error

        spp, errors = fewest(error_of, aim, first)
        if spp is None:
            continue
        for variant, peer in peers.items():
            job = lambda peer=peer, spp=spp, integrator=integrator: peer.render(spp, integrator=integrator)
            jobs[f"{variant} {integrator}"] = (job, {"spp": spp, "rmse": errors[spp], "searched": peer is quickest})
    return jobs


def frame_to_error(context, shot, reference_shot, aim, is_warm, folders=()):
    """Times of the whole frame at the error: {method: {..., seconds: summary}}, without methods that cannot reach it."""
    programs = context.programs
    reference = programs.reference(reference_shot)
    methods, jobs = {}, {}
    with contextlib.ExitStack() as stack:
        if not context.peer_missing:
            peers, failed = start_peers(context, stack, shot, folders)
            methods.update(failed)
            for name, (job, details) in peer_jobs(context, peers, reference, aim).items():
                methods[name] = details
                jobs[name] = job
        for name, (method, options) in OUR_METHODS.items():
            warm = is_warm and method == "hybrid"
            ours = shot.with_(method=method, options=(*shot.options, *options))
            chosen = cheapest(context, name, ours, reference, aim, warm)
            if chosen is None:
                continue
            best = ours.with_(spp=chosen["spp"], light_samples=chosen["light_samples"])
            cache = programs.cache_for(best) if warm else None
            methods[name] = {key: chosen[key] for key in ("spp", "light_samples", "rmse")}
            jobs[name] = lambda best=best, cache=cache: frame_seconds(programs.render(best, cache=cache))
        for name, seconds in in_turn(jobs, context.repeats).items():
            methods[name]["seconds"] = summary(seconds)
    return methods


def against(methods, names, ours="hybrid"):
    """Ratio of the quickest of `names` to `ours`; None if either is missing."""
    found = [methods[n]["seconds"] for n in names if "seconds" in methods.get(n, {})]
    if not found or "seconds" not in methods.get(ours, {}):
        return None
    return ratio(min(found, key=lambda s: s["median"]), methods[ours]["seconds"])["value"]


def peer_names(methods, variants=VARIANTS):
    return [n for n in methods if n.startswith(variants)]


def frame_notes(context):
    return [f"Mitsuba left out: {context.peer_missing}"] if context.peer_missing else []


def three_objects(context):
    """Three objects, three lights, 56,832 triangles: the whole frame to an RMSE of .005, fields warm."""
    shot = context.shot("three_objects.xml", 512, context.three_objects())
    aim = 0.05 if context.quick else 0.005
    reference = shot.with_(spp=context.samples(256), light_samples=8, seed=OTHER_SEED)
    methods = frame_to_error(context, shot, reference, aim, is_warm=True)
    figures = [Figure("own Monte Carlo / hybrid, warm", against(methods, OWN_MONTE_CARLO), AT_LEAST, 5.0, "x", methods)]
    if not context.peer_missing:
        names = peer_names(methods)
        figures.append(Figure("Mitsuba's quickest / hybrid, warm", against(methods, names), AT_LEAST, 4.0, "x",
                              {"candidates": names}))
    return RowResult(figures, frame_notes(context))


def crowd(context):
    """400 instances of a knot of 100 k triangles, a light of 20 degrees: to an RMSE of .01, the bake counted."""
    count, words = (36, "knot --along 256 --around 16") if context.quick else (400, "knot --along 1562 --around 32")
    folder = context.programs.crowd(words, count)
    # The light is about 108 units away.
    shot = context.shot("crowd.xml", 512, (("crowd", (folder / "instances.xml").resolve()), ("light_radius", 19),
                                           ("light_radiance", 17.7)))
    aim = 0.05 if context.quick else 0.01
    reference = shot.with_(spp=context.samples(256), light_samples=8, seed=OTHER_SEED)
    methods = frame_to_error(context, shot, reference, aim, is_warm=False, folders=[folder.resolve()])
    figures = [Figure("own Monte Carlo / hybrid, cold", against(methods, OWN_MONTE_CARLO), None, None, "x", methods)]
    if not context.peer_missing:
        names = peer_names(methods)
        figures.append(Figure("Mitsuba's better variant / hybrid, cold", against(methods, names), AT_LEAST, 4.0, "x",
                              {"candidates": names}))
    return RowResult(figures, frame_notes(context))
