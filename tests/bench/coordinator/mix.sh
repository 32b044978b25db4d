#!/usr/bin/env bash
# Latency of every RPC under a mix of calls, by number of simulated workers and of queued jobs, as tables.
#
#   tests/bench/coordinator/mix.sh [WORKERS/QUEUED]…     default: 10/0 10/10000 100/10000
#
# TENANTS (5) clients with certificates make RATE (100) steps a second for SECONDS_EACH (20) seconds: jobs of 1, 4, 16
# and 64 units, uploads, queries, changes, removals. An operator makes ten steps a second: limits, budgets and commands
# for workers, of which some end the stream of a spare worker. A worker makes ten calls a second of those that workers
# make besides their streams. Simulated workers answer each lease at once. "Work: lease" is the
# time from granting credits to the next leases, also if there is no work meanwhile; "Deliver: commit" is the time from
# sending a block to its acknowledgement; both are those of the slower process of workers. Connections use TLS over
# loopback. BIN and STORE: as for run.sh.
set -euo pipefail
cd "$(dirname "$0")/../../.."
BIN=${BIN:-$PWD/build/dev/bin}
STORE=${STORE:-$PWD/build/bench-store}
mkdir -p "$STORE"
folder=$(mktemp -d "$STORE/mix.XXXXXX")
pids=()
cleanup() {
  for pid in "${pids[@]}"; do kill -KILL "$pid" 2>/dev/null || true; done
  wait 2>/dev/null || true
  rm -rf "$folder"
}
trap cleanup EXIT
ulimit -n "$(ulimit -Hn)"

# measure WORKERS QUEUED: writes $folder/WORKERS-QUEUED.json and .workers, with the lines of two processes of workers.
measure() {
  local run=$folder/$1-$2 address i
  mkdir "$run"
  "$BIN/tessera-server" init-certs "$run/certs" --host 127.0.0.1 2>/dev/null
  for ((i = 0; i < ${TENANTS:-5}; ++i)); do
    "$BIN/tessera-server" issue-cert "$run/certs" --role client --name "t$i" >/dev/null
  done
  "$BIN/tessera-server" issue-cert "$run/certs" --role worker --name w >/dev/null
  "$BIN/tessera-server" issue-cert "$run/certs" --role admin --name operator >/dev/null
  "$BIN/tessera-server" --listen 127.0.0.1:0 --certs "$run/certs" --store "$run/store" --client-jobs 0 \
    --client-gigasamples 0 --client-gb 0 --client-calls 0 --client-concurrent-calls 0 --client-upload-gb 0 \
    >"$run/address" 2>"$run/server.log" &
  pids=($!)
  until grep -q : "$run/address"; do
    kill -0 "${pids[0]}" || { cat "$run/server.log" >&2; exit 1; }
    sleep 0.05
  done
  address=$(cat "$run/address")
  "$BIN/tessera-server" tokens create --store "$run/store" --out "$run/token"
  mkfifo "$run/hold"
  for i in 0 1; do
    "$BIN/bench_simulated_workers" --server "$address" --certs "$run/certs/worker-w" --token "$(cat "$run/token")" \
      --name "sim$i" --workers $((($1 + 1) / 2)) --credits 16 <"$run/hold" >"$run/sim$i.json" 2>"$run/sim$i.log" &
    pids+=($!)
  done
  local spares=$((${SECONDS_EACH:-20} * 3 / 2 + 2))
  "$BIN/bench_simulated_workers" --server "$address" --certs "$run/certs/worker-w" --token "$(cat "$run/token")" \
    --name spare --workers "$spares" --credits 1 <"$run/hold" >"$run/spare.json" 2>"$run/spare.log" &
  pids+=($!)
  exec 3>"$run/hold"
  until [ "$(grep -c "connected: spare" "$run/server.log")" -ge "$spares" ]; do sleep 0.05; done
  "$BIN/bench_rpc_mix" --server "$address" --certs "$run/certs" --scratch "$run" --tenants "${TENANTS:-5}" \
    --queued "$2" --rate "${RATE:-100}" --seconds "${SECONDS_EACH:-20}" >"$folder/$1-$2.json"
  exec 3>&-
  wait "${pids[@]:1}" || true
  cat "$run"/sim?.json >"$folder/$1-$2.workers"
  kill "${pids[0]}"
  wait "${pids[0]}" || true
  pids=()
  rm -rf "$run"
}

runs=("$@")
[ $# -gt 0 ] || runs=(10/0 10/10000 100/10000)
for run in "${runs[@]}"; do measure "${run%/*}" "${run#*/}"; done
echo "${TENANTS:-5} tenants, ${RATE:-100} steps a second for ${SECONDS_EACH:-20} s; load average $(cut -d' ' -f1 /proc/loadavg)"
python3 - "$folder" "${runs[@]}" <<'PY'
import json, sys
folder, runs = sys.argv[1], sys.argv[2:]
columns = []
for run in runs:
    name = f"{folder}/{run.replace('/', '-')}"
    calls = json.load(open(f"{name}.json"))
    sims = [json.loads(line) for line in open(f"{name}.workers")]
    for rpc, key in (("Work: lease, with waiting for a job", "lease"), ("Deliver: commit", "commit")):
        worst = max(sims, key=lambda sim: sim[f"{key}_p99_ms"])
        calls[rpc] = {"p50_ms": worst[f"{key}_p50_ms"], "p99_ms": worst[f"{key}_p99_ms"], "failed": 0,
                      "calls": sum(sim["committed"] for sim in sims)}
    columns.append(calls)
heads = ["{} workers, {} queued".format(*run.split("/")) for run in runs]
print("| p50 / p99, ms | " + " | ".join(heads) + " |")
print("|---|" + "---|" * len(runs))
for rpc in sorted(set().union(*columns)):
    cells = [f"{c[rpc]['p50_ms']:.1f} / {c[rpc]['p99_ms']:.1f}" if rpc in c else "" for c in columns]
    print(f"| {rpc} | " + " | ".join(cells) + " |")
calls = [sum(c[rpc]["calls"] for rpc in c if ":" not in rpc) for c in columns]
print("| calls of clients | " + " | ".join(map(str, calls)) + " |")
print("| blocks committed | " + " | ".join(str(c["Deliver: commit"]["calls"]) for c in columns) + " |")
failed = [{rpc: c[rpc]["failed"] for rpc in c if c[rpc]["failed"]} for c in columns]
print(f"Calls refused, because the job had ended meanwhile or had not: {failed}")
PY
