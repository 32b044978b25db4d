#!/usr/bin/env bash
# Faults that must fail or pause a job do so early and with a reason; others do neither.
. "$(dirname "$0")/farm.sh"

job=(--size 64x64 --spp 8 --tile-size 16)  # 16 units of one pass
poisoned=0:5:0

# A missing file ends a job before anything is uploaded or leased.
exits 2 tessera render "$scenes/missing_texture.gltf" --output "$work/x.exr" "${job[@]}"
says "not-here.png"
[ ! -e "$work/x.exr" ] || fail "an image was written"
say "a missing texture is refused with exit code 2 before the first unit, and named"

start_server
exits 2 farm submit "$scenes/missing_texture.gltf" "${job[@]}"
says "not-here.png"
exits 0 farm list --json
equal "nothing was submitted" "$(json "$work/out" 'len(d["jobs"])')" 0

# A worker with another numerics hash is refused with a message, even if it is the first to connect.
other_hash=$(printf 'ab%.0s' {1..32})
mkfifo "$work/stranger.in"
bench_simulated_workers --server "$socket" --name stranger --numerics "$other_hash" \
  >"$work/stranger.out" 2>"$work/stranger.log" <"$work/stranger.in" &
stranger=$!
exec {stranger_in}>"$work/stranger.in" # it stays until this is closed
wait_until 60 "it is refused, and its numerics are named" grep -qi numerics "$work/stranger.log"
exec {stranger_in}>&-
wait "$stranger" || fail "the refused worker ended with $?"
grep -q '"welcomed": 0' "$work/stranger.out" || fail "a worker with another numerics hash was accepted"
say "a worker with another numerics hash is refused: $(head -n 1 "$work/stranger.log")"

# A scene whose fault only the worker finds (here because the client's inspection is replaced) is bad input
# too, with the full message; the farm continues.
cp "$scenes/lit_square.gltf" "$work/good.gltf"
cp "$scenes/malformed/index_out_of_range.gltf" "$work/bad.gltf"
stand_in tessera-worker <<EOF
#!/bin/sh
[ "\$1" = inspect ] || exec $TESSERA_BIN/tessera-worker "\$@"
$TESSERA_BIN/tessera-worker inspect --json -- $work/good.gltf | sed 's/good[.]gltf/bad.gltf/g'
EOF
start_worker judge
exits 2 "$work/bin/tessera" submit "$work/bad.gltf" --server "$socket" "${job[@]}" --name bad --wait
says "bad scene: bad.gltf"
exits 2 farm watch bad
exits 2 farm watch bad --json
exits 2 "$work/bin/tessera" render "$work/bad.gltf" -o "$work/x.exr" "${job[@]}"
says "bad scene: bad.gltf"
[ ! -e "$work/x.exr" ] || fail "an image of a bad scene was written"
exits 0 farm submit "$work/good.gltf" "${job[@]}" --wait
say "a scene the worker finds faulty gives 2 in render, submit --wait and watch"
kill_worker judge

# A unit that crashes its renderer each time, together with the units that run beside it. Three failures of
# this unit pause the job, on one worker or on four; the other units have no failure.
threads=4
for names in "p1" "p1 p2 p3 p4"; do
  count=$(wc -w <<<"$names")
  for name in $names; do
    worker_program=tessera-worker-faults start_worker "$name" --fault-crash-on "$poisoned" --unit-log "$work/units-$count-$name.log"
  done
  id=$(farm submit "$scenes/lit_square.gltf" "${job[@]}" --name "poison")
  exits 1 farm watch "$id" --json
  farm status "$id" --json >"$work/status.json"
  equal "the poisoned job is paused by failures" \
    "$(json "$work/status.json" '[d["state"], d["paused_by"], len(d["failed_attempts"])]')" "paused failures 3"
  reason=$(json "$work/status.json" 'd["reason"]')
  equal "$count worker(s): the reason names three failures" \
    "$(grep -o 'renderer process died: killed by SIGSEGV' <<<"$reason" | wc -l)" 3
  equal "$count worker(s): no unit but the poisoned one failed" \
    "$(grep -h '^failed' "$work/units-$count-"*.log | cut -d' ' -f3-5 | sort | uniq -c | xargs)" \
    "3 ${poisoned//:/ }"
  echo "# $(head -c 300 <<<"$reason")"
  for name in $names; do kill_worker "$name"; done
done
threads=1

# A unit that hangs, here because its renderer is stopped, fails after --unit-timeout. The renderer is
# replaced, and the image is that of an undisturbed run.
job=(--size 64x64 --spp 200 --tile-size 16)
# Stops the renderer while the log has a unit that has started and not ended. The renderer may have rendered
# it already; then the next unit hangs.
stop_at_a_unit() {
  local renderer open
  renderer=$(children_of "${worker_pid[sleeper]}")
  [ -n "$renderer" ] && kill -STOP "$renderer" || return 1
  open=$(awk '$1 == "started" { open = 1 } $1 == "finished" || $1 == "failed" { open = 0 } END { print open }' \
    "$work/units-sleeper.log")
  [ "$open" = 1 ] && return
  kill -CONT "$renderer"
  return 1
}
start_worker sleeper --unit-timeout 10 --unit-log "$work/units-sleeper.log" --log-level debug
id=$(farm submit "$scenes/lit_square.gltf" "${job[@]}" --name hung)
wait_until 60 "its renderer is stopped at a unit" stop_at_a_unit
farm watch "$id" --json </dev/null >"$work/watch.log" || fail "a unit that hung once failed the job"
grep '^failed' "$work/units-sleeper.log" >"$work/failed" || fail "no unit failed"
equal "one unit failed" "$(wc -l <"$work/failed")" 1
hung=$(cut -d' ' -f3-5 "$work/failed")
equal "it had hung" "$(cut -d' ' -f6- "$work/failed")" "timed out after 10 s; renderer killed"
grep -q "tessera-worker warning: unit .* ${hung} timed out; killing the renderer" "$work/worker-sleeper.log" ||
  fail "the log does not report that unit $hung timed out"
grep -q "tessera-worker debug: unit .* ${hung} rendered in" "$work/worker-sleeper.log" ||
  fail "the log at level debug has no lines about units"
farm report "$id" --json >"$work/hung.json"
kill_worker sleeper
start_worker hush --log-level error
id=$(farm submit "$scenes/lit_square.gltf" "${job[@]}" --name unhung)
farm watch "$id" --json </dev/null >"$work/watch.log"
farm report "$id" --json >"$work/unhung.json"
kill_worker hush
equal "with a unit that hung the pixels are the same" \
  "$(pixels "$work/hung.json")" "$(pixels "$work/unhung.json")"
equal "a worker at --log-level error is silent" "$(cat "$work/worker-hush.log")" ""
exits 2 tessera-worker --server "$socket" --log-level loud
says "--log-level"

# The shipped worker has no options that inject faults.
for fault in "--fault-crash-on 1:1:1" --fault-forge "--fault-corrupt-every 3" --fault-deliver-twice; do
  # shellcheck disable=SC2086
  exits 2 tessera-worker --server "$socket" $fault
  says "${fault%% *}"
done
say "the shipped worker rejects the options that inject faults"

# A worker that is killed repeatedly is a loss each time, never a failure.
job=(--size 128x128 --spp 600 --tile-size 32)
id=$(farm submit "$scenes/lit_square.gltf" "${job[@]}" --name losses)
for attempt in $(seq 10); do
  start_worker "mortal$attempt" --id mortal --unit-log "$work/units-mortal$attempt.log"
  wait_until 60 "it holds leases" grep -q "^started" "$work/units-mortal$attempt.log"
  kill_worker "mortal$attempt"
done
start_worker survivor --id mortal
farm watch "$id" --json </dev/null >"$work/watch.log" || fail "ten kills failed the job"
say "a worker killed ten times did not fail the job"
