#!/usr/bin/env bash
# Makes what the scenes of glossy reflection in scenes/ take beside their files, in reflections/: meshes and instances.
#   tools/make_reflections.sh [PROGRAM]
# PROGRAM: fieldtrace (default: build/release/bin/fieldtrace).
set -euo pipefail
cd "$(dirname "$0")/.."

program=${1:-build/release/bin/fieldtrace}
if [[ ! -x $program ]]; then
  echo "make_reflections: $program is missing; build it (tools/build.sh) or name it" >&2
  exit 1
fi

mkdir -p reflections
"$program" mesh hyperboloid -o reflections/hyperboloid.ply
"$program" mesh supershape -o reflections/supershape.ply --m 6
"$program" mesh sphere -o reflections/sphere.ply --around 50 --along 31
tools/make_crowd.py --program "$program" -o reflections/crowd --instances 400 --mesh "knot --along 1562 --around 32"
