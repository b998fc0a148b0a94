#!/usr/bin/env bash
# Runs clang-tidy, with the checks of .clang-tidy, over the C++ files that differ from a commit; fails on any finding.
#   tools/tidy.sh [BASE]   files that differ from BASE (default: HEAD~1), committed or not
#   tools/tidy.sh --all    every file
# A header is checked through a source file that includes it. Nothing is compiled; build/tidy holds the commands.
set -euo pipefail
cd "$(dirname "$0")/.."

if [[ $# -gt 1 || ${1:-} == -h || ${1:-} == --help ]]; then
  sed -n '2,5s/^# //p' "$0"
  exit 2
fi
base=${1:-HEAD~1}
for tool in clang-tidy cmake ninja; do
  command -v "$tool" >/dev/null || { echo "tidy: $tool is missing; run tools/install_packages.sh" >&2; exit 1; }
done

# Prints a source file through which the compiler reads the header $1; nothing if there is none.
source_of() {
  local file users seen=" " queue=("$1")
  if [[ -f ${1%%.*}.cpp ]]; then echo "${1%%.*}.cpp"; return; fi
  while [[ ${#queue[@]} -gt 0 ]]; do
    file=${queue[0]}
    queue=("${queue[@]:1}")
    # Headers are included by their path from the root, those of the tests by their name.
    users=$(git grep -lE "#include \"($file|$(basename "$file"))\"" -- '*.cpp' '*.h' || true)
    for user in $users; do
      if [[ $user == *.cpp ]]; then echo "$user"; return; fi
      if [[ $seen != *" $user "* ]]; then
        seen+="$user "
        queue+=("$user")
      fi
    done
  done
}

if [[ $base == --all ]]; then
  changed=$(git ls-files '*.cpp' '*.h')
else
  if ! git rev-parse --verify --quiet "$base^{commit}" >/dev/null; then
    echo "tidy: there is no commit $base; name one, or give --all" >&2
    exit 2
  fi
  changed=$({ git diff --name-only --diff-filter=d "$base" -- '*.cpp' '*.h'
              git ls-files --others --exclude-standard -- '*.cpp' '*.h'; } | sort -u)
fi
sources=$(for file in $changed; do
  if [[ $file == *.cpp ]]; then echo "$file"; else source_of "$file"; fi
done | sort -u)
if [[ -z $sources ]]; then
  echo "tidy: no C++ file differs from $base"
  exit 0
fi

cmake --preset release -B build/tidy -DCMAKE_EXPORT_COMPILE_COMMANDS=ON \
  -DFIELDTRACE_BENCHMARKS=ON -DFIELDTRACE_CUDA=OFF >/dev/null
# Files of parts that are not configured (CUDA) have no command.
sources=$(for file in $sources; do
  if grep -qF "\"$PWD/$file\"" build/tidy/compile_commands.json; then echo "$file"
  else echo "tidy: $file is not part of this build, and is left out" >&2; fi
done)
if [[ -z $sources ]]; then exit 0; fi
echo "tidy: $(wc -w <<<"$sources") files"
log=build/tidy/tidy.log
status=0
xargs -P "$(nproc)" -n 1 clang-tidy -p build/tidy --quiet <<<"$sources" >"$log" 2>build/tidy/errors.log || status=$?
grep -E "(warning|error):" "$log" | sort -u || true
if [[ $status -ne 0 ]]; then
  grep -E "error" build/tidy/errors.log || true
  echo "tidy: findings; all of them with their code: $log" >&2
  exit 1
fi
echo "tidy: nothing found"
