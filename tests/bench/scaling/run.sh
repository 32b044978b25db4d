#!/usr/bin/env bash
# Measures a render with 1, 2, 4, … worker processes pinned to the available cores, up to twice as many as cores.
# Then simulates farms of 10 to 10,000 workers (simulate.cpp) with the measured times and sizes of units,
# merges and images. Figures: docs/notes/scaling.md.
#
#   tests/bench/scaling/run.sh [SCENE]     default: quickstart.gltf. TESSERA_BIN as for tests/bench/scale.sh;
#                                          SIZE: 960x576. FILM_THREADS: 4, of the simulated server
#
# Efficiency is relative to the wall time with one worker, so the cores must be otherwise idle. `busy` is the
# fraction of their time that the renderers used.
set -euo pipefail
root=$(cd "$(dirname "$0")/../../.." && pwd)
export TESSERA_BIN=${TESSERA_BIN:-$root/build/bench/bin}
. "$root/tests/e2e/farm.sh"
scene=${1:-$scenes/quickstart.gltf}
size=${SIZE:-960x576}
job=(--size "$size" --tile-size 64 --spp 32)
cores=$(nproc)
metrics=127.0.0.1:9431

# render WORKERS: writes report-WORKERS.json, and the metrics of the server to metrics-WORKERS.txt.
render() {
  local i
  rm -rf "$work/store"
  start_server --metrics "$metrics"
  for ((i = 0; i < $1; ++i)); do
    taskset -c $((i % cores)) tessera-worker --server "$socket" --name "$1-$i" --threads 1 \
      --cache "$work/cache" --log-level debug >>"$work/worker-$1-$i.log" 2>&1 &
    worker_pid[$1-$i]=$!
  done
  farm submit "$scene" "${job[@]}" --name it --wait >/dev/null 2>&1
  farm report it --json >"$work/report-$1.json"
  curl -sf "http://$metrics/metrics" >"$work/metrics-$1.txt"
  for ((i = 0; i < $1; ++i)); do kill_worker "$1-$i"; done
  kill "$server_pid"
  wait "$server_pid"
  server_pid=
}

echo "| workers | cores | wall | efficiency | busy |"
echo "|---|---|---|---|---|"
for ((n = 1; n <= 2 * cores; n *= 2)); do
  render "$n"
  used=$((n < cores ? n : cores))
  python3 - "$work" "$n" "$used" <<'PY'
import json, sys
work, n, used = sys.argv[1], sys.argv[2], int(sys.argv[3])
one, this = (json.load(open(f"{work}/report-{k}.json")) for k in ("1", n))
wall, cpu = this["wall_seconds"], this["cpu_seconds"]
print(f"| {n} | {used} | {wall:.1f} s | {100 * one['wall_seconds'] / (used * wall):.1f} % "
      f"| {100 * cpu / (used * wall):.1f} % |")
PY
done

# From the run with one worker, which leaves the other cores to the server: CPU seconds of units by number of samples
# (passes of 8 and 24).
sed -nE 's/.* unit .* ([0-9]+) rendered in ([0-9.e-]+) s of CPU time.*/\1 \2/p' "$work/worker-1-0.log" |
  awk '{ print $2 / ($1 == 0 ? 8 : 24) }' >"$work/units.txt"
figure() { awk -v name="tessera_$1" '$1 == name { print $2 }' "$work/metrics-1.txt"; }
block_bytes=$(awk "BEGIN { print $(figure block_bytes_total) / $(figure units_committed_total) }")
merge_seconds=$(awk "BEGIN { print $(figure merge_seconds_sum) / $(figure merge_seconds_count) }")
# The measured image is the only one of its run; those of the simulated frames have more pixels.
image_seconds=$(awk "BEGIN { print $(figure frame_write_duration_seconds_sum) * 1920 * 1080 / (${size/x/ * }) }")
echo
echo "$(wc -l <"$work/units.txt") units, $(awk '{ s += $1 } END { print 1000 * s / NR }' "$work/units.txt") CPU ms" \
  "a sample of a tile; $block_bytes bytes a block, merged in $(awk "BEGIN { print 1000 * $merge_seconds }") ms;" \
  "$image_seconds s for the image of a frame"
for spp in 64 512; do
  echo
  echo "100 frames of 1920x1080, $spp samples a pixel:"
  bench_simulated_farm --units "$work/units.txt" --block-bytes "$block_bytes" --merge-seconds "$merge_seconds" \
    --image-seconds "$image_seconds" --film-threads "${FILM_THREADS:-4}" --spp "$spp" --deaths
done
