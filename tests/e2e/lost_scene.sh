#!/usr/bin/env bash
# Scene files that are lost, truncated or damaged in the store, while the server runs and before it starts.
. "$(dirname "$0")/farm.sh"
# Larger than 64 KiB, so that it is a file of the store, not a row.
scene=$work/large.gltf
python3 - "$scenes/lit_square.gltf" "$scene" <<'END'
import json, sys
scene = json.load(open(sys.argv[1]))
scene["extras"] = "x" * 100_000
json.dump(scene, open(sys.argv[2], "w"))
END
job=(--size 64x48 --spp 8 --tile-size 16)
long=(--size 320x240 --spp 256 --tile-size 16)
digest=$(sha256sum "$scene" | cut -d' ' -f1)
asset=$work/store/assets/${digest:0:2}/${digest:2}

state_of() { farm status "$1" --json >"$work/status.json" && json "$work/status.json" 'd["state"]'; }
reason_of() { farm status "$1" --json >"$work/status.json" && json "$work/status.json" 'd["reason"]'; }
lost="the store has lost its scene file large.gltf; submit the scene again"
waits() { [ "$(reason_of "$1")" = "$lost" ]; }
# same JOB REFERENCE: checks that the job ends, without failures, with the pixels of $work/REFERENCE.json.
same() {
  exits 0 timeout 120 tessera watch --server "$socket" "$1"
  farm status "$1" --json >"$work/status.json"
  equal "no unit of $1 failed" "$(json "$work/status.json" 'd["failed_attempts"]')" ""
  farm report "$1" --json >"$work/report.json"
  equal "job $1 has the pixels of a farm that lost nothing" "$(pixels "$work/report.json")" "$(pixels "$work/$2.json")"
}
# no_bad_workers COUNT: checks that none of the workers is set aside or quarantined.
no_bad_workers() {
  farm workers --json >"$work/workers.json"
  equal "no worker is blamed" "$(json "$work/workers.json" \
    'sum(w["state"] in ("idle", "busy") for w in d["workers"])')" "$1"
}
ticks() { awk '{ print $14 + $15 }' "/proc/$1/stat"; }

exits 0 tessera render "$scene" "${job[@]}" --output "$work/alone.exr" --report "$work/alone.json"
exits 0 tessera render "$scene" "${long[@]}" --output "$work/long.exr" --report "$work/long.json"

# While the server runs --------------------------------------------------------------------------
start_server
first=$(farm submit "$scene" "${job[@]}" --name first)
[ -f "$asset" ] || fail "the scene is not a file of the store"
rm "$asset"
start_worker one --id w-one
start_worker two --id w-two
wait_until 60 "the job says why it waits" waits "$first"
before=$(ticks "$server_pid")
sleep 3
waits "$first" || fail "the reason is '$(reason_of "$first")'"
[ $(($(ticks "$server_pid") - before)) -lt 60 ] || fail "workers ask for the file again and again"
say "status says that the file is lost, and workers do not ask for it again and again"
exits 0 farm list --json
says "$lost"
start_interruptible watch tessera watch --server "$socket" "$first"
shows_reason() { grep -qF "$lost" "$work/watch.err" "$work/watch.out"; }
wait_until 20 "watch says it" shows_reason
interrupted watch "$started"
say "list and watch say it"
no_bad_workers 2
second=$(farm submit "$scene" "${job[@]}" --name second)
same "$first" alone
same "$second" alone

# A worker that has the file goes on ---------------------------------------------------------------
kill_worker two
rm -r "$work/cache-two"
third=$(farm submit "$scene" "${long[@]}" --name third)
wait_until 60 "units are committed" committed_at_least "$third" 1
truncate -s 1000 "$asset"
start_worker two --id w-two
same "$third" long
no_bad_workers 2

# Before the server starts -----------------------------------------------------------------------
fourth=$(farm submit "$scene" "${long[@]}" --name fourth)
kill_server
kill_worker one
kill_worker two
rm -r "$work/cache-one" "$work/cache-two"
truncate -s 1000 "$asset"
start_server
start_worker one --id w-one
start_worker two --id w-two
wait_until 60 "the job says why it waits after a restart" waits "$fourth"
exits 0 farm submit "$scene" "${job[@]}" --name fifth
same "$fourth" long
no_bad_workers 2

# Other bytes of the same size ---------------------------------------------------------------------
kill_worker one
kill_worker two
rm -r "$work/cache-one" "$work/cache-two"
[ -f "$asset" ] || fail "the scene is not a file of the store any more"
printf damage | dd of="$asset" bs=1 seek=50000 conv=notrunc status=none
sixth=$(farm submit "$scene" "${job[@]}" --name sixth)
start_worker one --id w-one
start_worker two --id w-two
wait_until 60 "the job says which file is damaged" waits "$sixth"
exits 0 farm submit "$scene" "${job[@]}" --name seventh
same "$sixth" alone
no_bad_workers 2
