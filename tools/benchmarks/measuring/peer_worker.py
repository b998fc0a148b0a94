#!/usr/bin/env python3
"""Renders scenes in Mitsuba 3 and times them: one process per scene and variant, so that loading, building and
kernel compilation happen once and are excluded. Run by measure.py with a Python that has `mitsuba` and `numpy`.

Reads one JSON object per line from stdin, {"spp", "seed", "integrator", "picture"}, and answers each with
{"seconds"}, which is meaningful only if `picture` is null. The integrator is "path" (max_depth 2: one light sample and
one BSDF sample per camera sample, weighted), "direct" (one light sample only, as Fieldtrace does for diffuse surfaces),
"direct:N" (N light samples per camera sample), "path:N" (max_depth N), or "denoised:N": path:N followed by Open Image
Denoise (the package pyoidn) with albedo and shading normal as further inputs; its time is included.
"""

import json
import os
import sys
import time


def main():
    # Mitsuba's output goes to stderr: stdout is reserved for the answers.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    variant, scene_file, folders, defines = json.loads(sys.argv[1])
    import mitsuba as mi
    mi.set_variant(variant)
    mi.set_log_level(mi.LogLevel.Error)
    import drjit as dr
    for folder in folders:
        mi.file_resolver().append(folder)
    scene = mi.load_file(scene_file, **defines)
    import numpy
    try:
        import pyoidn
    except ImportError:
        pyoidn = None
    integrators = {}

    def integrator_for(name):
        if name not in integrators:
            kind, _, number = name.partition(":")
            if kind == "direct":
                direct = {"type": "direct", "emitter_samples": int(number or 1), "bsdf_samples": 0}
                integrators[name] = mi.load_dict(direct)
                return integrators[name]
            path = {"type": "path", "max_depth": int(number or 2)}
            layers = {"type": "aov", "aovs": "albedo:albedo,normal:sh_normal", "path": path}
            integrators[name] = mi.load_dict(layers if kind == "denoised" else path)
        return integrators[name]

    def denoised(picture):
        layers = numpy.array(picture, dtype=numpy.float32)
        if layers.shape[2] != 9:
            sys.exit(f"the picture has {layers.shape[2]} channels, not 9: colour, albedo and normal")
        colour, albedo, normal = (numpy.ascontiguousarray(layers[:, :, i:i + 3]) for i in (0, 3, 6))
        return pyoidn.denoise(colour, albedo=albedo, normal=normal, hdr=True)

    def render(spp, seed, integrator):
        begin = time.perf_counter()
        picture = mi.render(scene, spp=spp, seed=seed, integrator=integrator_for(integrator))
        dr.eval(picture)
        dr.sync_thread()
        if integrator.startswith("denoised"):
            picture = denoised(picture)
        return picture, time.perf_counter() - begin

    compiled = set()
    print(json.dumps({"version": mi.__version__, "denoises": pyoidn is not None}), file=answers, flush=True)
    for line in sys.stdin:
        job = json.loads(line)
        kernel = (job["spp"], job["integrator"])
        if kernel not in compiled and not job["picture"]:
            # The first render of its kind compiles; the time of a render with an image is not used.
            render(job["spp"], 12345, job["integrator"])
            compiled.add(kernel)
        picture, seconds = render(job["spp"], job["seed"], job["integrator"])
        if job["picture"]:
            mi.Bitmap(picture).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32).write(job["picture"])
        print(json.dumps({"seconds": seconds}), file=answers, flush=True)


if __name__ == "__main__":
    main()
