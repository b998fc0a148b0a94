"""Rows on single look-ups: against Embree's rays, and as a function of the number of triangles."""

from .context import AT_LEAST, AT_MOST, Figure, RowResult
from .timing import in_turn, ratio, summary

BUNNY = "/usr/share/glmark2/models/bunny.obj"


def rates_of(runs, place):
    """Summaries of the fastest look-up and the fastest Embree form, by their medians over the runs."""
    result = {}
    for kind, prefix in (("lookup", f"LookUp.{place}."), ("embree", f"EmbreeOccluded.{place}.")):
        forms = {name: summary([r[name]["rays/s"] for r in runs]) for name in runs[0] if name.startswith(prefix)}
        best = max(forms, key=lambda name: forms[name]["median"])
        result[kind] = {"form": best, **forms[best], "all_forms": {n: f["median"] for n, f in forms.items()}}
        if kind == "lookup":
            result["undecided"] = runs[0][best]["undecided"]
            result["lookups_per_ray"] = runs[0][best]["look-ups/ray"]
    result["ratio"] = ratio(result["lookup"], result["embree"])
    return result


def lookups(context):
    """Look-ups a second and core over Embree's best occlusion rays, the same rays, all crossing the object's ball."""
    programs = context.programs
    big = "knot --along 256 --around 32" if context.quick else "knot --along 8192 --around 64"
    meshes = {"bunny": (BUNNY, 10.0), "torus knot of 1 M triangles": (programs.mesh("knot1m", big), 14.0)}
    runs = in_turn({name: lambda path=path: programs.lookup_benchmark(path, context.quick)
                    for name, (path, _) in meshes.items()}, context.repeats)
    figures = []
    for name, (_, target) in meshes.items():
        elsewhere = rates_of(runs[name], "elsewhere")
        on_object = rates_of(runs[name], "own_surface")
        figures.append(Figure(f"{name}, shading points elsewhere", elsewhere["ratio"]["value"], AT_LEAST, target, "x",
                              elsewhere))
        figures.append(Figure(f"{name}, shading points on the object", on_object["ratio"]["value"], None, None, "x",
                              on_object))
    return RowResult(figures, ["Rays a second of one core's processor time; 8,192 rays that stay in cache; rays that "
                               "are undecided are counted as answered (their share is in the details)."])


def size(context):
    """Cost of a look-up for 2 M triangles over that for 16 k: the same knot at two tessellations."""
    programs = context.programs
    big = "knot --along 256 --around 64" if context.quick else "knot --along 8192 --around 128"
    meshes = {"16 k": programs.mesh("knot16k", "knot --along 256 --around 32"), "2 M": programs.mesh("knot2m", big)}
    runs = in_turn({name: lambda path=path: programs.lookup_benchmark(path, context.quick)
                    for name, path in meshes.items()}, context.repeats)
    figures = []
    for place, text in (("elsewhere", "shading points elsewhere"), ("own_surface", "shading points on the object")):
        small, large = rates_of(runs["16 k"], place), rates_of(runs["2 M"], place)
        cost = ratio(small["lookup"], large["lookup"])
        figures.append(Figure(f"cost of a look-up, 2 M / 16 k triangles, {text}", cost["value"], AT_MOST, 1.15, "x",
                              {"cost": cost, "16 k": small, "2 M": large,
                               "embree_cost": ratio(small["embree"], large["embree"])}))
    return RowResult(figures)
