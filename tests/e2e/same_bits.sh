#!/usr/bin/env bash
# The image depends on the job alone, not on workers, threads, tiles or the compiler.
. "$(dirname "$0")/farm.sh"

# At least 256 units in three passes: 90 tiles, samples 8 + 56 + 16. Sanitizer builds: 27 units.
size=160x144
workers="1 2 7 64"
if [ -n "${TESSERA_E2E_SMALL:-}" ]; then
  size=48x48
  workers="1 2"
fi
job=(--size "$size" --spp 80 --max-depth 5 --frames 12 --seed 7)
scene=$scenes/same_bits.gltf

# idle COUNT: succeeds if COUNT workers are idle.
idle() { [ "$(farm workers --json | grep -c '"state": "idle"')" -eq "$1" ]; }

draw reference --tile-size 16 --workers 1 --threads 1
reference=$(pixels "$work/reference.json")
units=$(json "$work/reference.json" 'd["units"]["total"]')
[ -n "${TESSERA_E2E_SMALL:-}" ] || [ "$units" -ge 256 ] || fail "only $units units"
say "the reference is $reference, of $units units"

for count in $workers; do
  [ "$count" = 1 ] && continue
  rm -rf "$work/store"
  start_server
  for ((worker = 1; worker <= count; ++worker)); do start_worker "of-$count-$worker"; done
  wait_until 240 "$count workers have joined" idle "$count"
  id=$(farm submit "$scene" --tile-size 16 "${job[@]}")
  # Of many workers, a third dies with the units that it holds; others render these again.
  doomed=0
  if [ "$count" -ge 7 ]; then
    doomed=$((count / 3))
    wait_until 60 "some units are committed" committed_at_least "$id" $((units / 20))
    for ((worker = 1; worker <= doomed; ++worker)); do kill_worker "of-$count-$worker"; done
  fi
  farm watch "$id" --json </dev/null >"$work/watch.log" || fail "watch: status $?"
  farm report "$id" --json >"$work/workers.json"
  for ((worker = doomed + 1; worker <= count; ++worker)); do kill_worker "of-$count-$worker"; done
  kill_server
  equal "$count workers, $doomed of them killed" "$(pixels "$work/workers.json")" "$reference"
  busy=$(json "$work/workers.json" 'sum(w["units"] > 0 for w in d["workers"])')
  # Runs of units are so short that not every one of 64 workers gets one.
  [ "$busy" -ge $((count - doomed < 8 ? count - doomed : 8)) ] ||
    fail "only $busy of $count workers committed units"
  say "$busy of $count workers committed units"
done

# What else must not change pixels is tried on a smaller picture of 36 units.
if [ -z "${TESSERA_E2E_SMALL:-}" ]; then
  job[1]=64x48
  draw reference --tile-size 16 --workers 1 --threads 1
  reference=$(pixels "$work/reference.json")
fi
draw threads --tile-size 16 --workers 1 --threads 2
equal "two threads" "$(pixels "$work/threads.json")" "$reference"
for tile in 32 64; do
  draw tile --tile-size "$tile" --workers 2 --threads 1
  equal "tiles of $tile pixels" "$(pixels "$work/tile.json")" "$reference"
done
draw one_tile --tile-size 256 --workers 1 --threads 2
equal "one tile" "$(pixels "$work/one_tile.json")" "$reference"
equal "one tile is one unit a pass" "$(json "$work/one_tile.json" 'd["units"]["total"]')" 3

# A crop has the same pixels as that part of the full frame.
draw crop --tile-size 16 --workers 2 --threads 1 --crop 11,5,30,26
oiiotool "$work/reference.exr" --ch R,G,B,A --cut 30x26+11+5 -o "$work/part.exr"
oiiotool "$work/crop.exr" --ch R,G,B,A --cut 30x26+11+5 -o "$work/cropped.exr"
oiiotool "$work/part.exr" "$work/cropped.exr" --fail 0 --failpercent 0 --hardfail 0 --diff \
  >"$work/crop.log" 2>&1 || fail "a crop differs from that part of the full frame: $(cat "$work/crop.log")"
say "a crop"

# The layer traversal-cost has the same bits for any tiles and workers, and changes no pixel.
draw cost --tile-size 16 --workers 2 --threads 1 --aov traversal-cost
equal "with traversal-cost" "$(pixels "$work/cost.json")" "$reference"
draw whole_cost --tile-size 64 --workers 1 --threads 2 --aov traversal-cost
oiiotool "$work/cost.exr" "$work/whole_cost.exr" --fail 0 --failpercent 0 --hardfail 0 --diff \
  >"$work/cost.log" 2>&1 || fail "tiles or workers changed traversal-cost: $(cat "$work/cost.log")"
equal "rays of both" "$(json "$work/cost.json" 'd["accelerator"]["rays"]')" \
  "$(json "$work/whole_cost.json" 'd["accelerator"]["rays"]')"

# The programs of the other compiler, if TESSERA_OTHER_BIN is set.
if [ -n "${TESSERA_OTHER_BIN:-}" ]; then
  PATH=$TESSERA_OTHER_BIN:$PATH draw compiler --tile-size 16 --workers 2 --threads 1
  equal "another compiler" "$(pixels "$work/compiler.json")" "$reference"
else
  echo "# no other compiler's programs (TESSERA_OTHER_BIN): the asan stage of .ci/run compares them"
fi

job[-1]=8
draw seed --tile-size 16 --workers 2 --threads 1
[ "$(pixels "$work/seed.json")" != "$reference" ] || fail "another seed gave the same pixels"
say "another seed gives other pixels"

# A guided image does not depend on workers, threads or tiles either: every renderer makes the same guide.
# Light through glass is guided; the frame above gains too little.
scene=$scenes/quickstart.gltf
job=(--size 80x72 --spp 16)
draw unguided --tile-size 16 --workers 1 --threads 1
draw guided --tile-size 16 --workers 1 --threads 1 --guiding
guided=$(pixels "$work/guided.json")
[ "$guided" != "$(pixels "$work/unguided.json")" ] || fail "--guiding changed no pixel"
draw guided_workers --tile-size 32 --workers 2 --threads 2 --guiding
equal "a guided image, two workers" "$(pixels "$work/guided_workers.json")" "$guided"
