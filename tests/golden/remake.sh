#!/usr/bin/env bash
# Renders the references of this folder again: NAME.mean.exr and NAME.variance.exr, the mean and the
# variance of one frame per pixel over 32 seeds, unclamped. Run it after a change that is meant to
# alter images, and look at them.
#
#   tests/golden/remake.sh [BIN (build/dev/bin)]
set -euo pipefail
cd "$(dirname "$0")/../.."
TESSERA_GOLDEN_REMAKE=1 "${1:-build/dev/bin}/numeric_golden_test"
