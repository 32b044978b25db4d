#!/usr/bin/env bash
# Measures a coordinator: durable small results per second, bytes per second of large results, memory per
# connected worker, a 16k x 16k frame within 2 GiB, small jobs per second, memory and store after 200,000 jobs, `tessera
# submit` of small scenes, which a real worker renders, the return of all workers after a restart, and commits during a
# backup and uploads. Simulated workers in other processes use gRPC; the image of a large job is compared with the
# pixels that follow from the fabricated blocks.
#
#   tests/bench/coordinator/run.sh [small|bulk|connected|large|jobs|lease|growth|submit|reconnect|backup|uploads]…
#
# Default: the first three.
#
# BIN: directory of tessera-server and the bench programs (build/dev/bin). STORE: empty directory for the
# stores, on a real file system (tmpfs is refused, because syncs cost nothing there).
set -euo pipefail
cd "$(dirname "$0")/../../.."
BIN=${BIN:-$PWD/build/dev/bin}
STORE=${STORE:-$PWD/build/bench-store}
mkdir -p "$STORE"
case "$(stat -f -c %T "$STORE")" in
  tmpfs | ramfs)
    echo "bench: $STORE is $(stat -f -c %T "$STORE"); set STORE to a folder on a disk" >&2
    exit 2
    ;;
esac
ulimit -n "$(ulimit -Hn)"

folder=$(mktemp -d "$STORE/run.XXXXXX")
server_pid=
simulators=()
cleanup() {
  for pid in $server_pid "${simulators[@]}"; do kill -KILL "$pid" 2>/dev/null || true; done
  wait 2>/dev/null || true
  rm -rf "$folder"
}
trap cleanup EXIT

# server [OPTION…]: starts a server with these options.
server() {
  "$BIN/tessera-server" --listen "unix:$folder/s" --store "$folder/store" "$@" >"$folder/server.log" 2>&1 &
  server_pid=$!
  until [ -S "$folder/s" ]; do
    kill -0 "$server_pid" || { cat "$folder/server.log" >&2; exit 1; }
    sleep 0.05
  done
}

# simulate PROCESSES WORKERS CREDITS: starts processes with WORKERS workers each, which hold up to CREDITS
# units each. They stop when the pipe is closed.
simulate() {
  simulators=()
  mkfifo "$folder/hold"
  for ((i = 0; i < $1; ++i)); do
    "$BIN/bench_simulated_workers" --server "unix:$folder/s" --name "sim$i" --workers "$2" \
      --credits "$3" --first-leases "$folder/leases$i" <"$folder/hold" >"$folder/sim$i.json" 2>"$folder/sim$i.log" &
    simulators+=($!)
  done
  exec 3>"$folder/hold"
}

stop_all() {
  exec 3>&-
  wait "${simulators[@]}" || true
  simulators=()
  rss_peak=$(awk '/VmHWM/ {print int($2 / 1024)}' "/proc/$server_pid/status")
  server_cpu=$(cpu_seconds "$server_pid")
  kill -TERM "$server_pid"
  wait "$server_pid" || true
  server_pid=
}

# cpu_seconds PID: prints the CPU seconds that a process has used.
cpu_seconds() { awk -v hz="$(getconf CLK_TCK)" '{sub(/.*\) /, ""); print ($12 + $13) / hz}' "/proc/$1/stat"; }

# lease_times: prints the times from granting credits to the next leases of each process of simulators.
lease_times() {
  echo "from credits to leases $(grep -ho '"lease_p.*[0-9]' "$folder"/sim*.json | tr '\n' ';')"
}

# commit_times: prints the times from sending blocks to their acknowledgements of each process of simulators.
commit_times() {
  echo "from sending a block to its acknowledgement $(grep -ho '"commit_p.*[0-9]' "$folder"/sim*.json | tr '\n' ';')"
}

# first_leases: prints the times from CreateJob's answers to the first leases of the jobs; 0 if the lease was sooner.
first_leases() {
  sort "$folder"/leases* | awk '!seen[$1]++' | join - <(sort "$folder/answers") |
    awk '{wait = ($2 - $3) / 1000; print (wait > 0 ? wait : 0)}' | sort -n |
    awk '{wait[NR] = $1} END {printf "from the answer to the first lease of %d jobs p50 %.2f ms, p99 %.2f ms",
           NR, wait[int(NR / 2) + 1], wait[int(NR * 0.99) + 1]}'
}

# small_jobs_at RATE SECONDS: jobs of four units each.
small_jobs_at() {
  "$BIN/bench_coordinator_small_jobs" --server "unix:$folder/s" --jobs $(($1 * $2)) --rate "$1"
}

rss_mb() { awk '/VmRSS/ {print $2 / 1024}' "/proc/$server_pid/status"; }

# summary: prints units and megabytes per second between the first lease and the last acknowledgement.
summary() {
  python3 - "$folder" "$1" "$rss_peak" <<'PY'
import glob, json, sys
folder, what, peak = sys.argv[1:]
sims = [json.load(open(p)) for p in glob.glob(folder + "/sim*.json")]
job = json.load(open(folder + "/job.json"))
start = min(s["first_lease_us"] for s in sims if s["first_lease_us"])
end = max(s["last_commit_us"] for s in sims)
seconds = (end - start) / 1e6
units = sum(s["committed"] for s in sims)
assert units == job["units"], f"{units} acknowledged of {job['units']} units"
assert job["pixels_right"], "the merged image is not what the blocks imply"
bad = {k: sum(s[k] for s in sims) for k in ("duplicate", "obsolete", "rejected")}
print(f"{what}: {units} blocks of {job['block_bytes']} bytes durable in {seconds:.2f} s: "
      f"{units / seconds:.0f}/s, {units * job['block_bytes'] / seconds / 1e6:.0f} MB/s; "
      f"image {job['wall_seconds'] - seconds:.1f} s later; server at most {peak} MiB; "
      f"pixels right; {bad}")
PY
  rm -rf "$folder"/*
}

job() { "$BIN/bench_coordinator_job" --server "unix:$folder/s" "$@" >"$folder/job.json"; }

bench_small() {
  server
  simulate 2 4 512
  job --width ${SMALL_WIDTH:-4096} --height 1024 --tile 8 --spp 8
  stop_all
  summary "small results (8x8 tiles)"
}

bench_bulk() {
  server
  simulate 2 4 16
  job --width 8192 --height 4096 --tile 64 --spp 8
  stop_all
  summary "bulk (64x64 tiles)"
}

bench_large() {
  server
  simulate 2 4 16
  job --width 16384 --height 16384 --tile 64 --spp 8
  stop_all
  summary "a frame of 16384 x 16384"
}

# Jobs of four units each: as many as possible with an empty queue, then with jobs waiting that no worker can
# serve, then RATE a second with those.
bench_jobs() {
  local queued rate
  for queued in 0 ${QUEUED:-100000} ${QUEUED:-100000}/${RATE:-500}; do
    rate=0
    case $queued in */*) rate=${queued#*/} queued=${queued%/*} ;; esac
    server
    simulate 2 4 64
    echo "small jobs: $("$BIN/bench_coordinator_small_jobs" --server "unix:$folder/s" \
      --jobs "${JOBS:-10000}" --queued "$queued" --rate "$rate" --answers "$folder/answers"); load average $(cut -d' ' -f1 /proc/loadavg)"
    stop_all
    echo "small jobs: server at most $rss_peak MiB, $server_cpu CPU seconds for all jobs; $(lease_times); $(first_leases)"
    rm -rf "${folder:?}"/*
  done
}

# JOBS (200,000) small jobs in ten parts, which are removed nine seconds after their end.
bench_growth() {
  local part jobs=$((${JOBS:-200000} / 10))
  server --job-retention-days 0.0001
  simulate 2 4 64
  for part in {1..10}; do
    "$BIN/bench_coordinator_small_jobs" --server "unix:$folder/s" --jobs $jobs >"$folder/part.json"
    echo "growth: after $((part * jobs)) jobs: server $(rss_mb) MiB, $(ls "/proc/$server_pid/fd" | wc -l) descriptors," \
      "store.db $(stat -c %s "$folder/store/store.db" | awk '{print $1 / 1e6}') MB;" \
      "$(grep -o '"jobs_per_second": [0-9.]*' "$folder/part.json")"
  done
  stop_all
  echo "growth: load average $(cut -d' ' -f1 /proc/loadavg); server at most $rss_peak MiB"
  rm -rf "${folder:?}"/*
}

# SUBMITS scenes, one after another, over TCP.
bench_submit() {
  local address worker
  "$BIN/tessera-server" --listen 127.0.0.1:0 --store "$folder/store" >"$folder/address" 2>"$folder/server.log" &
  server_pid=$!
  until grep -q : "$folder/address"; do
    kill -0 "$server_pid" || { cat "$folder/server.log" >&2; exit 1; }
    sleep 0.05
  done
  address=$(cat "$folder/address")
  "$BIN/tessera-worker" --server "$address" --token "$folder/store/token" --name one --threads 1 \
    --cache "$folder/cache" >"$folder/worker.log" 2>&1 &
  simulators=($!)
  until grep -q connected "$folder/server.log" "$folder/worker.log"; do sleep 0.05; done
  tests/bench/coordinator/submits.py --bin "$BIN" --server "$address" --token "$folder/store/token" \
    --scene tests/scenes/lit_square.gltf --count "${SUBMITS:-300}" --scratch "$folder"
  echo "load average $(cut -d' ' -f1 /proc/loadavg)"
  kill "${simulators[@]}" "$server_pid"
  wait "${simulators[@]}" "$server_pid" || true
  simulators=() server_pid=
  rm -rf "${folder:?}"/*
}

# Leases of a large job behind jobs that no worker can serve.
bench_lease() {
  server
  simulate 2 4 16
  "$BIN/bench_coordinator_small_jobs" --server "unix:$folder/s" --jobs 1 --queued "${QUEUED:-100000}" >/dev/null
  job --width 2048 --height 1024 --tile 8 --spp 8
  stop_all
  echo "behind ${QUEUED:-100000} jobs: $(lease_times); $(cat "$folder/job.json")"
  rm -rf "${folder:?}"/*
}

bench_connected() {
  local before after count=1000
  server
  before=$(rss_mb)
  simulate 4 $((count / 4)) 4
  sleep 15
  after=$(rss_mb)
  stop_all
  python3 - "$folder" "$before" "$after" <<'PY'
import glob, json, sys
sims = [json.load(open(p)) for p in glob.glob(sys.argv[1] + "/sim*.json")]
welcomed = sum(s["welcomed"] for s in sims)
closed = sum(s["closed"] for s in sims)
grown = float(sys.argv[3]) - float(sys.argv[2])
print(f"connected: {welcomed} workers welcomed, {closed} streams closed since; "
      f"{grown * 1024 / welcomed:.0f} KiB each ({grown:.0f} MiB in all)")
PY
  rm -rf "$folder"/*
}

# WORKERS come back after a restart.
bench_reconnect() {
  tests/bench/coordinator/reconnect.py --bin "$BIN" --scratch "$folder" --plain ${WORKERS:-1000 5000}
  tests/bench/coordinator/reconnect.py --bin "$BIN" --scratch "$folder" ${WORKERS:-1000}
}

# A backup while RATE jobs a second, with four results each, are committed and finished, and while a large job is.
bench_backup() {
  local jobs
  for jobs in "small_jobs_at ${RATE:-50} ${SECONDS_EACH:-20}" "job --width 8192 --height 2048 --tile 8 --spp 8"; do
    server
    simulate 2 4 64
    $jobs >"$folder/jobs.json" &
    sleep 2
    echo "backup during '$jobs':"
    time "$BIN/tessera-server" backup "$folder/store" "$folder/copy"
    wait $! || true
    stop_all
    echo "$(cat "$folder"/job*.json); $(commit_times); load average $(cut -d' ' -f1 /proc/loadavg)"
    rm -rf "${folder:?}"/*
  done
}

# Commits of small jobs without and with clients that upload large assets.
bench_uploads() {
  local clients
  for clients in 0 ${UPLOADERS:-4} 0 ${UPLOADERS:-4}; do
    server
    simulate 2 4 64
    if [ "$clients" -gt 0 ]; then
      "$BIN/bench_coordinator_uploads" --server "unix:$folder/s" --clients "$clients" --megabytes "${MEGABYTES:-64}" \
        <"$folder/hold" 3>&- >"$folder/uploads.json" &
      simulators+=($!)
    fi
    small_jobs_at "${RATE:-50}" "${SECONDS_EACH:-20}" >"$folder/jobs.json"
    stop_all
    echo "$clients clients upload: $(cat "$folder/jobs.json"); $(commit_times)"
    cat "$folder"/uploads.json 2>/dev/null || true
    echo "load average $(cut -d' ' -f1 /proc/loadavg)"
    rm -rf "${folder:?}"/*
  done
}

echo "machine: $(nproc) cores, $(awk -F': ' '/model name/ {print $2; exit}' /proc/cpuinfo), store on $(stat -f -c %T "$STORE")"
for bench in "${@:-small bulk connected}"; do
  for name in $bench; do "bench_$name"; done
done
