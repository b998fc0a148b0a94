"""Rows on the errors of fields, and on the cells that a frame needs."""

from .context import AT_MOST, Figure, RowResult, light
from .programs import BenchmarkError

# Makes the unshadowed floor about as bright as 1, so that errors read as errors of visibility.
FLOOR_OF_ONE = 1800.0


def bright_light(angle):
    (_, radius), _ = light(angle)
    return (("light_radius", radius), ("light_radiance", FLOOR_OF_ONE * (0.16 / radius) ** 2))


def converged_on(context, path, defines):
    """`fieldtrace compare` of hybrid and Monte Carlo, both converged with the same seed: the effect of the fields."""
    programs = context.programs
    shot = context.shot("bunny_floor.xml", 512,
                        (("mesh", path), ("format", path.suffix[1:]), *bright_light(4), *defines),
                        spp=4, light_samples=context.samples(1024))
    reference = programs.reference(shot)
    picture = programs.work / "picture.exr"
    stats = programs.render(shot.with_(method="hybrid"), picture=picture)
    found = programs.compare(picture, reference)
    return {**found, "exact_fraction": stats["exact_fraction"], "field": stats["field"],
            "command": programs.last_command}


def converged(context):
    """Converged hybrid against converged Monte Carlo at the default tolerance: RMSE and worst 16 x 16 block."""
    results = {}
    for name, path, defines in context.listed_meshes():
        if not path.is_file():
            raise BenchmarkError(f"{path} is missing; it is listed in {context.meshes}")
        results[name] = converged_on(context, path, dict(defines).items())
    worst_rmse = max(results, key=lambda n: results[n]["rmse"])
    worst_block = max(results, key=lambda n: results[n]["worst_block"]["rmse"])
    figures = [Figure(f"largest RMSE of {len(results)} meshes ({worst_rmse})", results[worst_rmse]["rmse"], AT_MOST,
                      0.004, "", results),
               Figure(f"largest block of {len(results)} meshes ({worst_block})",
                      results[worst_block]["worst_block"]["rmse"], AT_MOST, 0.02, "")]
    for name, r in results.items():
        figures.append(Figure(f"{name}: RMSE", r["rmse"]))
        figures.append(Figure(f"{name}: worst block", r["worst_block"]["rmse"]))
    return RowResult(figures, ["The unshadowed floor has a radiance of about 1."])


def check(context):
    """Share of certified answers that an exact ray contradicts (--check)."""
    shots = {"bunny on a floor, 4 degrees": context.shot("bunny_floor.xml", 1024, light(4), light_samples=64),
             "bunny on a floor, 20 degrees": context.shot("bunny_floor.xml", 1024, light(20), light_samples=64),
             "close-up, 4 degrees": context.shot("bunny_closeup.xml", 1024, light(4), light_samples=64),
             "three objects": context.shot("three_objects.xml", 512, context.three_objects(), light_samples=64)}
    figures = []
    for name, shot in shots.items():
        stats = context.programs.render(shot.with_(method="hybrid", options=("--check",)))
        answers, wrong = stats["check"]["answers"], stats["check"]["wrong"]
        figures.append(Figure(name, 100.0 * wrong / answers if answers else None, None, None, "%",
                              {"check": stats["check"], "command": context.programs.last_command}))
    return RowResult(figures)


def cells(context):
    """Cells baked for one frame over all cells, at 64 x 128, under a light of 4 degrees."""
    shot = context.shot("bunny_floor.xml", 1024, light(4), method="hybrid", light_samples=64,
                        options=("--directions", "64", "--plane", "128"))
    field = context.programs.render(shot)["field"]
    return RowResult([Figure("cells baked", 100.0 * field["cells_baked"] / field["cells_full"], AT_MOST, 1.0, "%",
                             {"field": field, "command": context.programs.last_command})])
