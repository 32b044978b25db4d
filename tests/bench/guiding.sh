#!/usr/bin/env bash
# Measures relMSE and CPU time with and without --guiding, on the scenes of tests/bench/coverage and three more.
#
#   tests/bench/guiding.sh [SCENE…] [--seeds N (8)] [--bin DIR (build/dev/bin)] [--jobs N (1)] [--out FILE.md]
#                          [--results FILE.jsonl] [--scale FACTOR (1)] [--references DIR]
#
# The reference of each scene is guided and has other seeds. For each seed a frame is rendered without and then with
# guiding, on one thread. The efficiency is 1 / (relMSE x CPU seconds of rendering); the time to a relMSE of 0.01
# follows from it, because the relMSE is proportional to 1 / samples, plus the time of loading and of the guide.
# --scale multiplies all numbers of samples. References are read from DIR, or written to it. Figures:
# docs/notes/guiding.md. Needs the target tessera-bench-guiding.
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
exec python3 "$root/tests/bench/guiding/run.py" "$@"
