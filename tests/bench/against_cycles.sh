#!/usr/bin/env bash
# Compares Tessera with Blender Cycles, Mitsuba 3 and LuxCore: agreement of the images, CPU time to a relMSE of 0.01,
# and, for Cycles, error of denoised images at equal CPU time. See docs/notes/against-cycles.md.
#
#   tests/bench/against_cycles.sh [SCENES] [--bin DIR (build/release/bin)] [--python PATH] [--only NAME]…
#                                 [--peer NAME]… [--quick] [--raw] [--out DIR]
#
# Without SCENES the scenes are those of against_cycles/own_scenes.py. SCENES is a directory with the given files
# that against_cycles/scenes.py names; they are not part of the project. Needs python3-numpy,
# python3-openimageio, and one or more of the peers:
#
#   python3.11 -m venv build/peers && build/peers/bin/python -m pip install 'bpy==4.5.*' mitsuba pyluxcore
#   apt-get install --no-install-recommends blender libllvm19
#
# Mitsuba compiles its kernels by LLVM. Of Debian's versions, 15 fails and 19 works if Mitsuba is told where it is:
# DRJIT_LIBLLVM_PATH=/usr/lib/x86_64-linux-gnu/libLLVM-19.so.
#
# The renderers run alternately with one thread each, for more than an hour.
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
exec /usr/bin/python3 "$root/tests/bench/against_cycles/run.py" "$@"
