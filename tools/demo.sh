#!/usr/bin/env bash
# Sets everything up, builds, and renders one scene by both methods under two area lights, and under a sky: images in
# demo/ and demo/sky/, and tables. Behind the first build, the reference images take most of the time; they are kept in
# demo/ and reused. After a change of the renderer, delete demo/ to render it again. Further arguments go to
# fieldtrace_demo (for example: -D width=960 -D height=540).
set -euo pipefail
cd "$(dirname "$0")/.."

tools/build.sh --target fieldtrace fieldtrace_demo

bunny=${FIELDTRACE_BUNNY:-/usr/share/glmark2/models/bunny.obj}
if [[ ! -r $bunny ]]; then
  echo "demo: $bunny is missing; install glmark2-data or set FIELDTRACE_BUNNY to the Stanford bunny as .obj" >&2
  exit 1
fi

bin=build/release/bin
mkdir -p demo
"$bin/fieldtrace" mesh supershape -o demo/shape1.ply \
  --m 7 --n1 0.6 --n2 1.2 --n3 1.2 --m-lat 3 --n1-lat 1.2 --n2-lat 1.6 --n3-lat 1.6
"$bin/fieldtrace" mesh supershape -o demo/shape2.ply \
  --m 5 --n1 0.4 --n2 1.7 --n3 1.7 --m-lat 4 --n1-lat 10 --n2-lat 10 --n3-lat 10

arguments=(-D bunny="$bunny" -D shape1="$PWD/demo/shape1.ply" -D shape2="$PWD/demo/shape2.ply" "$@")
echo "Two area lights"
"$bin/fieldtrace_demo" scenes/demo.xml -o demo "${arguments[@]}"
echo
echo "A sky"
"$bin/fieldtrace_demo" scenes/demo.xml -o demo/sky --reference-spp 2048 -D lights=demo_sky.xml "${arguments[@]}"

echo
echo "pictures, references and tables: demo/ and demo/sky/; the program: $bin/fieldtrace"
