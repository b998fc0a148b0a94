#!/usr/bin/env bash
# Renders one picture by a Slurm cluster: a job array of N slices, and a job that joins them once all are there.
#
#   tools/farm/slurm.sh SCENE N -o OUT.exr [-o OUT.png] [options of render] [-- options of sbatch for the slices]
#
# Parts, logs and statistics of the slices (K.exr, K.log, K.json) go to the folder OUT.exr.parts, which stays. The same
# command again renders only the slices that are not there whole. --float32 and --exposure are given to the merge.
# Slices take as many threads as Slurm gives them CPUs, unless --threads says otherwise. The scene, the folder and the
# program must have the same paths on all nodes. FIELDTRACE names the program; by default it is this repository's
# build/release/bin/fieldtrace, or else the one in PATH. Exit codes: 0: submitted; 1: bad input; 2: wrong use.
set -euo pipefail

fail() {
  echo "slurm.sh: $2" >&2
  exit "$1"
}

usage() {
  sed -n '2,10s/^# \{0,1\}//p' "$0" >&2
  exit 2
}

[[ $# -ge 2 && $1 != -* ]] || usage
scene=$1 count=$2
shift 2
[[ $count =~ ^[1-9][0-9]{0,8}$ ]] || fail 2 "'$count' is no number of slices; write tools/farm/slurm.sh SCENE N with N from 1"

outputs=() of_render=() of_merge=() of_sbatch=() threads=
value() { [[ $# -ge 2 ]] || fail 2 "$1 needs a value"; }
while [[ $# -gt 0 ]]; do
  case $1 in
    --) shift; of_sbatch=("$@"); break ;;
    -o) value "$@"; outputs+=("$2"); shift ;;
    --exposure) value "$@"; of_merge+=("$1" "$2"); shift ;;
    --float32 | --exposure=*) of_merge+=("$1") ;;
    --threads | --threads=*) threads=' '; of_render+=("$1") ;;
    --slice | --slice=* | --skip-done) fail 2 "$1 is set by this script; leave it away" ;;
    --stats | --stats=*) fail 2 "the statistics of slice K are OUT.parts/K.json; leave $1 away" ;;
    *) of_render+=("$1") ;;
  esac
  shift
done
[[ ${#outputs[@]} -gt 0 ]] || fail 2 "say what to write: -o OUT.exr"
arguments=()
for output in "${outputs[@]}"; do arguments+=(-o "$output"); done

command -v sbatch >/dev/null ||
  fail 1 "there is no sbatch; run this where Slurm's commands are, or render the slices by hand (docs/farm.md)"
program=${FIELDTRACE:-}
if [[ -z $program ]]; then
  program=$(dirname "$(realpath "$0")")/../../build/release/bin/fieldtrace
  [[ -x $program ]] || program=fieldtrace
fi
program=$(command -v "$program") || fail 1 "the program was not found; build it (tools/build.sh), or name it: FIELDTRACE=PATH"
program=$(realpath "$program")
[[ -f $scene ]] || fail 1 "$scene: no such file; check the name"
here=$(pwd -P)
parts=${outputs[0]}.parts
[[ $parts == /* ]] || parts=$here/$parts

# Wrong options are better told here than in N logs: the program looks at them before anything else, and then refuses
# to write below a file.
status=0
complaint=$("$program" render "$scene" "${of_render[@]}" --slice "1/$count" -o "$program/none.exr" 2>&1) || status=$?
[[ $status -ne 2 ]] || fail 2 "$complaint"
# The merge's: a part that is not there comes last.
status=0
complaint=$("$program" merge "$program/none.exr" "${arguments[@]}" "${of_merge[@]}" 2>&1) || status=$?
[[ $complaint == *"$program/none.exr"* ]] || fail "$status" "$complaint"
mkdir -p "$parts" || fail 1 "$parts: the folder cannot be made"

# As the shell of a job reads it: one word, or all.
word() { printf '%q' "$1"; }
words() { printf '%q ' "$@"; }
# Slurm replaces % and what follows in names of files.
log() { printf '%s' "${parts//%/%%}/$1.log"; }
# shellcheck disable=SC2016  # of the job, not of this shell
[[ -n $threads ]] || threads='--threads "$SLURM_CPUS_ON_NODE"'

slices=$(sbatch --parsable --requeue --job-name="slices of $(basename "$scene")" --array="1-$count" \
  --open-mode=append --output="$(log %a)" --ntasks=1 "${of_sbatch[@]}" <<SCRIPT
#!/usr/bin/env bash
cd $(word "$here") || exit 1
k=\$SLURM_ARRAY_TASK_ID
exec $(words "$program" render "$scene" "${of_render[@]}") $threads \\
  --slice "\$k/$count" --skip-done -o $(word "$parts")/"\$k.exr" --stats $(word "$parts")/"\$k.json"
SCRIPT
) || { rmdir "$parts" 2>/dev/null || true; fail 1 "sbatch refused the slices; its message says why"; }
slices=${slices%%;*}

merge=$(sbatch --parsable --requeue --job-name="merge of $(basename "$scene")" --dependency="afterok:$slices" \
  --kill-on-invalid-dep=yes --open-mode=append --output="$(log merge)" --ntasks=1 <<SCRIPT
#!/usr/bin/env bash
cd $(word "$here") || exit 1
parts=()
for ((k = 1; k <= $count; ++k)); do parts+=($(word "$parts")/"\$k.exr"); done
exec $(words "$program" merge) "\${parts[@]}" $(words "${arguments[@]}" "${of_merge[@]}")
SCRIPT
) || fail 1 "sbatch refused the merge of job $slices; its message says why"
echo "slices: job $slices (1 to $count); merge: job ${merge%%;*}; logs: $parts"
