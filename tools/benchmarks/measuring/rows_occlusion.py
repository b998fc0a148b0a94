"""Row on the stage of the layer `ao`: seconds to an error of the layer, Monte Carlo's over the hybrid's.

One camera sample a pixel and no light, so that the layer's rays are all secondary rays. References have the same camera
rays (same seed) and 4,096 rays a point. Time between the two steps of the ladder around an error is interpolated, as for
whole frames.
"""

import dataclasses

from . import frame_scenes as fs
from .context import AT_LEAST, Figure, RowResult
from .programs import Shot
from .rows_error import secondary, secondary_and_bake
from .search import fewest
from .timing import in_turn, summary
from .whole_frames import around_aim, time_to

REFERENCE_RAYS = 4096
LAYER = "ao"
OPTIONS = ("--max-depth", "1", "--aov", LAYER)
COLD_AIM = {0.01: 3.0}


@dataclasses.dataclass(frozen=True)
class Stage:
    name: str
    text: object  # resolution -> str
    aims: dict  # {error: at least so many times as fast, warm}
    distance: float | None = None  # --ao-distance


def nine(context):
    """Nine turned objects over a floor: text of their shapes."""
    paths = [path for _, path in context.three_objects()]
    return [fs.mesh(paths[i % 3], fs.rotate("x", 25 * i - 90) + fs.rotate("y", 40 * i) +
                    fs.translate(2.4 * (i % 3 - 1), 1.0, 2.4 * (i // 3 - 1))) for i in range(9)]


def stages(context):
    raised = fs.translate(0, 1, 0)
    bunny = fs.text([fs.mesh(fs.BUNNY, raised), fs.floor()], [])
    words = "knot --along 256 --around 16" if context.quick else "knot --along 20000 --around 25"
    knot = fs.text([fs.mesh(context.programs.mesh("knot1m", words), raised), fs.floor()], [])
    objects = fs.text([*nine(context), fs.floor()], [], origin="0.4, 5.3, 11.2", target="0, 0.7, 0.2", fov=36)
    return [Stage("bunny", bunny, {0.01: 25.0, 0.005: 15.0}),
            Stage("knot of 1 M triangles", knot, {0.01: 40.0, 0.005: 25.0}),
            Stage("nine objects", objects, {0.01: 12.0, 0.005: 6.0}),
            Stage("bunny, within 1", bunny, {0.01: None, 0.005: None}, 1.0),
            Stage("knot of 1 M triangles, within 1", knot, {0.01: None, 0.005: None}, 1.0),
            Stage("nine objects, within 1", objects, {0.01: None, 0.005: None}, 1.0)]


def measure_stage(context, stage):
    """{error: {method: summary of seconds}}."""
    programs = context.programs
    path = programs.scene(stage.name, stage.text(context.resolution or (64 if context.quick else 512)))
    distance = () if stage.distance is None else ("--ao-distance", str(stage.distance))
    rays = Shot(path, options=(*OPTIONS, *distance))
    reference = programs.reference(rays.with_(light_samples=context.samples(REFERENCE_RAYS)))
    maps = rays.with_(method="hybrid")
    methods = {"Monte Carlo": (rays, False, secondary), "warm": (maps, True, secondary),
               "cold": (maps, False, secondary_and_bake)}

    def render(name, count, picture=None):
        base, is_warm, seconds = methods[name]
        shot = base.with_(light_samples=count)
        return seconds(programs.render(shot, picture, programs.cache_for(shot) if is_warm else None))

    def error(name, count):
        picture = programs.work / "picture.exr"
        render(name, count, picture)
        return programs.compare(picture, reference, layer=LAYER)["rmse"]

    found = {}
    for aim in stage.aims:
        steps, errors = {}, {}
        for name in methods:
            count, measured = fewest(lambda n, m=name: error(m, n), aim, 64)
            if count:
                steps[name], errors[name] = around_aim(aim, measured, count), measured
        times = in_turn({(name, n): lambda m=name, k=n: render(m, k) for name in steps for n in steps[name]},
                        context.repeats)
        found[aim] = {}
        for name in steps:
            points = [errors[name][n] for n in steps[name]]
            repeats = zip(*(times[name, n] for n in steps[name]))
            found[aim][name] = {**summary(time_to(aim, list(zip(points, r))) for r in repeats),
                                "light_samples": steps[name], "rmse": points}
        text = ", ".join(f"{name} {s['median']:.3f} s" for name, s in found[aim].items())
        context.log(f"  {stage.name} to {aim}: {text}")
    return found


def figures_of(stage, found):
    figures = []
    for aim, warm_target in stage.aims.items():
        medians = {name: s["median"] for name, s in found[aim].items()}
        cold_target = COLD_AIM.get(aim) if warm_target else None
        for name, target in (("warm", warm_target), ("cold", cold_target)):
            reached = "Monte Carlo" in medians and name in medians
            figures.append(Figure(f"{stage.name}, to {aim:g}: Monte Carlo / {name}",
                                  medians["Monte Carlo"] / medians[name] if reached else None,
                                  AT_LEAST if target else None, target, "x", found[aim] if name == "warm" else {}))
    return figures


def occlusion(context):
    """The stage of the layer `ao` to equal error: Monte Carlo's time.secondary over the hybrid's, cold with its bake."""
    wanted = stages(context)[:1] if context.quick else stages(context)
    return RowResult([figure for stage in wanted for figure in figures_of(stage, measure_stage(context, stage))])
