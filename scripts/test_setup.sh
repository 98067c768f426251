#!/bin/bash
# Machines and habits that differ from ours, simulated (scripts/situations): test_setup.sh [WORD...] plays those whose
# function's name holds a word; --whole adds a set-up that takes minutes. Runs on request, not in CI.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
need_python 3.12
cd "$ROOT"
exec env -u PYTHONPATH "$PYTHON" scripts/situations "$@"
