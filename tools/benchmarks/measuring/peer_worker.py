#!/usr/bin/env python3
"""Renders scenes in Mitsuba 3 and times them: one process per scene and variant, so that loading, building and
compiling kernels happen once and are left out. Run by measure.py with a Python that has `mitsuba` and `numpy`.

Reads one JSON object a line from stdin, {"spp", "seed", "integrator", "picture"}; answers with one, {"seconds"}. The
seconds mean something only where `picture` is null. The
integrator is "path" (max_depth 2: one light sample and one sample of the material per camera sample, weighted) or
"direct" (one light sample only, as Fieldtrace's own for diffuse surfaces).
"""

import json
import os
import sys
import time


def main():
    # Whatever Mitsuba prints goes to stderr: stdout belongs to the answers.
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
    integrators = {
        "path": mi.load_dict({"type": "path", "max_depth": 2}),
        "direct": mi.load_dict({"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}),
    }

    def render(spp, seed, integrator):
        begin = time.perf_counter()
        picture = mi.render(scene, spp=spp, seed=seed, integrator=integrators[integrator])
        dr.eval(picture)
        dr.sync_thread()
        return picture, time.perf_counter() - begin

    compiled = set()
    print(json.dumps({"version": mi.__version__}), file=answers, flush=True)
    for line in sys.stdin:
        job = json.loads(line)
        kernel = (job["spp"], job["integrator"])
        if kernel not in compiled and not job["picture"]:
            # The first render of its kind compiles; who wants a picture does not ask for its time.
            render(job["spp"], 12345, job["integrator"])
            compiled.add(kernel)
        picture, seconds = render(job["spp"], job["seed"], job["integrator"])
        if job["picture"]:
            mi.Bitmap(picture).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32).write(job["picture"])
        print(json.dumps({"seconds": seconds}), file=answers, flush=True)


if __name__ == "__main__":
    main()
