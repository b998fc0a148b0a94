"""Rows on whole frames at equal error (whole_frames.py): under area lights, and under skies."""

import math

from . import frame_scenes as fs
from .programs import text_hash
from .whole_frames import Frame, whole


def three(context):
    """Three objects side by side: text of their shapes."""
    paths = [path for _, path in context.three_objects()]
    up = fs.rotate("x", -90)
    return [fs.mesh(paths[0], up + fs.translate(-2.1, 0.95, 0.6), "0.76, 0.3, 0.2"),
            fs.mesh(paths[1], up + fs.translate(2.1, 0.8, 0.7), "0.14, 0.44, 0.48"),
            fs.mesh(paths[2], fs.rotate("y", 35) + fs.translate(0, 1, -0.6), "0.8, 0.75, 0.6")]


WIDE_VIEW = {"origin": "0.4, 4.3, 9.2", "target": "0, 0.7, 0.2", "fov": 36}


def crowd_shapes(context):
    """400 instances of a knot of 100 k triangles: text, and the folder of the file that it includes."""
    words = "knot --along 256 --around 16" if context.quick else "knot --along 1562 --around 32"
    folder = context.programs.crowd(words, 400)
    colours = (("ochre", "0.7, 0.5, 0.2"), ("slate", "0.3, 0.4, 0.5"), ("moss", "0.3, 0.5, 0.2"))
    materials = [fs.material(rgb, f' id="{name}"') for name, rgb in colours]
    return [*materials, f'<include filename="{(folder / "instances.xml").resolve()}"/>', fs.floor(100.0)]


CROWD_VIEW = {"origin": "0, 30, 75", "target": "0, 0, 12", "fov": 40}


def light_frames(context):
    raised = fs.translate(0, 1, 0)
    knot = [fs.mesh(context.programs.mesh("knot100k", "knot --along 1562 --around 32"), raised), fs.floor()]
    flat = [fs.mesh(fs.BUNNY, raised, flat=True), fs.floor()]
    smooth = [fs.mesh(fs.BUNNY, raised), fs.floor()]
    objects = [*three(context), fs.floor()]
    lights = [fs.sphere_light(6, (-4.6, 6.2, 4.4), 0.5), fs.sphere_light(12, (4.2, 6.8, 3.6), 0.3),
              fs.rectangle_light(15, (0.5, 6.6, -4.5), 0.2)]
    sixteen = [fs.rectangle_light(6, place, 1 / 16) for place in fs.around(16)]
    far = tuple(40.0 * c for c in fs.TOWARDS_LIGHT)

    return [
        Frame("knot, rectangle of 20 degrees", fs.text(knot, [fs.rectangle_light(20)]),
              {0.005: (1.6, 2.5), 0.002: (2.2, 4.0)}),
        Frame("knot, rectangle of 5 degrees", fs.text(knot, [fs.rectangle_light(5)]),
              {0.003: (1.5, None), 0.002: (1.3, None)}),
        Frame("flat bunny, rectangle of 20 degrees", fs.text(flat, [fs.rectangle_light(20)]),
              {0.005: (1.6, 2.5), 0.002: (2.2, 4.0)}),
        Frame("bunny, sphere of 10 degrees", fs.text(smooth, [fs.sphere_light(10)]),
              {0.005: (1.6, 2.5), 0.002: (2.2, 4.0)}),
        Frame("close-up, sphere of 10 degrees",
              fs.text(smooth, [fs.sphere_light(10)], origin="2, 2.6, 4.8", target="-0.05, 0.9, 0", fov=17),
              {0.005: (None, None), 0.002: (None, None)}),
        Frame("three objects, three lights", fs.text(objects, lights, **WIDE_VIEW),
              {0.005: (1.5, 3.0), 0.002: (2.0, 4.0)}),
        Frame("three objects, sixteen lights", fs.text(objects, sixteen, **WIDE_VIEW), {0.005: (2.0, 6.0)},
              reference_spp=1024),
        Frame("crowd of 400, rectangle of 20 degrees",
              fs.text(crowd_shapes(context), [fs.rectangle_light(20, far)], **CROWD_VIEW), {0.01: (1.5, None)},
              reference_spp=1024),
    ]


def lights(context):
    """Whole frames under area lights, N camera samples of one light sample, to equal error."""
    return whole(context, light_frames(context))


# A panorama's radiance by the sine of elevation; the floor reflects about 1 under each.
def horizon_sky(up):
    """Twenty times as bright at the horizon as at the zenith, all of it even around."""
    return 0.16 + 3.0 * math.exp(-8.0 * abs(up))


def write_panorama(context, name, radiance):
    """Writes a panorama of 256 x 128 pixels as .hdr, which Mitsuba reads too; radiance(up) of the sine of elevation."""
    width, height = 256, 128
    rows = []
    for y in range(height):
        value = radiance(math.cos(math.pi * (y + 0.5) / height))
        mantissa, exponent = math.frexp(value)
        rows.append(bytes([int(mantissa * 256.0)] * 3 + [exponent + 128]) * width)
    path = context.programs.work / f"{name}-{text_hash(repr(rows))}.hdr"
    path.write_bytes(f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode() + b"".join(rows))
    return path.resolve()


def sky_frames(context):
    objects = [*three(context), fs.floor()]
    horizon = fs.mapped_sky(write_panorama(context, "horizon", horizon_sky))
    skies = {"constant sky": [fs.constant_sky()], "bright horizon": [horizon],
             "horizon and sun": [horizon, fs.sphere_light(0.6, share=4.0)]}
    walls = [fs.wall((0, 3, -2.2), (0, 0, 1)), fs.wall((-3.6, 3, 0), (1, 0, 0))]

    frames = [Frame(f"three objects, {name}", fs.text(objects, lights, **WIDE_VIEW),
                    {0.01: (8.0, 12.0), 0.005: (8.0, 12.0)}, ("path:2", "denoised:2"), 2048)
              for name, lights in skies.items()]
    corner = fs.text([*objects, *walls], [fs.constant_sky()], max_depth=3, **WIDE_VIEW)
    frames.append(Frame("corner, one bounce", corner,
                        {0.01: (5.0, None)}, ("path:3", "denoised:3"), 2048))
    frames.append(Frame("crowd of 400, constant sky",
                        fs.text(crowd_shapes(context), [fs.constant_sky()], **CROWD_VIEW), {0.05: (4.0, 15.0)},
                        ("path:2", "denoised:2"), 1024))
    return frames


def skies(context):
    """Whole frames under skies to equal error; Mitsuba's `path`, and the same with its denoiser."""
    return whole(context, sky_frames(context))
