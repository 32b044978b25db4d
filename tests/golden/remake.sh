#!/usr/bin/env bash
# Makes the kept pictures of this folder anew: NAME.mean.exr and NAME.variance.exr (of one frame),
# from 32 seeds. After a change that is meant to alter what scenes look like; look at them.
#
#   tests/golden/remake.sh [BIN (build/dev/bin)]
set -euo pipefail
cd "$(dirname "$0")/../.."
TESSERA_GOLDEN_REMAKE=1 "${1:-build/dev/bin}/numeric_golden_test"
