#!/usr/bin/env bash
# Measures whether a distant worker is idle between units. The link to its server has a round trip of 50 ms,
# 100 Mbit/s and no loss (tests/support/wide_area_link.cpp: packets, TCP, TLS). Figures: docs/notes/wide-area.md.
#
#   tests/bench/wan.sh [SPP…]     samples per unit (8 and 56); needs root and /dev/net/tun
#
# TESSERA_BIN: directory of the programs (build/dev/bin). Exits with 1 if the worker was rendering for less
# than 95 % of the time from its first to its last unit, according to its log. WAN_SECONDS: duration (30).
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
export TESSERA_BIN=${TESSERA_BIN:-$root/build/dev/bin}
. "$root/tests/e2e/farm.sh"
[ "$(id -u)" -eq 0 ] && [ -w /dev/net/tun ] || { echo "SKIPPED: needs root and /dev/net/tun"; exit 77; }
seconds=${WAN_SECONDS:-30}
certs=$work/certs

# delay_us, loss_ppm, bits_per_s, is_cut; then counters.
python3 -c '
import struct, sys
open(sys.argv[1], "wb").write(struct.pack("8q", 25_000, 0, 100_000_000, 0, 0, 0, 0, 0))' "$work/line"
mkfifo "$work/spaces"
tessera_wide_area_link "$work/line" >"$work/spaces" &
worker_pid[line]=$!
read -r here there <"$work/spaces"
tessera-server init-certs "$certs" --host 10.9.0.1 2>/dev/null
tessera-server issue-cert "$certs" --role worker --name far >/dev/null
tessera-server issue-cert "$certs" --role client --name near >/dev/null
address=10.9.0.1:7420
nsenter "--net=$here" tessera-server --listen "$address" --store "$work/store" --certs "$certs" \
  >"$work/address" 2>>"$work/server.log" &
server_pid=$!
wait_until 60 "the server listens" grep -q : "$work/address"
tessera-server tokens create --store "$work/store" --out "$work/token" 2>/dev/null
nsenter "--net=$there" tessera-worker --server "$address" --certs "$certs/worker-far" --token "$work/token" \
  --threads 1 --cache "$work/cache" --log-level debug >>"$work/worker.log" 2>&1 &
worker_pid[far]=$!
near() { nsenter "--net=$here" tessera "$1" --server "$address" --certs "$certs/client-near" "${@:2}"; }

echo "| samples per unit and pixel | units | render time per unit | data sent | from delivery to acknowledgement | busy |"
echo "|---|---|---|---|---|---|"
[ $# -gt 0 ] || set -- 8 56
for spp in "$@"; do
  # One frame, whose tiles last for the measured time. Ground only: with 8 samples, tiles of the background
  # render faster than the link carries their blocks.
  pass=0 size=4096x2048 crop=0,1024,4096,1024
  [ "$spp" -le 8 ] || pass=1 size=1024x512 crop=0,256,1024,256
  job=$(near submit "$scenes/quickstart.gltf" --size "$size" --crop "$crop" --tile-size 64 --spp "$((pass * 8 + spp))" 2>/dev/null)
  begun() { [ "$(grep -c "unit $job 0 [0-9]* $pass: COMMITTED" "$work/worker.log")" -ge 8 ]; }
  wait_until 600 "units of pass $pass are committed" begun
  sleep "$seconds"
  near cancel "$job" >/dev/null
  python3 - "$work/worker.log" "$job" "$pass" "$seconds" "$spp" <<'PY'
import datetime, re, sys
log, job, wanted, seconds, spp = sys.argv[1:]
line = re.compile(rf"(\S+) \S+ debug: unit {job} (\d+ \d+ {wanted})(?: |: )(started|rendered|COMMITTED)")
events = [(datetime.datetime.fromisoformat(m[1]).timestamp(), m[2], m[3])
          for m in map(line.match, open(log)) if m]
ends = [at for at, _, what in events if what == "rendered"]
end = ends[-1]
begin = next(at for at, _, what in events if what == "started" and at > end - float(seconds))
taken, rendered, busy, units, trips = {}, {}, 0.0, 0, []
for at, unit, what in events:
    if what == "started":
        taken[unit] = at
    elif what == "rendered":
        rendered[unit] = at
        if taken.get(unit, 0) >= begin:
            busy += at - taken[unit]
            units += 1
    elif rendered.get(unit, 0) >= begin:
        trips.append(at - rendered[unit])
trips.sort()
share = busy / (end - begin)
rate = 64 * 64 * 52 * units / (end - begin) / 1e6  # 52 bytes per pixel, before compression
print(f"| {spp} | {units} | {1000 * busy / units:.0f} ms | {rate:.1f} MB/s "
      f"| {1000 * trips[len(trips) // 2]:.0f} ms | {100 * share:.1f} % |", flush=True)
sys.exit(0 if share >= 0.95 else 1)
PY
done
