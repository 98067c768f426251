#!/bin/bash
# The main job, live: scripts/demo.py after all the set-up it needs (arguments are handed on).
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
"$ROOT/scripts/setup.sh"
source_workspace
cd "$ROOT"
# without arguments the second part follows: a robot walks with the person (scripts/demo_synth.py --help)
[ $# != 0 ] || set -- --robot
exec python3 scripts/demo.py "$@"
