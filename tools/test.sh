#!/usr/bin/env bash
# Sets everything up, builds and runs the tests. Further arguments go to ctest (for example: -L quick).
# The last lines count and name the tests that were skipped.
set -euo pipefail
cd "$(dirname "$0")/.."

tools/build.sh

log=build/release/ctest.log
status=0
ctest --test-dir build/release --output-on-failure --parallel "$(nproc)" "$@" 2>&1 | tee "$log" || status=$?

# ctest lists them after the summary as "<number> - <name> (Skipped)" or "(Disabled)" or "(Not Run)".
skipped=$(sed -n -E 's/^[[:space:]]*[0-9]+ - (.*) \((Skipped|Disabled|Not Run)\).*$/\1/p' "$log" | sort -u)
if [[ -z $skipped ]]; then
  echo "skipped tests: 0"
else
  echo "skipped tests: $(wc -l <<<"$skipped")"
  while read -r name; do echo "  $name"; done <<<"$skipped"
fi
exit "$status"
