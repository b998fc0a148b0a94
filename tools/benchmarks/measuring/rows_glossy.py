"""Rows on glossy reflection.

In the first two, only the error of lobe samples counts, as in rows_error: references have the same camera rays and
many times the lobe samples. The last takes the error of the whole frame, as in rows_peer.
"""

import contextlib

from .context import AT_LEAST, AT_MOST, Figure, RowResult
from .peer import Peer
from .programs import BenchmarkError, frame_seconds
from .rows_peer import OTHER_SEED, OUR_METHODS, OWN_MONTE_CARLO, against, frame_notes
from .search import fewest, staircase
from .timing import in_turn, ratio, summary

REFERENCE_FACTOR = 16
IDENTICAL_DB = 200.0  # stands for the infinite PSNR of identical images
SAMPLES = 64
# Of scenes/reflection_1.xml: the depth of its paths, and the region of the film (x, y, width, height) that the
# hyperboloid covers.
REFLECTION_DEPTH = 4
REFLECTOR = (0.21, 0.3, 0.18, 0.4)


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


def our_jobs(context, shot, reference, crop, aim):
    """Each of our methods with its quickest pair of camera and lobe samples for the error: {name: (job, details)}."""
    programs = context.programs
    jobs = {}
    for name, (method, options) in OUR_METHODS.items():
        def measure(spp, count, name=name, method=method, options=options):
            error, stats = programs.error(lobes(shot.with_(method=method, spp=spp), count, *options), reference, crop=crop)
            context.log(f"  {name}, {spp} x {count}: RMSE {error:.5f}, {frame_seconds(stats):.3f} s")
            return error, frame_seconds(stats)

        reached = staircase(measure, aim, 16 if context.quick else 64, 8 if context.quick else 64)
        if reached:
            spp, count = reached[0]["spp"], reached[0]["light_samples"]
            best = lobes(shot.with_(method=method, spp=spp), count, *options)
            jobs[name] = (lambda best=best: frame_seconds(programs.render(best)),
                            {"spp": spp, "lobe_samples": count, "rmse": reached[0]["rmse"]})
    return jobs


def our_denoised_jobs(context, shot, reference, crop, aim, notes):
    """Our methods with one lobe sample and --denoise, the fewest camera samples for the error: {name: (job, details)}."""
    programs, jobs = context.programs, {}
    for name, (method, options) in OUR_METHODS.items():
        base = lobes(shot.with_(method=method), 1, "--denoise", *options)
        try:
            spp, errors = fewest(lambda n: programs.error(base.with_(spp=n), reference, crop=crop)[0], aim, 1)
        except BenchmarkError as e:
            notes.append(f"Our denoised pictures left out: {e}")
            break
        if spp is not None:
            best = base.with_(spp=spp)
            jobs[f"{name} denoised"] = (lambda best=best: frame_seconds(programs.render(best)),
                                          {"spp": spp, "rmse": errors[spp]})
    return jobs


def peer_jobs(context, peer, reference, crop, aim):
    """Mitsuba's path tracer with the fewest samples for the error, raw and denoised: {name: (job, details)}."""
    picture = context.programs.work / "peer.exr"
    jobs = {}
    for kind in ("path", "denoised") if peer.denoises else ("path",):
        integrator = f"{kind}:{REFLECTION_DEPTH}"

        def error_of(spp, integrator=integrator):
            peer.render(spp, seed=1, integrator=integrator, picture=picture)
            error = context.programs.compare(picture, reference, crop)["rmse"]
            context.log(f"  {peer.variant} {integrator}, {spp} samples: RMSE {error:.5f}")
            return error

        spp, errors = fewest(error_of, aim, 16)
        if spp is not None:
            jobs[kind] = (lambda spp=spp, integrator=integrator: peer.render(spp, integrator=integrator),
                          {"spp": spp, "rmse": errors[spp]})
    return jobs


def reflection(context):
    """A hyperboloid of rough metal (GGX .2) mirrors a supershape: the frame to an RMSE of .01 on the hyperboloid."""
    programs = context.programs
    meshes = (("hyperboloid", programs.mesh("hyperboloid", "hyperboloid")),
              ("supershape", programs.mesh("supershape6", "supershape --m 6")))
    shot = context.shot("reflection_1.xml", 512, meshes, light_samples=1)
    size = dict(shot.defines)["resolution"]
    crop = [int(share * size) for share in REFLECTOR]
    aim = 0.1 if context.quick else 0.01
    reference = programs.reference(lobes(shot.with_(spp=context.samples(96), seed=OTHER_SEED), 64))
    methods, notes = {}, frame_notes(context)
    with contextlib.ExitStack() as stack:
        jobs = our_jobs(context, shot, reference, crop, aim)
        jobs.update(our_denoised_jobs(context, shot, reference, crop, aim, notes))
        if not context.peer_missing:
            try:
                peer = stack.enter_context(Peer(context.peer_python, "llvm_ad_rgb", shot.scene, shot.defines))
                peer.render(1)  # fails here if LLVM is too old
            except BenchmarkError as e:
                notes.append(f"Mitsuba left out: {e}")
            else:
                jobs.update(peer_jobs(context, peer, reference, crop, aim))
                if not peer.denoises:
                    notes.append("Denoising left out: --peer-python lacks the package pyoidn")
        for name, seconds in in_turn({name: job for name, (job, _) in jobs.items()}, context.repeats).items():
            methods[name] = {**jobs[name][1], "seconds": summary(seconds)}
    figures = [Figure("own Monte Carlo / hybrid", against(methods, OWN_MONTE_CARLO), None, None, "x", methods)]
    if not context.peer_missing:
        figures.append(Figure("Mitsuba / hybrid", against(methods, ["path"]), AT_LEAST, 8.0, "x"))
        figures.append(Figure("Mitsuba, denoised / hybrid", against(methods, ["denoised"]), AT_LEAST, 1.5, "x"))
        figures.append(Figure("Mitsuba, denoised / hybrid, denoised",
                              against(methods, ["denoised"], "hybrid denoised"), AT_LEAST, 1.5, "x"))
    return RowResult(figures, notes)
