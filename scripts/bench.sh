#!/bin/bash
# Speed of everything in benchmarks/speed, as ratios to peers in the same run: bench.sh [NAME...] (all without a name).
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
"$ROOT/scripts/setup.sh"
source_workspace
cd "$ROOT"
# peers that only the benches import; dtw-python is under the GPL
if ! python3 -c 'import dtaidistance, dtw' >/dev/null 2>&1; then
    say "Installing what only the benches compare with: dtaidistance (Apache-2.0), dtw-python (GPL-3.0-or-later)"
    for_user=()
    [ ! -e "$HUMBLE/setup.bash" ] || for_user=(--user)
    env -u PYTHONPATH python3 -m pip install --quiet --disable-pip-version-check "${for_user[@]}" --no-deps \
        --require-hashes -r requirements/bench.txt || say "Not installed: their rows are left out"
fi
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 ROS_LOCALHOST_ONLY=1 ROS_DOMAIN_ID="${ROS_DOMAIN_ID:-87}"
failed=()
for bench in benchmarks/speed/bench_*.py; do
    name="$(basename "${bench%.py}")"
    [ $# = 0 ] || [[ " $* " == *" ${name#bench_} "* ]] || continue
    say "== $bench"
    python3 "$bench" || failed+=("$bench")
done
[ ${#failed[@]} = 0 ] || die "Failed: ${failed[*]}"
