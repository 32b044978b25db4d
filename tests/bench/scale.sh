#!/usr/bin/env bash
# Measures a server with many queued jobs: time to start, to list jobs and to find one, memory per job, and
# the time until another job is rendered.
#
#   tests/bench/scale.sh [JOBS]     default: 100,000. TESSERA_BIN: directory of the programs (build/bench/bin)
#
# Then runs tests/bench/coordinator/mix.sh: latency of every RPC under a mix of tenants, jobs and sizes; and
# tests/bench/scaling/run.sh: real renders on a few workers, and simulated farms.
#
# Jobs are copies of a submitted one, written to the rows of a store that no server uses. Times are those of
# whole commands, the minimum of five, including the start of the process. Figures: docs/notes/scaling.md.
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
export TESSERA_BIN=${TESSERA_BIN:-$root/build/bench/bin}
. "$root/tests/e2e/farm.sh"
jobs=${1:-100000}

now() { date +%s.%N; }
since() { python3 -c "print(f'{$(now) - $1:.3f}')"; }
# least COMMAND…: prints the seconds of the fastest of five runs.
least() {
  local i begun
  for i in 1 2 3 4 5; do
    begun=$(now)
    "$@" >/dev/null
    since "$begun"
  done | sort -n | head -n 1
}
resident_kb() { awk '/^VmRSS/ {print $2}' "/proc/$server_pid/status"; }
stop_server() { kill "$server_pid"; wait "$server_pid"; server_pid=; }
row() { printf '| %s | %s |\n' "$1" "$2"; }
# Starts the server, which answers after it has read its jobs, in $took seconds.
restart() {
  local begun
  begun=$(now)
  start_server
  farm status "$id" >/dev/null
  took=$(since "$begun")
}

start_server
id=$(farm submit "$scenes/lit_square.gltf" --size 1920x1080 --spp 256 --name template 2>/dev/null)
before=$(resident_kb)
stop_server
restart
empty=$took
stop_server
python3 - "$work/store/store.db" "$jobs" <<'PY'
import sqlite3, sys
rows = sqlite3.connect(sys.argv[1])
columns = [r[1] for r in rows.execute("PRAGMA table_info(jobs)") if r[1] not in ("sequence", "id", "request_id", "name", "owner")]
template = rows.execute(f"SELECT {', '.join(columns)} FROM jobs").fetchone()
marks = ", ".join("?" * (4 + len(columns)))
rows.executemany(
    f"INSERT INTO jobs(id, request_id, name, owner, {', '.join(columns)}) VALUES({marks})",
    ((f"q{i:07d}", f"r{i}", f"shot-{i}", f"owner-{i % 50}", *template) for i in range(int(sys.argv[2]))))
rows.commit()
PY

restart
full=$took
after=$(resident_kb)
middle=$(printf 'q%07d' $((jobs / 2)))
echo "| with $jobs queued jobs of 50 owners | |"
echo "|---|---|"
row "start of the server to its first answer, with one job" "$empty s"
row "start of the server to its first answer, with all" "$full s"
row "\`tessera --version\` (a process alone)" "$(least tessera --version) s"
row "\`tessera list\` (its first page, 100 jobs)" "$(least farm list) s"
row "\`tessera status ID\`, in the middle of the queue" "$(least farm status "$middle") s"
row "\`tessera status NAME\`, of the oldest: looked for last" "$(least farm status template) s"
row "memory of the server, of that by queued jobs" "$((after / 1024)) MiB, $(((after - before) * 1024 / jobs)) B a job"
row "store.db" "$(($(stat -c %s "$work/store/store.db") / 1048576)) MiB"

start_worker one
begun=$(now)
farm submit "$scenes/lit_square.gltf" --size 64x64 --spp 8 --priority 10 --wait >/dev/null 2>&1
row "a small job of higher priority, submitted to done (one worker, which joins meanwhile)" "$(since "$begun") s"
tessera-server backup "$work/store" "$work/copy" >"$work/backup.log"
row "\`tessera-server backup\` meanwhile" "$(cat "$work/backup.log")"
stop_server
kill_worker one

echo
BIN=$TESSERA_BIN "$root/tests/bench/coordinator/mix.sh"
echo
"$root/tests/bench/scaling/run.sh"
