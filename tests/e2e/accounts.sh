#!/usr/bin/env bash
# Accounts, budgets, jobs that failures pause, workers that are set aside or blocked, events with a cursor and
# probes, with the server killed in the middle.
. "$(dirname "$0")/farm.sh"
scene=$scenes/lit_square.gltf
job=(--size 64x48 --spp 8 --tile-size 16)

status() { farm status "$1" --json >"$work/status.json" && check_schema <"$work/status.json"; }
state_of() { status "$1" && json "$work/status.json" 'd["state"]'; }
is() { [ "$(state_of "$1")" = "$2" ]; }
worker_state() {
  farm workers --json >"$work/workers.json" && check_schema <"$work/workers.json"
  json "$work/workers.json" "[w['state'] for w in d['workers'] if w['id'] == '$1']"
}
worker_is() { [ "$(worker_state "$1")" = "$2" ]; }
used() { # used KIND NAME: CPU seconds, to a microsecond
  farm usage --by "$1" --json >"$work/usage.json" && check_schema <"$work/usage.json"
  json "$work/usage.json" "'%.6f' % sum(u['cpu_seconds'] for u in d['usage'] if u['$1'] == '$2')"
}
cpu_of() { status "$1" && json "$work/status.json" "'%.6f' % d['progress']['cpu_seconds']"; }
probe() { # probe PATH: prints the HTTP status
  python3 -c '
import sys, urllib.error, urllib.request
direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))
try:
    print(direct.open(sys.argv[1], timeout=20).status)
except urllib.error.HTTPError as error:
    print(error.code)' "$(grep -o 'http://[^ ]*/metrics' "$work/server.log" | tail -n 1 | sed s,/metrics,,)$1"
}

start_server --metrics 127.0.0.1:0
equal "the server is alive" "$(probe /livez)" 200
equal "and ready" "$(probe /readyz)" 200
equal "and has no other page" "$(probe /other)" 404
start_worker one --id w-one

# Accounts ---------------------------------------------------------------------------------------
long=$(farm submit "$scene" --size 320x240 --spp 256 --tile-size 16 --name long --project film)
other=$(farm submit "$scene" "${job[@]}" --seed 2 --name other)
wait_until 60 "units are committed" committed_at_least "$long" 5
kill_server # in the middle of commits
start_server --metrics 127.0.0.1:0
kill_worker one
start_worker one --id w-one
exits 0 farm watch long --json
exits 0 farm watch other --json
equal "a project is charged what its job used, over a kill of the server" "$(used project film)" "$(cpu_of "$long")"
exits 0 farm usage --by owner --csv
equal "a client is charged all its jobs" \
  "$(awk -F, -v sum="$(cpu_of "$long") $(cpu_of "$other")" 'NR == 2 { split(sum, a, " ")
    print $1, ($3 - a[1] - a[2]) ^ 2 < 1e-10 }' "$work/out")" "local 1"
exits 0 farm remove other
equal "a removed job stays in the accounts" "$(used job "$other" | awk '{ print ($1 > 0) }')" 1
exits 0 farm usage --until 2020-01-01 --json
equal "by time" "$(json "$work/out" 'len(d["usage"])')" 0
exits 2 farm usage --since yesterday
says "neither a date"

# Budgets ----------------------------------------------------------------------------------------
exits 0 farm budgets set --owner local --cpu-hours 0.000001
exits 0 farm budgets --json
check_schema <"$work/out" || fail "budgets --json does not match its schema"
stopped=$(farm submit "$scene" "${job[@]}" --seed 3 --name stopped)
kill_server
start_server --metrics 127.0.0.1:0
wait_until 60 "the worker is back" worker_is w-one idle
says_budget() { status "$stopped" && json "$work/status.json" 'd["reason"]' | grep -q "^budget of client local: "; }
wait_until 60 "a budget outlives the server, and the job says why it waits" says_budget
equal "nothing is rendered" "$(committed "$stopped")" 0
exits 0 farm budgets set --owner local --cpu-hours 1000 --period month --when-used-up warn
exits 0 farm watch stopped --json
exits 0 farm budgets set --owner local --cpu-hours 2000
says "period: month, warn at 0.8, when used up: warn"
exits 0 farm budgets set --owner local --warn-at 0.5
equal "values that are not given stay" "$(farm budgets --json | python3 -c '
import json, sys
b = json.load(sys.stdin)["budgets"][0]
print(b["cpu_seconds"], b["period"], b["action"], b["warning_fraction"])')" "7200000.0 month warn 0.5"
exits 2 farm budgets set --project film --period month
says "project film has no budget yet: give --cpu-hours"
exits 0 farm budgets remove --owner local
exits 2 farm budgets remove --owner local
say "a budget stops new leases until it is raised"

# Set aside, blocked -----------------------------------------------------------------------------
exits 0 farm workers set-aside w-one --reason "new memory"
waits=$(farm submit "$scene" "${job[@]}" --seed 4 --name waits)
kill_server
start_server --metrics 127.0.0.1:0
wait_until 60 "it is set aside over a kill of the server" worker_is w-one "set aside"
equal "with the reason" "$(json "$work/workers.json" 'd["workers"][0]["note"]')" "new memory"
equal "and renders nothing" "$(committed "$waits")" 0
exits 0 farm workers block w-one --job waits
exits 2 farm workers block w-nobody --job waits
says 'no worker "w-nobody"'
exits 0 farm workers bring-back w-one
free=$(farm submit "$scene" "${job[@]}" --seed 5 --name free)
exits 0 farm watch free --json
equal "a worker renders nothing of a job for which it is blocked" "$(committed "$waits")" 0
status "$waits"
equal "which is listed" "$(json "$work/status.json" 'd["blocked_workers"]')" "w-one"
exits 0 farm workers unblock w-one --job waits
exits 0 farm watch waits --json
kill_worker one

# Paused by failures -----------------------------------------------------------------------------
exits 0 farm events --json
cursor=$(tail -n 1 "$work/out" | sed 's/.*"sequence":\([0-9]*\),.*/\1/')
for name in bad1 bad2; do
  worker_program=tessera-worker-faults start_worker "$name" --id "w-$name" --fault-crash-on 0:5:0
done
poisoned=$(farm submit "$scene" "${job[@]}" --seed 6 --name poisoned)
exits 1 farm watch poisoned
says "tessera retry $poisoned"
kill_server
start_server --metrics 127.0.0.1:0
equal "failures pause a job, over a kill of the server" "$(state_of "$poisoned")" paused
equal "the cause is named" "$(json "$work/status.json" 'd["paused_by"]')" failures
equal "and the unit" "$(json "$work/status.json" 'sorted({(a["frame"], a["tile"], a["pass"]) for a in d["failed_attempts"]})')" "(0, 5, 0)"
equal "and the workers" "$(json "$work/status.json" 'sorted({a["worker"] for a in d["failed_attempts"]})')" "w-bad1 w-bad2"
exits 0 farm status poisoned
says "renderer process died: killed by SIGSEGV"
for name in bad1 bad2; do kill_worker "$name"; done
start_worker one --id w-one
exits 0 farm retry poisoned
exits 0 farm watch poisoned --json
say "retry resumes it"

# Events -----------------------------------------------------------------------------------------
kill_server
start_server
exits 0 tessera events --server "$socket" --since "$cursor" --json
while read -r line; do
  check_schema <<<"$line" || fail "does not match its schema: $line"
done <"$work/out"
python3 - "$work/out" "$poisoned" "$cursor" <<'END' || fail "a consumer that was away misses events or gets some twice"
import json, sys
events = [json.loads(line) for line in open(sys.argv[1])]
sequences = [event["sequence"] for event in events]
assert sequences == sorted(set(sequences)) and sequences[0] > int(sys.argv[3]), sequences
kinds = [event["kind"] for event in events if event["job"] == sys.argv[2]]
for kind in ("job submitted", "job paused by failures", "frame finished", "job done"):
    assert kinds.count(kind) == 1, kinds
assert kinds.count("unit failed") == 3, kinds
END
say "a consumer that was away over two kills of the server gets every event once"
exits 2 tessera events --server "$socket" --since $((1 << 60))
says "newer than the last event"
kill_worker one
kill "$server_pid"
wait "$server_pid" || fail "the server ended with $? on SIGTERM"
server_pid=
exits 0 tessera-server check "$work/store"
say "the store is whole"
echo "$checks checks"
