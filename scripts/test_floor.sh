#!/bin/bash
# The ROS-free tests on the oldest versions the suite supports: Python 3.10, NumPy 1.21, SciPy 1.8.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
unset PYTHONPATH LD_LIBRARY_PATH AMENT_PREFIX_PATH
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
cd "$ROOT"
locks=(requirements/pip.txt requirements/floor_python310.txt)
venv="$ROOT/.venv-python310"
need_python 3.10 static-is-fine
command -v gcc >/dev/null || apt_install gcc libc6-dev

stamp="$(cat "${locks[@]}" | sha256sum) $PYTHON"
if [ "$(cat "$venv/complete" 2>/dev/null)" != "$stamp" ]; then
    say "Making a Python 3.10 environment in $venv"
    rm -rf "$venv"
    "$PYTHON" -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check --retries 10 --require-hashes -r "${locks[0]}"
    "$venv/bin/pip" install --quiet --retries 10 --resume-retries 20 --no-build-isolation --require-hashes -r "${locks[1]}"
    printf '%s' "$stamp" > "$venv/complete"
fi
"$venv/bin/pip" install --quiet --no-build-isolation --no-deps --force-reinstall src/style_core
say "== mathematics (no ROS) on Python 3.10, $("$venv/bin/python" -c 'import numpy, scipy
print(f"NumPy {numpy.__version__}, SciPy {scipy.__version__}")')"
exec "$venv/bin/pytest" -q -n auto -p no:cacheprovider src/style_core/test
