#!/usr/bin/env bash
# Scenes at other scales and far from the origin give the same image; tests/bench/placements/run.py says how close.
set -euo pipefail
: "${TESSERA_BIN:?folder of tessera, tessera-server and tessera-worker}"
export PYTHONDONTWRITEBYTECODE=1
exec "$(dirname "$0")/../bench/placements/run.py" small_lamp checker points foliage --bin "$TESSERA_BIN" \
  --size 32x32 --spp 16 --placement 1e-6,0,0,0 --placement 1e6,0,0,0 --placement 1,1e7,1e7,1e7
