#!/usr/bin/env python3
"""Writes sky.exr, the environment map of sky.xml: a clear sky with a hazy sun over dark ground.

The format is that of Mitsuba's envmap: row 0 is the zenith (+y), the last row the nadir, column 0 lies beside -z and the
columns go on towards +x. Needs no packages. Usage: make_sky.py [sky.exr]
"""

import math
import pathlib
import struct
import sys

WIDTH, HEIGHT = 96, 48
SUN_ELEVATION, SUN_AZIMUTH = math.radians(35), math.radians(130)  # azimuth from -z towards +x
SUN_WIDTH = math.radians(6)  # standard deviation
SUN = (60.0, 50.0, 36.0)
ZENITH, HORIZON, GROUND = (0.15, 0.3, 0.7), (0.8, 0.8, 0.75), (0.12, 0.1, 0.08)


def direction(x, y):
    phi, theta = 2 * math.pi * (x + 0.5) / WIDTH, math.pi * y / (HEIGHT - 1)
    return math.sin(phi) * math.sin(theta), math.cos(theta), -math.cos(phi) * math.sin(theta)


def radiance(x, y):
    d = direction(x, y)
    if d[1] < 0:
        return GROUND
    height = math.sqrt(d[1])
    cosine = math.cos(SUN_ELEVATION)
    sun = math.sin(SUN_AZIMUTH) * cosine, math.sin(SUN_ELEVATION), -math.cos(SUN_AZIMUTH) * cosine
    angle = math.acos(max(-1.0, min(1.0, sum(a * b for a, b in zip(d, sun)))))
    glow = math.exp(-0.5 * (angle / SUN_WIDTH) ** 2)
    return tuple(h + (z - h) * height + s * glow for z, h, s in zip(ZENITH, HORIZON, SUN))


def attribute(name, kind, value):
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value


def exr(pixels):
    """An uncompressed OpenEXR file of half floats ("OpenEXR File Layout": channels by name, one block a scan line)."""
    channel = struct.pack("<iiii", 1, 0, 1, 1)
    window = struct.pack("<iiii", 0, 0, WIDTH - 1, HEIGHT - 1)
    header = b"\x76\x2f\x31\x01" + struct.pack("<i", 2)
    header += attribute("channels", "chlist", b"".join(c + b"\0" + channel for c in (b"B", b"G", b"R")) + b"\0")
    header += attribute("compression", "compression", b"\0")
    header += attribute("dataWindow", "box2i", window) + attribute("displayWindow", "box2i", window)
    header += attribute("lineOrder", "lineOrder", b"\0")
    header += attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    header += attribute("screenWindowCenter", "v2f", struct.pack("<ff", 0, 0))
    header += attribute("screenWindowWidth", "float", struct.pack("<f", 1)) + b"\0"
    lines = []
    for y, row in enumerate(pixels):
        data = b"".join(struct.pack(f"<{WIDTH}e", *(p[c] for p in row)) for c in (2, 1, 0))
        lines.append(struct.pack("<ii", y, len(data)) + data)
    start, offsets = len(header) + 8 * HEIGHT, []
    for line in lines:
        offsets.append(start)
        start += len(line)
    return header + struct.pack(f"<{HEIGHT}Q", *offsets) + b"".join(lines)


def main():
    path = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else pathlib.Path(__file__).with_name("sky.exr")
    path.write_bytes(exr([[radiance(x, y) for x in range(WIDTH)] for y in range(HEIGHT)]))


if __name__ == "__main__":
    main()
