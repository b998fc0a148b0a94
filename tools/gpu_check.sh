#!/usr/bin/env bash
# One command for a machine with an NVIDIA GPU: builds, runs the tests without a GPU, then puts a few million random and
# extreme questions to the GPU, whose answers must be the CPU's, bit for bit; runs compute-sanitizer over it; renders
# whole frames on both machines, which must be equal, and times them; and times look-ups, coherent and random, on fields
# of three sizes. Writes docs/benchmarks/gpu-DATE-COMMIT.json.
#
#   tools/gpu_check.sh [--built COMMIT]
#
# --built: build/release is of COMMIT, and was built and tested elsewhere: for machines that reach no packages. Exit
# codes: 0 all answers are equal; 77 there is no GPU; else what failed.
set -euo pipefail
cd "$(dirname "$0")/.."

commit=
if [[ $# -eq 2 && $1 == --built ]]; then
  commit=$2
elif [[ $# -ne 0 ]]; then
  echo "usage: tools/gpu_check.sh [--built COMMIT]" >&2
  exit 2
fi
if [[ -z $commit ]]; then tools/build.sh; fi
bin=build/release/bin
if [[ ! -x $bin/gpu_check ]]; then
  echo "gpu_check: the tests were not built" >&2
  exit 1
fi
"$bin/fieldtrace" info --devices
tested=elsewhere
if [[ -z $commit ]]; then
  tested=here
  ctest --test-dir build/release -L gpu --output-on-failure --parallel "$(nproc)"
  commit=$(git rev-parse HEAD)
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
status=0
"$bin/gpu_check" --json "$work/look_ups.json" || status=$?
if [[ $status -ne 0 ]]; then exit "$status"; fi

sanitizer=none
if command -v compute-sanitizer >/dev/null; then
  compute-sanitizer --tool memcheck --error-exitcode 3 "$bin/gpu_check" --quick >"$work/memcheck.log" || {
    tail -50 "$work/memcheck.log" >&2
    exit 3
  }
  sanitizer="memcheck found nothing"
else
  echo "gpu_check: compute-sanitizer is not in the PATH: left out" >&2
fi

python3 tools/benchmarks/gpu_frames.py --device cuda --program "$bin/fieldtrace" --work "$work" --output "$work/frames.json"

out=docs/benchmarks/gpu-$(date +%Y-%m-%d)-${commit:0:7}.json
python3 - "$work" "$out" "$sanitizer" "$commit" "$tested" <<'EOF'
import datetime
import json
import os
import pathlib
import platform
import subprocess
import sys

work, out = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
sanitizer, commit, tested = sys.argv[3:]


def output(*command):
    try:
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None


report = {"date": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
          "commit": commit, "built_and_tested_by_cpu": tested,
          "uncommitted": None if tested == "elsewhere" else bool(output("git", "status", "--porcelain")),
          "compiler": (output("nvcc", "--version") or "").split("\n")[-1],
          "machine": platform.platform(), "cpus": os.cpu_count(),
          "gpu": output("nvidia-smi", "--query-gpu=name,driver_version,clocks.max.sm", "--format=csv,noheader"),
          "compute_sanitizer": sanitizer, **json.loads((work / "look_ups.json").read_text()),
          "frames": json.loads((work / "frames.json").read_text())}
out.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
print(f"written: {out}")
EOF
