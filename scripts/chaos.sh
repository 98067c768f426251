#!/bin/bash
# Attack a running mirror and count what goes wrong: chaos.sh [SECONDS [SEED]] (ten minutes, seed 1). Not part of CI.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
"$ROOT/scripts/setup.sh"
source_workspace
cd "$ROOT"
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
exec python3 benchmarks/chaos/chaos.py --seconds "${1:-600}" --seed "${2:-1}"
