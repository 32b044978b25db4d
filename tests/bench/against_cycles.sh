#!/usr/bin/env bash
# Tessera beside Blender Cycles: do the pictures agree, and what does an error of 0.01 cost?
#
#   tests/bench/against_cycles.sh SCENES [--bin DIR (build/bench/bin)] [--only NAME]… [--out FILE.md]
#                                 [--agreement]
#
# SCENES is a folder with NAME/NAME.glb for the six names in against_cycles/run.py, and env/ with the
# sky. Needs `apt-get install --no-install-recommends blender python3-numpy python3-openimageio`.
# One thread each, in turns; about half an hour. Exit status 1 where the goal is missed (geometric
# mean of Cycles' CPU seconds over ours at least 2, no scene below 1).
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
command -v blender >/dev/null || { echo "against_cycles: there is no blender; see the head of $0" >&2; exit 77; }
exec /usr/bin/python3 "$root/tests/bench/against_cycles/run.py" "$@"
