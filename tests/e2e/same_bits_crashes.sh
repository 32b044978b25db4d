#!/usr/bin/env bash
# The image depends on the job alone, not on crashes, restarts, joins or duplicates.
. "$(dirname "$0")/farm.sh"

size=160x144
if [ -n "${TESSERA_E2E_SMALL:-}" ]; then size=64x64; fi
job=(--size "$size" --max-depth 5 --frames 12 --seed 7 --tile-size 8)

# The hash of an undisturbed run.
tessera render "$scenes/same_bits.gltf" --output "$work/reference.exr" \
  --report "$work/reference.json" "${job[@]}" --spp 80 --workers 2 --threads 1 >"$work/reference.log" 2>&1
reference=$(pixels "$work/reference.json")
units=$(json "$work/reference.json" 'd["units"]["total"]')

start_server
start_worker a --unit-log "$work/units-a.log"
start_worker b
id=$(farm submit "$scenes/same_bits.gltf" "${job[@]}" --spp 80)

# A worker that holds leases is killed; another one joins half-way through the job.
wait_until 60 "some units are committed" committed_at_least "$id" $((units / 10))
kill_worker b
say "killed a worker that held leases"
start_worker c --unit-log "$work/units-c.log"
wait_until 60 "it takes part" grep -qs "^COMMITTED" "$work/units-c.log"

# The coordinator is killed during the job and restarted on its store.
kill_server
start_server
say "killed the coordinator and started it again"
farm watch "$id" --json </dev/null >"$work/watch.log" || fail "watch: status $?"
farm report "$id" --json >"$work/report.json"
equal "the same pixels after both" "$(pixels "$work/report.json")" "$reference"
equal "every unit was committed" "$(json "$work/report.json" 'd["units"]["total"]')" "$units"
[ "$(json "$work/report.json" 'sum(w["units"] > 0 for w in d["workers"])')" -ge 3 ] ||
  fail "the worker that joined half-way committed nothing"
say "the worker that joined half-way took part"

# Every block is delivered twice on purpose.
kill_worker c
worker_program=tessera-worker-faults start_worker twice --fault-deliver-twice
id=$(farm submit "$scenes/same_bits.gltf" "${job[@]}" --spp 80 --name twice)
farm watch "$id" --json </dev/null >"$work/watch.log" || fail "watch: status $?"
farm report "$id" --json >"$work/report.json"
equal "the same pixels after deliveries on purpose" "$(pixels "$work/report.json")" "$reference"
[ "$(json "$work/report.json" 'd["units"]["duplicated"]')" -ge 1 ] || fail "no duplicate was counted"
say "delivered twice on purpose: $(json "$work/report.json" 'd["units"]["duplicated"]') duplicates"
kill_worker twice

# A worker is stopped for longer than the time-out (5 s). Its units go to another worker, which commits
# them. Then it continues and delivers its results: duplicates, compared bit for bit.
id=$(farm submit "$scenes/same_bits.gltf" "${job[@]}" --spp 4000 --name stopped)
# Wait for the third pass of 448 samples: earlier units take 2 ms, and between two of them a worker holds
# nothing. The reference had three passes.
wait_until 60 "the third pass has begun" committed_at_least "$id" $((2 * units / 3 + 5))
stop_at_a_unit() {
  kill -STOP "${worker_pid[a]}"
  held=$(awk '{ unit = $2 " " $3 " " $4 " " $5 } $1 == "started" { at[unit] } $1 != "started" { delete at[unit] }
    END { for (unit in at) { print unit; exit } }' "$work/units-a.log")
  [ -n "$held" ] && return
  kill -CONT "${worker_pid[a]}"
  return 1
}
wait_until 60 "it is stopped at a unit" stop_at_a_unit
start_worker d --unit-log "$work/units-d.log"
wait_until 60 "another did what it held" grep -qs "^COMMITTED $held\b" "$work/units-d.log"
kill -CONT "${worker_pid[a]}"
duplicates() { farm report "$id" --json >"$work/report.json" && json "$work/report.json" 'd["units"]["duplicated"]'; }
some_duplicates() { [ "$(duplicates)" -ge 1 ]; }
wait_until 60 "what the stopped worker held arrives as duplicates" some_duplicates
equal "they are the same bits" "$(json "$work/report.json" 'd["units"]["mismatched"]')" 0
farm cancel "$id" >/dev/null
