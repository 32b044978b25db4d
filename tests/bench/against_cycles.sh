#!/usr/bin/env bash
# Compares Tessera with Blender Cycles: agreement of the images, CPU time to a relMSE of 0.01, and error of
# denoised images at equal CPU time. See docs/notes/against-cycles.md.
#
#   tests/bench/against_cycles.sh SCENES [--bin DIR (build/release/bin)] [--python PATH] [--only NAME]… [--out DIR]
#
# SCENES is a directory with the files that against_cycles/scenes.py names. Needs python3-numpy,
# python3-openimageio, and today's Cycles, Debian's, or both:
#
#   python3.11 -m venv build/peers && build/peers/bin/pip install 'bpy==4.5.*'
#   apt-get install --no-install-recommends blender
#
# The renderers run alternately with one thread each, for about an hour.
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
exec /usr/bin/python3 "$root/tests/bench/against_cycles/run.py" "$@"
