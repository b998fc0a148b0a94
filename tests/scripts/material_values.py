#!/usr/bin/env python3
"""Prints the values of Mitsuba 3's materials for tests/core/bsdf_reference_test.cpp.

Needs the Python package `mitsuba`. Each row: polar angle and azimuth of wi and of wo in degrees, value times cosine in
red, green, blue, and the density of sampling wo.
"""

import math

import mitsuba as mi

mi.set_variant("scalar_rgb")

COLOUR = '<rgb name="{}" value="0.2, 0.5, 0.7"/>'
MATERIALS = [
    '<bsdf type="plastic">' + COLOUR.format("diffuse_reflectance") + "</bsdf>",
    '<bsdf type="plastic"><boolean name="nonlinear" value="true"/><float name="int_ior" value="1.9"/>'
    + COLOUR.format("diffuse_reflectance") + '<rgb name="specular_reflectance" value="0.5"/></bsdf>',
    '<bsdf type="roughplastic"><string name="distribution" value="ggx"/><float name="alpha" value="0.3"/>'
    + COLOUR.format("diffuse_reflectance") + "</bsdf>",
    '<bsdf type="roughplastic"><float name="alpha" value="0.15"/><boolean name="nonlinear" value="true"/>'
    '<float name="int_ior" value="1.7"/>' + COLOUR.format("diffuse_reflectance") + "</bsdf>",
    '<bsdf type="roughdielectric"><string name="distribution" value="ggx"/><float name="alpha" value="0.4"/></bsdf>',
    '<bsdf type="roughdielectric"><float name="alpha" value="0.3"/><float name="int_ior" value="1.8"/>'
    + COLOUR.format("specular_transmittance") + "</bsdf>",
    '<bsdf type="roughdielectric"><string name="distribution" value="ggx"/><float name="alpha_u" value="0.2"/>'
    '<float name="alpha_v" value="0.5"/><float name="int_ior" value="1"/><float name="ext_ior" value="1.4"/></bsdf>',
    '<bsdf type="principled">' + COLOUR.format("base_color") + "</bsdf>",
    '<bsdf type="principled"><float name="roughness" value="0.3"/><float name="metallic" value="0.6"/>'
    '<float name="specular" value="0.8"/>' + COLOUR.format("base_color") + "</bsdf>",
    '<bsdf type="principled"><float name="clearcoat" value="0.9"/><float name="clearcoat_gloss" value="0.2"/>'
    '<float name="eta" value="1.6"/><float name="anisotropic" value="0.7"/>' + COLOUR.format("base_color") + "</bsdf>",
    '<bsdf type="mask"><float name="opacity" value="0.3"/><bsdf type="roughconductor"/></bsdf>',
]
ANGLES = [(20, 0, 30, 170), (60, 40, 50, 200), (75, 10, 80, 190), (40, 0, 40, 60),
          (30, 0, 150, 180), (50, 90, 130, 260), (150, 20, 160, 210), (140, 0, 30, 180), (160, 0, 20, 160)]


def direction(theta, phi):
    theta, phi = math.radians(theta), math.radians(phi)
    return mi.Vector3f(math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta))


for material in MATERIALS:
    bsdf = mi.load_string(material.replace("<bsdf", '<bsdf version="3.0.0"', 1))
    wrapped = material.replace("><", ">\n        <")
    print(f"    {{R\"({wrapped})\",\n     {{", end="")
    for theta_i, phi_i, theta_o, phi_o in ANGLES:
        point = mi.SurfaceInteraction3f()
        point.wi = direction(theta_i, phi_i)
        point.uv = [0.5, 0.5]
        wo = direction(theta_o, phi_o)
        value, density = bsdf.eval_pdf(mi.BSDFContext(), point, wo)
        if max(value) == 0:
            continue
        numbers = ", ".join(f"{x:.6g}f" for x in (*value, density))
        print(f"{{{theta_i}, {phi_i}, {theta_o}, {phi_o}, {numbers}}},\n      ", end="")
    print("}},")
