#!/usr/bin/env bash
# Submits a shot to SLURM: one job that decides for the shot, then an array of chunks of frames that depends on it.
# A task that failed where another try may help is requeued by itself (render.sbatch); what is there already is skipped.
set -euo pipefail

usage() {
    cat <<'TEXT'
usage: bash submit.sh --input 'shots/shot.####.exr' --output 'out/shot.####.exr' --frames 1-100 [OPTION VALUE]...

  --input TEXT          frames, '####' for the number; several files a frame with spaces between them, names with spaces in quotes
  --output FILE         pictures, '####' for the number
  --frames LIST         frames: 1-10,20-30, 1-100x2, 1-100y3, 1-100:3
  --flags TEXT          flags of 'plan' and 'render', such as '--preset portrait --focus 6'; nothing in it is expanded
  --render-flags TEXT   flags of 'render' alone, such as '--codec zips'
  --chunk N             frames of a task                                    [20]
  --threads N           cores of a task                                     [2]
  --memory-mib N        memory of a task, in MiB; 256 MiB more are reserved [what the partition gives]
  --at-once N           most tasks at the same time                         [no limit]
  --retries N           how often a task is tried again                     [2]
  --thinlens PROGRAM    the program on the nodes, by name or path           [thinlens]
  --logs DIR            folder of the logs                                  [thinlens-logs]
  --sbatch TEXT         options of sbatch, such as '--partition=comp --time=1:00:00'

Paths are seen from this folder on every node. Prints the numbers of the two jobs.
TEXT
}

# $2: what was wrong, $1: the exit code.
fail() {
    echo "error: $2" >&2
    exit "$1"
}

# Number $1 without leading zeros, with which it would be octal.
decimal() {
    local digits=${1#-}
    echo "${1%"$digits"}$((10#$digits))"
}

# The frames of list $1, one a line, each once, in the order of the list.
frames() {
    local part parts
    IFS=, read -ra parts <<<"$1"
    for part in "${parts[@]}"; do
        [[ $part =~ ^(-?[0-9]+)(-(-?[0-9]+)(([xy:])([0-9]+))?)?$ ]] || fail 2 "--frames: '$part' is not A, A-B, A-BxN, A-ByN or A-B:N"
        local first last kind=${BASH_REMATCH[5]} step=$((10#${BASH_REMATCH[6]:-1}))
        first=$(decimal "${BASH_REMATCH[1]}") last=$(decimal "${BASH_REMATCH[3]:-${BASH_REMATCH[1]}}")
        ((step > 0)) || fail 2 "--frames: '$part' has no frames"
        local sign=$((first > last ? -1 : 1))
        case $kind in
        '' | x) seq "$first" $((sign * step)) "$last" ;;
        y) seq "$first" "$sign" "$last" | awk -v step="$step" '(NR - 1) % step' ;;
        :) for (( ; step > 0; step--)); do seq "$first" $((sign * step)) "$last"; done ;;
        esac
    done | awk '!seen[$0 + 0]++'
}

# The frames of standard input as chunks of $1: one chunk a word, such as 1-20.
chunks() {
    awk -v size="$1" '
        function run() { return first == last ? first "" : first "-" last }
        { frame = $0 + 0 }
        (NR - 1) % size == 0 { if (NR > 1) printf "%s%s ", text, run(); text = ""; first = last = frame; next }
        frame == last + 1 { last = frame; next }
        { text = text run() ","; first = last = frame }
        END { if (NR) printf "%s%s", text, run() }'
}

export THINLENS_INPUT='' THINLENS_OUTPUT='' THINLENS_FRAMES='' THINLENS_FLAGS='' THINLENS_RENDER_FLAGS='' THINLENS_CHUNKS=''
export THINLENS_THREADS=2 THINLENS_MEMORY_MIB='' THINLENS_RETRIES=2 THINLENS_PROGRAM=thinlens
chunk=20 at_once='' logs=thinlens-logs sbatch_text=''
while (($# > 0)); do
    [[ $1 != --help && $1 != -h ]] || { usage; exit 0; }
    (($# > 1)) || fail 2 "$1 has no value"
    case $1 in
    --input) THINLENS_INPUT=$2 ;;
    --output) THINLENS_OUTPUT=$2 ;;
    --frames) THINLENS_FRAMES=$2 ;;
    --flags) THINLENS_FLAGS=$2 ;;
    --render-flags) THINLENS_RENDER_FLAGS=$2 ;;
    --chunk) chunk=$2 ;;
    --threads) THINLENS_THREADS=$2 ;;
    --memory-mib) THINLENS_MEMORY_MIB=$2 ;;
    --at-once) at_once=$2 ;;
    --retries) THINLENS_RETRIES=$2 ;;
    --thinlens) THINLENS_PROGRAM=$2 ;;
    --logs) logs=$2 ;;
    --sbatch) sbatch_text=$2 ;;
    *) fail 2 "unknown option $1; --help lists them" ;;
    esac
    shift 2
done
[[ -n $THINLENS_INPUT && -n $THINLENS_OUTPUT && -n $THINLENS_FRAMES ]] || { usage >&2; exit 2; }
for number in "$chunk" "$THINLENS_THREADS" "${THINLENS_MEMORY_MIB:-1}" "${at_once:-1}"; do
    [[ $number =~ ^[1-9][0-9]*$ ]] || fail 2 "'$number' is not a number above 0"
done
[[ $THINLENS_RETRIES =~ ^[0-9]+$ ]] || fail 2 "--retries: '$THINLENS_RETRIES' is not a number"

numbers=$(frames "$THINLENS_FRAMES") || exit 2
THINLENS_CHUNKS=$(chunks "$chunk" <<<"$numbers")
tasks=$(wc -w <<<"$THINLENS_CHUNKS")
most=$(scontrol show config | awk '$1 == "MaxArraySize" { print $3 }')
((tasks < ${most:-1001})) || fail 2 "$tasks tasks are more than this SLURM takes in one array ($((most - 1))): give a larger --chunk"
# The kernel passes at most 128 KiB in one variable.
((${#THINLENS_CHUNKS} < 130000)) || fail 2 "the list of chunks is too long: give a larger --chunk, or frames in sequence"

mkdir -p "$logs" "$(dirname "$THINLENS_OUTPUT")"
options=(--parsable --export=ALL --cpus-per-task="$THINLENS_THREADS")
[[ -z $THINLENS_MEMORY_MIB ]] || options+=(--mem="$((THINLENS_MEMORY_MIB + 256))M")
if [[ -n $sbatch_text ]]; then
    text=$(xargs printf '%s\n' <<<"$sbatch_text") || fail 2 "--sbatch: a quote is not closed"
    mapfile -t -O "${#options[@]}" options <<<"$text"
fi
script=$(dirname "$0")/render.sbatch
name=$(basename "$THINLENS_OUTPUT")
decide=$(THINLENS_STEP=plan sbatch "${options[@]}" --job-name="decide $name" --output="$logs/%j.log" "$script")
decide=${decide%%;*}
# Where the decision failed, the chunks cannot begin: they are cancelled.
array=$(THINLENS_STEP=render sbatch "${options[@]}" --job-name="render $name" --output="$logs/%A_%a.log" \
    --dependency="afterok:$decide" --kill-on-invalid-dep=yes --array="0-$((tasks - 1))${at_once:+%$at_once}" "$script")
echo "$decide ${array%%;*}"
