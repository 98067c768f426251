#!/bin/bash
# Speed of everything in benchmarks/speed, as ratios to peers in the same run: bench.sh [NAME...] (all without a name).
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
"$ROOT/scripts/setup.sh"
source_workspace
cd "$ROOT"
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 ROS_LOCALHOST_ONLY=1 ROS_DOMAIN_ID="${ROS_DOMAIN_ID:-87}"
failed=()
for bench in benchmarks/speed/bench_*.py; do
    name="$(basename "${bench%.py}")"
    [ $# = 0 ] || [[ " $* " == *" ${name#bench_} "* ]] || continue
    say "== $bench"
    python3 "$bench" || failed+=("$bench")
done
[ ${#failed[@]} = 0 ] || die "Failed: ${failed[*]}"
