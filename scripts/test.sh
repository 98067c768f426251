#!/bin/bash
# Lint and every test; fails if anything fails. test.sh [--fast] leaves out the second middleware.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
"$ROOT/scripts/setup.sh"
source_workspace
cd "$ROOT"
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
failed=()

# part NAME COMMAND...: run it, remember it when it fails
part() {
    printf '\n== %s\n' "$1"
    "${@:2}" || failed+=("$1")
}

part 'lint' ruff check .
part 'mathematics (no ROS)' env -u PYTHONPATH -u AMENT_PREFIX_PATH -u LD_LIBRARY_PATH \
    PYTHONPATH="$ROOT/src/style_core" python3 -m pytest -q -n auto -p no:cacheprovider src/style_core/test
# Tests against the clock over real middleware have a second try: another program may take the machine at the wrong
# moment. What needed it is listed as RERUN.
middlewares=(rmw_fastrtps_cpp rmw_cyclonedds_cpp)
[ "${1:-}" != --fast ] || middlewares=(rmw_fastrtps_cpp)
chosen=()
for middleware in "${middlewares[@]}"; do
    for folder in $(ls -d src/*/test test 2>/dev/null); do
        [ "$folder" = src/style_core/test ] ||
            part "$folder over $middleware" env RMW_IMPLEMENTATION="$middleware" \
                python3 -m pytest -q -rR --reruns 1 -p no:cacheprovider "${chosen[@]}" "$folder"
    done
    chosen=(-m 'not no_middleware')     # what sends nothing has been tested
done

[ ${#failed[@]} = 0 ] || { printf '\nFAILED:\n'; printf '  %s\n' "${failed[@]}"; exit 1; }
printf '\nAll passed.\n'
