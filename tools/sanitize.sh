#!/usr/bin/env bash
# Builds with run-time checks and runs the quick tests: first addresses, leaks and undefined behaviour in everything but
# the vector kernels, then undefined behaviour in these, compiled for AVX2 alone.
#   tools/sanitize.sh [asan-ubsan|ubsan-avx2]   one of the two presets (default: both)
# Takes the better part of an hour on two cores; docs/testing.md keeps the last result.
set -euo pipefail
cd "$(dirname "$0")/.."

presets=(asan-ubsan ubsan-avx2)
if [[ $# -gt 1 || ( $# -eq 1 && " ${presets[*]} " != *" $1 "* ) ]]; then
  sed -n '2,5s/^# //p' "$0"
  exit 2
fi
if [[ $# -eq 1 ]]; then presets=("$1"); fi

tools/install_packages.sh
launcher=()
if command -v ccache >/dev/null; then launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache); fi
status=0
for preset in "${presets[@]}"; do
  if [[ $preset == ubsan-avx2 ]] && ! grep -qw avx2 /proc/cpuinfo; then
    echo "sanitize: $preset left out: this processor has no AVX2" >&2
    continue
  fi
  cmake --preset "$preset" "${launcher[@]}"
  cmake --build "build/$preset"
  ctest --test-dir "build/$preset" -L quick --output-on-failure --parallel "$(nproc)" || status=$?
done
exit "$status"
