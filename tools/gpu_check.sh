#!/usr/bin/env bash
# One command for a machine with an NVIDIA GPU and CUDA's compiler: builds, runs the tests without a GPU, then puts a
# few million random and extreme questions to the GPU, whose answers must be the CPU's, bit for bit; runs
# compute-sanitizer over it, compares pictures, and times look-ups, coherent and random, on fields of three sizes.
# Writes docs/benchmarks/gpu-DATE-COMMIT.json. Exit codes: 0 all answers are equal; 77 there is no GPU; else what failed.
set -euo pipefail
cd "$(dirname "$0")/.."

tools/build.sh
bin=build/release/bin
if [[ ! -x $bin/gpu_check ]]; then
  echo "gpu_check: the tests were not built" >&2
  exit 1
fi
"$bin/fieldtrace" info --devices
ctest --test-dir build/release -L gpu --output-on-failure --parallel "$(nproc)"

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

# Area lights, a sky, and glossy rays by radiance maps.
pictures=("bunny_two_lights --spp 4" "sky --spp 16" "glossy_floor --light-samples 4 --lobe-samples 256")
for picture in "${pictures[@]}"; do
  read -r scene options <<<"$picture"
  for device in cpu cuda; do
    # shellcheck disable=SC2086  # options are words
    "$bin/fieldtrace" render "scenes/$scene.xml" -o "$work/$scene.$device.exr" $options --device "$device" \
      --stats "$work/$scene.$device.json"
  done
  "$bin/fieldtrace" compare "$work/$scene.cpu.exr" "$work/$scene.cuda.exr" --fail-above 0
done

out=docs/benchmarks/gpu-$(date +%Y-%m-%d)-$(git rev-parse --short HEAD).json
python3 - "$work" "$out" "$sanitizer" "${pictures[@]%% *}" <<'EOF'
import datetime
import json
import pathlib
import platform
import subprocess
import sys

work, out, sanitizer = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]), sys.argv[3]


def output(*command):
    try:
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None


report = {"date": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
          "commit": output("git", "rev-parse", "HEAD"), "uncommitted": bool(output("git", "status", "--porcelain")),
          "machine": platform.platform(), "gpu": output("nvidia-smi", "--query-gpu=name,driver_version,clocks.max.sm",
                                                        "--format=csv,noheader"),
          "compiler": (output("nvcc", "--version") or "").split("\n")[-1], "compute_sanitizer": sanitizer,
          **json.loads((work / "look_ups.json").read_text()),
          "pictures": {s: {d: json.loads((work / f"{s}.{d}.json").read_text()) for d in ("cpu", "cuda")}
                       for s in sys.argv[4:]}}
for scene, by in report["pictures"].items():
    device = by["cuda"]["device"]
    if device["name"] != "cuda" or device["blocks"] == 0:
        sys.exit(f"gpu_check: {scene} was answered by {device['name']}")
out.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
print(f"written: {out}")
EOF
