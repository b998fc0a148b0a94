#!/usr/bin/env bash
# Makes the meshes and instances that the glossy reflection scenes in scenes/ need.
#   tools/make_reflections.sh [PROGRAM [FOLDER]]
# PROGRAM: fieldtrace (default: build/release/bin/fieldtrace). FOLDER: the output folder (default: reflections/, where
# the scenes look for them).
set -euo pipefail
program=$(realpath -m "${1:-$(dirname "$0")/../build/release/bin/fieldtrace}")
folder=$(realpath -m "${2:-$(dirname "$0")/../reflections}")
cd "$(dirname "$0")/.."

if [[ ! -x $program ]]; then
  echo "make_reflections: $program is missing; build it (tools/build.sh) or name it" >&2
  exit 1
fi

mkdir -p "$folder"
"$program" mesh hyperboloid -o "$folder/hyperboloid.ply"
"$program" mesh supershape -o "$folder/supershape.ply" --m 6
"$program" mesh sphere -o "$folder/sphere.ply" --around 50 --along 31
tools/make_crowd.py --program "$program" -o "$folder/crowd" --instances 400 --mesh "knot --along 1562 --around 32"
