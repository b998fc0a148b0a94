#!/usr/bin/env bash
# Makes the faults of tools/mutations.txt, one at a time, in a copy of this repository, and shows that the tests find
# each: first the test programs that the list names, and where these pass all other quick tests. Exits with 1 if a fault
# survives. Words given as arguments choose the faults whose line holds one of them.
#
# The copy, its build and the table of results (table.md) lie in build/mutations (or $MUTATIONS_DIR).
set -euo pipefail
cd "$(dirname "$0")/.."

list=tools/mutations.txt
folder=${MUTATIONS_DIR:-build/mutations}
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
tree=$folder/tree
build=$tree/build/release  # where ccache finds what any build of this preset has compiled
table=$folder/table.md
limit=300  # seconds for a test program; a fault that makes one hang is found by that

fail() {
  echo "mutate: $*" >&2
  exit 2
}

# What git knows and what is new, as it stands, with its times, so that a second run builds little.
mkdir -p "$tree"
find "$tree" -mindepth 1 -maxdepth 1 ! -name build -exec rm -rf {} +
git ls-files -z --cached --others --exclude-standard |
  while IFS= read -r -d '' file; do [[ ! -e $file ]] || printf '%s\0' "$file"; done |
  xargs -0 cp --parents --preserve=timestamps,links,mode -t "$tree"
# What was built last may hold a fault of the run before, which the old times would hide.
if [[ -e $folder/touched ]]; then
  while IFS= read -r file; do [[ ! -e $file ]] || touch "$file"; done <"$folder/touched"
fi

launcher=()
if command -v ccache >/dev/null; then launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache); fi
(cd "$tree" && cmake --preset release "${launcher[@]}") >"$folder/configure.log"

# Builds the targets named; quiet unless that fails.
make() { cmake --build "$build" --target "$@" >"$folder/build.log" 2>&1; }

has_program() { grep -q "^$1:" <<<"$targets"; }
targets=$(cmake --build "$build" --target help)

# Runs a test program; true if it passes. The cases that failed go to $folder/failed.
run_program() {
  local status=0
  (cd "$build" && timeout "$limit" "bin/$1" --gtest_brief=1) >"$folder/run.log" 2>&1 || status=$?
  sed -n -E 's/^\[  FAILED  \] ([^ ,]+\.[^ ,]+)(,.*)? \([0-9]+ ms\)$/\1/p' "$folder/run.log" | sort -u >"$folder/failed"
  if [[ $status -eq 124 ]]; then echo "$1 (not ended after $limit s)" >"$folder/failed"; fi
  if [[ $status -ne 0 && ! -s $folder/failed ]]; then echo "$1 (exit code $status)" >"$folder/failed"; fi
  [[ $status -eq 0 ]]
}

# At most three names, and how many more there are.
names_of_failed() {
  local count
  count=$(wc -l <"$folder/failed")
  head -n 3 "$folder/failed" | sed 's/.*/`&`/' | paste -sd, | sed 's/,/, /g' | tr -d '\n'
  if [[ $count -gt 3 ]]; then printf ' and %d more' $((count - 3)); fi
}

trim() { sed -E 's/^[[:space:]]+|[[:space:]]+$//g' <<<"$1"; }

# Replaces OLD in the file by NEW; OLD must be there exactly once.
replace_once() {
  OLD=$2 NEW=$3 python3 - "$1" <<'PYTHON'
import os, pathlib, sys
path = pathlib.Path(sys.argv[1])
text, old = path.read_text(), os.environ["OLD"]
if text.count(old) != 1:
    sys.exit(f"mutate: {path}: holds {text.count(old)} times, not once: {old}")
path.write_text(text.replace(old, os.environ["NEW"]))
PYTHON
}

# The source file of a name; where it was renamed, the only one that holds OLD.
file_of() {
  local found
  mapfile -t found < <(find "$tree" -path "$tree/build" -prune -o -name "$1" -type f -print)
  if [[ ${#found[@]} -eq 0 ]]; then
    mapfile -t found < <(cd "$tree" && grep -rlF --include='*.cpp' --include='*.h' --exclude-dir=build -e "$2" . || true)
    found=("${found[@]/#./$tree}")
  fi
  [[ ${#found[@]} -eq 1 ]] || fail "$list: there are ${#found[@]} files of the name $1 or with $2, not one"
  echo "${found[0]}"
}

chosen=()
while IFS= read -r line; do
  [[ -n $line && $line != \#* ]] || continue
  wanted=$([[ $# -eq 0 ]] && echo yes || echo no)
  for word in "$@"; do
    if [[ $line == *"$word"* ]]; then wanted=yes; fi
  done
  if [[ $wanted == yes ]]; then chosen+=("$line"); fi
done <"$list"
[[ ${#chosen[@]} -gt 0 ]] || fail "no line of $list holds any of: $*"

# Without a fault the programs that are named must pass. Those that no longer exist are left out, and told about.
declare -A good=()
for line in "${chosen[@]}"; do
  for program in ${line##*@@}; do good[$program]=1; done
done
for program in "${!good[@]}"; do
  if has_program "$program"; then continue; fi
  echo "mutate: $list: there is no test program $program" >&2
  unset "good[$program]"
done
echo "building ${#good[@]} test programs without a fault"
make "${!good[@]}" || fail "the build fails without any fault: see $folder/build.log"
for program in "${!good[@]}"; do
  run_program "$program" || fail "$program fails without any fault: see $folder/run.log"
done

printf '| file | fault | what it breaks | found by |\n|---|---|---|---|\n' >"$table"
survivors=0
number=0
for line in "${chosen[@]}"; do
  number=$((number + 1))
  name=$(trim "${line%%@@*}")
  rest=${line#*@@}
  change=${rest%%@@*}
  rest=${rest#*@@}
  what=$(trim "${rest%%@@*}")
  old=$(trim "${change%%=>*}")
  new=$(trim "${change#*=>}")
  file=$(file_of "$name" "$old")
  cp -p "$file" "$folder/original"
  echo "$file" >>"$folder/touched"
  replace_once "$file" "$old" "$new"
  echo "[$number/${#chosen[@]}] $name: $what"

  found=
  for program in ${rest##*@@}; do
    [[ -n ${good[$program]:-} ]] || continue
    if ! make "$program"; then
      cp -p "$folder/original" "$file"
      fail "$name does not compile with: $new; see $folder/build.log"
    fi
    if ! run_program "$program"; then
      found=$(names_of_failed)
      break
    fi
  done
  if [[ -z $found ]]; then
    echo "    the tests that were expected to fail pass; running the other quick tests"
    make all || fail "$name does not compile with: $new; see $folder/build.log"
    if ctest --test-dir "$build" -L quick -j "$(nproc)" >"$folder/run.log" 2>&1; then
      found='**nothing**'
      survivors=$((survivors + 1))
    else
      # CTest lists them after its summary.
      sed -n -E 's/^[[:space:]]*[0-9]+ - (.*) \((Failed|Timeout|SEGFAULT|Subprocess aborted)\).*$/\1/p' \
        "$folder/run.log" >"$folder/failed"
      found=$(names_of_failed)
    fi
  fi
  cp -p "$folder/original" "$file"
  touch "$file"
  echo "    found by $found"
  # Bars would end the cells of the table.
  printf '| %s | `%s` becomes `%s` | %s | %s |\n' "$name" "${old//|/\\|}" "${new//|/\\|}" "$what" "$found" >>"$table"
done

echo "$((${#chosen[@]} - survivors)) of ${#chosen[@]} faults were found: $table"
[[ $survivors -eq 0 ]]
