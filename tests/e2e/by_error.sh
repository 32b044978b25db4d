#!/usr/bin/env bash
# Jobs with a target error: the passes of a tile depend on its samples alone, so the image and the claim
# about its error depend on neither workers nor crashes.
. "$(dirname "$0")/farm.sh"

size=96x64 error=0.15 loose=0.2
if [ -n "${TESSERA_E2E_SMALL:-}" ]; then size=48x48 error=0.3 loose=0.35; fi
scene=$scenes/same_bits.gltf
job=(--size "$size" --max-depth 5 --frames 12 --seed 7 --tile-size 16)

# The part of the report that must not depend on the farm.
frame='{k: d["frames"][0][k] for k in ("pixels_sha256", "samples", "spp_mean", "status", "estimated")}'

draw reference --error "$error" --workers 1 --threads 1
reference=$(json "$work/reference.json" "$frame")
equal "the bound holds" "$(json "$work/reference.json" 'd["status"]')" CONVERGED
equal "the bound is at most what was asked for" "$(json "$work/reference.json" \
  "d['frames'][0]['estimated']['error_upper95'] <= $error")" True
equal "tiles got different counts" \
  "$(json "$work/reference.json" 'd["frames"][0]["spp_mean"] < d["frames"][0]["spp_max"]')" True
for count in 2 4; do
  [ -z "${TESSERA_E2E_SMALL:-}" ] || [ "$count" = 2 ] || continue
  draw workers --error "$error" --workers "$count" --threads 1
  equal "$count workers" "$(json "$work/workers.json" "$frame")" "$reference"
done

# The coordinator is killed twice during the job, a worker once.
start_server
start_worker a
start_worker b
id=$(farm submit "$scene" "${job[@]}" --error "$error")
for share in 5 15; do
  wait_until 60 "some units are committed" committed_at_least "$id" "$share"
  kill_server
  start_server
done
kill_worker b
start_worker c
exits 0 farm watch "$id" --json
farm report "$id" --json >"$work/report.json"
equal "the same after three crashes" "$(json "$work/report.json" "$frame")" "$reference"
farm status "$id" --json >"$work/status.json"
equal "its certainty is told" "$(json "$work/status.json" 'd["certainty"]')" converged

# A lower target half-way through gives the result of a job that had it from the start.
id=$(farm submit "$scene" "${job[@]}" --error "$loose" --name later)
wait_until 60 "it has begun" committed_at_least "$id" 1
farm pause "$id" >/dev/null
exits 0 farm extend "$id" --error "$error"
exits 2 farm extend "$id" --error 0.4
farm resume "$id" >/dev/null
exits 0 farm watch "$id" --json
farm report "$id" --json >"$work/report.json"
equal "the same when asked for later" "$(json "$work/report.json" "$frame")" "$reference"

# With a reference, the farm's report has the true error of each point of the curve beside the estimate.
id=$(farm submit "$scene" "${job[@]/%7/8}" --spp 64 --reference "$work/reference.exr")
exits 0 farm watch "$id" --json
farm report "$id" --json >"$work/told.json"
farm report "$id" --json --reference "$work/reference.exr" >"$work/compared.json"
curve='[p["error_true"] for p in d["frames"][0]["curve"]]'
equal "every round has a true error, and it falls" "$(json "$work/told.json" \
  "all(e > 0 for e in $curve) and len($curve) > 1 and $curve[0] > $curve[-1]")" True
equal "the last is that of the image" "$(json "$work/told.json" "'%.5g' % $curve[-1]")" \
  "$(json "$work/compared.json" "'%.5g' % d['frames'][0]['true']['error']")"
exits 2 farm submit "$scene" --size 32x32 --reference "$work/reference.exr"
says "the reference is"

# The target needs more samples than --max-spp: files are written, and exit code 4 says that nothing is certified.
exits 4 tessera render "$scene" --output "$work/capped.exr" --report "$work/capped.json" \
  --size 48x48 --max-depth 5 --seed 8 --tile-size 64 --error 0.001 --max-spp 36 --workers 2 --threads 1
says CAPPED
says --max-spp
[ -s "$work/capped.exr" ] || fail "a capped job wrote no image"
equal "no pixel has more than --max-spp" "$(json "$work/capped.json" 'd["frames"][0]["spp_max"]')" 36
exits 2 tessera render "$scene" --error 0.1 --spp 64
exits 2 tessera render "$scene" --max-spp 64
exits 2 tessera render "$scene" --error 0
say "exit codes"
