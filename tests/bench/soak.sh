#!/usr/bin/env bash
# Soak: a farm of real processes renders small jobs of mixed sizes for DURATION, while memory, open descriptors and
# size of the store are sampled to CSV and plotted as SVG.
#
#   tests/bench/soak.sh [DURATION] [FOLDER]     default: 2h build/soak; 900, 15m and 2h are durations
#
# TESSERA_BIN: directory of the programs (build/dev/bin). Figures: docs/notes/reliability-chaos.md.
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
export TESSERA_BIN=${TESSERA_BIN:-$root/build/dev/bin}
. "$root/tests/e2e/farm.sh"
folder=${2:-$root/build/soak}
mkdir -p "$folder"

# Ended jobs are removed after a minute and a half, so that memory and the size of the store must level off.
start_server --job-retention-days 0.001
start_worker one
start_worker two
"$root/tests/bench/soak/soak.py" --duration "${1:-2h}" --server "$socket" --store "$work/store" --scenes "$scenes" \
  --csv "$folder/soak.csv" --svg "$folder/soak.svg" \
  "server=$server_pid" "worker one=${worker_pid[one]}" "worker two=${worker_pid[two]}"
