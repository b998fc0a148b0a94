#!/usr/bin/env bash
# Renders the reference pictures of tests/references anew and shows how they differ from the kept ones: figures here,
# pictures in build/release/image_tests/update. `--write` then replaces the kept ones; further words name scenes.
set -euo pipefail
cd "$(dirname "$0")/.."

tools/build.sh --target update_references
build/release/bin/update_references -o build/release/image_tests/update "$@"
