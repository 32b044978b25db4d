#!/usr/bin/env bash
# Dependencies, pools, limits, shares and changes of jobs, with the server killed in the middle.
. "$(dirname "$0")/farm.sh"
scene=$scenes/lit_square.gltf
job=(--size 64x48 --spp 8 --tile-size 16)
sequence=(--size 160x120 --spp 64 --tile-size 16 --frames 0-2)

state_of() { farm status "$1" --json >"$work/status.json" && json "$work/status.json" 'd["state"]'; }
reason_of() { farm status "$1" --json >"$work/status.json" && json "$work/status.json" 'd["reason"]'; }
progress_of() { farm status "$1" --json >"$work/status.json" && json "$work/status.json" "d['progress']['$2']"; }
all_pixels() { json "$1" '[f["pixels_sha256"] for f in d["frames"]]'; }
is() { [ "$(state_of "$1")" = "$2" ]; }
pool_of() { farm workers --json >"$work/workers.json" && json "$work/workers.json" "[w['pool'] for w in d['workers'] if w['id'] == '$1']"; }
restart() { kill_server && start_server; }

exits 0 tessera render "$scene" "${sequence[@]}" --output "$work/alone.exr" --report "$work/alone.json"

# Dependencies -----------------------------------------------------------------------------------
start_server
start_interruptible events tessera events --server "$socket" --follow --json
follower=$started
first=$(farm submit "$scene" "${sequence[@]}" --name first)
second=$(farm submit "$scene" "${sequence[@]}" --seed 2 --priority 50 --name second --after-frames first)
third=$(farm submit "$scene" "${job[@]}" --seed 3 --priority 60 --name third --after second)
exits 2 farm submit "$scene" "${job[@]}" --frames 0-9 --after-frames first
says "dependencies: job $first has no frame 3 to wait for"
restart
equal "a dependency outlives the server" "$(reason_of "$third")" "waits for job $second to be done; it is QUEUED"
start_worker one --id w-one
has_frame() { [ "$(progress_of "$first" frames_finished)" -ge 1 ]; }
wait_until 120 "a frame of the first job is finished" has_frame
restart # in the middle
exits 0 farm watch third
# Small images are rows, in the order in which frames are finished.
python3 - "$work/store" "$first" "$second" "$third" <<'END' || fail "frames are not finished in order"
import sqlite3, sys
store, *jobs = sys.argv[1:]
rows = sqlite3.connect(f"file:{store}/store.db?mode=ro", uri=True).execute(
    "SELECT jobs.id, frame, images.rowid FROM images JOIN jobs ON jobs.sequence = images.job")
at = {(job, frame): position for job, frame, position in rows}
first, second, third = jobs
for frame in range(3):
    assert at[first, frame] < at[second, frame] < at[third, 0], (frame, at)
END
say "frames and jobs are finished in order, over a kill of the server"
farm report first --json >"$work/first.json"
equal "with the same bits as alone" "$(all_pixels "$work/first.json")" "$(all_pixels "$work/alone.json")"
kill_worker one

failing=$(farm submit "$scene" "${job[@]}" --name parent)
child=$(farm submit "$scene" "${job[@]}" --seed 4 --name child --after parent)
farm cancel parent >/dev/null
equal "a job waits for one that was cancelled" "$(reason_of "$child")" \
  "waits for job $failing, which is CANCELLED: \`tessera retry $failing\` resumes it, \`tessera set $child --no-after\` drops the dependency"
farm remove parent >/dev/null
equal "its removal fails the job" "$(state_of "$child")" "failed"
restart
equal "for good" "$(state_of "$child")" "failed"
exits 2 farm retry child
says "was removed"
exits 0 farm set child --no-after
exits 0 farm retry child
start_worker one --id w-one
exits 0 farm watch child
say "without the dependency it is rendered"

# Pools ------------------------------------------------------------------------------------------
late=$(farm submit "$scene" "${job[@]}" --seed 5 --pool night --name late)
equal "a job waits for its pool" "$(reason_of "$late")" "no connected worker is in pool night"
exits 0 farm workers pool w-one night
exits 0 farm watch late
kill_server
kill_worker one
start_server
start_worker one --id w-one
wait_until 60 "the worker is back" eval '[ -n "$(pool_of w-one)" ]'
equal "a move outlives server and worker" "$(pool_of w-one)" "night"
exits 0 farm workers pool w-one ""
equal "until it is ended" "$(pool_of w-one)" "default"

# Limits -----------------------------------------------------------------------------------------
exits 2 farm submit "$scene" "${job[@]}" --limit licence
says "no limit \"licence\""
exits 0 farm limits set licence 0
limited=$(farm submit "$scene" --size 640x480 --spp 4096 --tile-size 16 --seed 6 --limit licence --name limited)
restart
reached() { [ "$(reason_of "$limited")" = "limit licence is reached: 0 of 0 units are in use, a lease needs 1" ]; }
wait_until 60 "the limit is there after the restart" reached # once the worker has connected again
say "a limit outlives the server, and the job says why it waits"
exits 0 farm limits set licence 1
most_used() {
  farm limits --json >"$work/limits.json"
  check_schema <"$work/limits.json" || fail "limits --json does not match its schema"
  json "$work/limits.json" 'd["limits"][0]["used"]'
}
# holds COUNT: looks COUNT times at the limit and at the leases of the workers.
holds() {
  local i
  for ((i = 0; i < $1; i++)); do
    [ "$(most_used)" -le 1 ] || fail "a limit of 1 is exceeded"
    farm workers --json >"$work/workers.json"
    [ "$(json "$work/workers.json" 'sum(w["units_leased"] for w in d["workers"])')" -le 1 ] ||
      fail "more than one unit is leased"
  done
}
start_worker two --id w-two
wait_until 120 "units are committed" committed_at_least "$limited" 2
holds 5
restart # in the middle
done_before=$(committed "$limited")
holds 5
wait_until 120 "it goes on" committed_at_least "$limited" $((done_before + 2))
holds 5
exits 0 farm limits set licence 0
none_used() { [ "$(most_used)" -eq 0 ]; }
wait_until 120 "leases end" none_used
exits 0 farm cancel "$limited"
exits 0 farm limits remove licence
say "a limit of 1 holds for two workers, over a kill of the server"
kill_worker two

# Shares -----------------------------------------------------------------------------------------
# share FIELD: prints a field of the only share that is listed.
share() {
  farm shares --json >"$work/shares.json"
  check_schema <"$work/shares.json" || fail "shares --json does not match its schema"
  json "$work/shares.json" "[s['$1'] for s in d['shares']]"
}
exits 0 farm shares set local 3
says "local has weight 3 (set by operator)"
restart
equal "a weight outlives the server" "$(share weight) $(share source)" "3.0 set"
kill_server
start_server --client-share local=2
equal "and replaces that of the option" "$(share weight) $(share source)" "3.0 set"
exits 0 farm shares reset local
says "local has weight 2 (server option)"
equal "which applies again without it" "$(share weight) $(share source)" "2.0 option"
exits 2 farm shares reset local
says "the weight of client \"local\" is not set"
exits 2 farm shares set local 1001
exits 0 farm shares
grep -q "^local *2 *server option *[0-9.]* s$" "$work/out" || fail "the table of shares: $(cat "$work/out")"

# Changes ----------------------------------------------------------------------------------------
slow=$(farm submit "$scene" --size 640x480 --spp 4096 --seed 7 --name slow)
wait_until 60 "it is rendered" is "$slow" running
exits 0 farm set slow --priority -40
tells_of_change() { grep -q '"kind":"job changed"' "$work/events.out"; }
wait_until 60 "an event tells of the change" tells_of_change
exits 0 farm set slow --priority -50 --require-tag none-has-it --max-workers 2 --json
check_schema <"$work/out" || fail "set --json does not match its schema"
restart
farm status slow --json >"$work/status.json"
equal "a change outlives the server" "$(json "$work/status.json" '[d["priority"], d["required_tag"], d["max_workers"]]')" "-50 none-has-it 2"
exits 2 farm set slow # nothing to change
exits 0 farm cancel slow
interrupted events "$follower"
kill_worker one
kill "$server_pid"
wait "$server_pid" || fail "the server ended with $? on SIGTERM"
server_pid=
exits 0 tessera-server check "$work/store"
say "the store is whole"
echo "$checks checks"
