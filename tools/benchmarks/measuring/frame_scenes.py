"""Scenes of the rows on whole frames at equal error, written as files that both Fieldtrace and Mitsuba read.

Lengths are in units of about one object's radius. Area lights stand 6 units from the origin, towards (2, 4, 2), and
make the open floor at the origin reflect FLOOR; a constant sky makes it reflect 1.
"""

import math

FLOOR = 0.25
REFLECTANCE = 0.5
TOWARDS_LIGHT = tuple(v / math.sqrt(24.0) for v in (2.0, 4.0, 2.0))
DISTANCE = 6.0
BUNNY = "/usr/share/glmark2/models/bunny.obj"


def vector(v):
    return ", ".join(f"{c:.9g}" for c in v)


def material(reflectance, attributes=""):
    return (f'<bsdf type="twosided"{attributes}><bsdf type="diffuse"><rgb name="reflectance" value="{reflectance}"/>'
            "</bsdf></bsdf>")


def mesh(path, transform="", reflectance="0.7, 0.6, 0.5", flat=False):
    normals = '<boolean name="face_normals" value="true"/>' if flat else ""
    return (f'<shape type="{str(path)[-3:]}"><string name="filename" value="{path}"/>{normals}'
            f'<transform name="to_world">{transform}</transform>{material(reflectance)}</shape>')


def translate(x, y, z):
    return f'<translate x="{x}" y="{y}" z="{z}"/>'


def rotate(axis, angle):
    return f'<rotate {axis}="1" angle="{angle}"/>'


def floor(half_width=12.0):
    return (f'<shape type="rectangle"><transform name="to_world">{rotate("x", -90)}<scale value="{half_width}"/>'
            f"</transform>{material(REFLECTANCE)}</shape>")


def wall(position, normal, half_width=6.0):
    target = tuple(p + n for p, n in zip(position, normal))
    return (f'<shape type="rectangle"><transform name="to_world"><scale value="{half_width}"/>'
            f'<lookat origin="{vector(position)}" target="{vector(target)}" up="0, 1, 0"/></transform>'
            f"{material(REFLECTANCE)}</shape>")


def radiance_for(area, position, cosine, share):
    """Radiance of a small light of `area` that gives the floor at the origin `share` x FLOOR."""
    distance = math.sqrt(sum(c * c for c in position))
    return share * FLOOR * math.pi / REFLECTANCE * distance**2 / (area * cosine * position[1] / distance)


def rectangle_light(degrees, position=None, share=1.0):
    """A square light that faces the origin; `degrees`: its width seen from there."""
    position = position or tuple(DISTANCE * c for c in TOWARDS_LIGHT)
    half = math.sqrt(sum(c * c for c in position)) * math.tan(math.radians(degrees / 2.0))
    radiance = radiance_for(4.0 * half * half, position, 1.0, share)
    return (f'<shape type="rectangle"><transform name="to_world"><scale value="{half:.9g}"/>'
            f'<lookat origin="{vector(position)}" target="0, 0, 0" up="0, 0, 1"/></transform>'
            f'<emitter type="area"><rgb name="radiance" value="{radiance:.9g}"/></emitter></shape>')


def sphere_light(degrees, position=None, share=1.0):
    position = position or tuple(DISTANCE * c for c in TOWARDS_LIGHT)
    radius = math.sqrt(sum(c * c for c in position)) * math.sin(math.radians(degrees / 2.0))
    radiance = radiance_for(math.pi * radius * radius, position, 1.0, share)
    return (f'<shape type="sphere"><point name="center" value="{vector(position)}"/>'
            f'<float name="radius" value="{radius:.9g}"/>'
            f'<emitter type="area"><rgb name="radiance" value="{radiance:.9g}"/></emitter></shape>')


def around(count, height=5.0):
    """Places of `count` lights in two rings."""
    places = []
    for i in range(count):
        angle, radius = 2.0 * math.pi * (i + 0.3) / count, 3.0 + 1.5 * (i % 2)
        places.append((radius * math.cos(angle), height, radius * math.sin(angle)))
    return places


def constant_sky():
    return f'<emitter type="constant"><rgb name="radiance" value="{1.0 / REFLECTANCE}"/></emitter>'


def mapped_sky(path, scale=1.0):
    return (f'<emitter type="envmap"><string name="filename" value="{path}"/>'
            f'<float name="scale" value="{scale}"/></emitter>')


def text(shapes, lights, **view):
    """The scene as a function of the resolution."""
    return lambda resolution: scene(shapes, lights, resolution, **view)


def scene(shapes, lights, resolution, origin="2.5, 3, 6", target="0, 0.5, 0", fov=40, max_depth=2, height=None):
    """The scene's text; `height` in pixels, that of `resolution` by default."""
    return f"""<scene version="3.0.0">
  <integrator type="path"><integer name="max_depth" value="{max_depth}"/></integrator>
  <sensor type="perspective">
    <float name="fov" value="{fov}"/>
    <transform name="to_world"><lookat origin="{origin}" target="{target}" up="0, 1, 0"/></transform>
    <sampler type="multijitter"><integer name="sample_count" value="16"/></sampler>
    <film type="hdrfilm">
      <integer name="width" value="{resolution}"/><integer name="height" value="{height or resolution}"/><rfilter type="box"/>
    </film>
  </sensor>
  {chr(10).join([*shapes, *lights])}
</scene>
"""
