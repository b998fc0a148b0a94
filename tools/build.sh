#!/usr/bin/env bash
# Installs missing packages, configures the release preset and builds it: the first half of test.sh and demo.sh. Further
# arguments go to `cmake --build` (for example: --target fieldtrace).
set -euo pipefail
cd "$(dirname "$0")/.."

tools/install_packages.sh

launcher=()
if command -v ccache >/dev/null; then launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache); fi
cmake --preset release "${launcher[@]}"
cmake --build build/release "$@"
