#!/usr/bin/env bash
# Compares Tessera with Blender Cycles: agreement of the images, and CPU time to a relMSE of 0.01.
#
#   tests/bench/against_cycles.sh SCENES [--bin DIR (build/bench/bin)] [--only NAME]… [--out FILE.md]
#                                 [--agreement]
#
# SCENES is a directory with NAME/NAME.glb for the six names in against_cycles/run.py, and env/ with the
# environment map. Needs `apt-get install --no-install-recommends blender python3-numpy
# python3-openimageio`. The renderers run alternately with one thread each, for about half an hour. Exit
# code 1: the goal is missed (geometric mean of Cycles' CPU seconds / Tessera's at least 2, no scene below 1).
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
command -v blender >/dev/null || { echo "against_cycles: blender is not installed; see the head of $0" >&2; exit 77; }
exec /usr/bin/python3 "$root/tests/bench/against_cycles/run.py" "$@"
