#!/usr/bin/env bash
# --error with --denoise stops by the bound of the denoised image: the same pixels and claim for any workers
# and after crashes, and fewer samples than without --denoise.
. "$(dirname "$0")/farm.sh"

size=96x64 error=0.08
scene=$scenes/same_bits.gltf
job=(--size "$size" --max-depth 5 --frames 12 --seed 7 --tile-size 16)

# draw NAME OPTIONS…: renders NAME.exr and NAME.json.
draw() {
  local name=$1
  shift
  tessera render "$scene" --output "$work/$name.exr" --report "$work/$name.json" --force \
    "${job[@]}" "$@" >"$work/$name.log" 2>&1 </dev/null || fail "render $name: status $?"
}
frame='{k: d["frames"][0][k] for k in ("pixels_sha256", "samples", "spp_mean", "status", "estimated", "denoised")}'

draw raw --error "$error" --workers 2 --threads 1
draw one --error "$error" --denoise --workers 1 --threads 1
one=$(json "$work/one.json" "$frame")
equal "the claim is made" "$(json "$work/one.json" 'd["status"]')" CONVERGED
equal "the bound of the denoised image is at most what was asked for" "$(json "$work/one.json" \
  "d['frames'][0]['denoised']['error_denoised_upper95'] <= $error < d['frames'][0]['estimated']['error_upper95']")" True
equal "tiles stop one by one" "$(json "$work/one.json" 'len(set(d["frames"][0]["tiles"]["spp"])) > 1')" True
raw=$(json "$work/raw.json" 'd["frames"][0]["samples"]')
equal "fewer samples than the raw image needs" "$(json "$work/one.json" "d['frames'][0]['samples'] < $raw")" True
draw four --error "$error" --denoise --workers 4 --threads 1
equal "4 workers" "$(json "$work/four.json" "$frame")" "$one"

# The target is lowered before the first unit. A worker is killed once, the coordinator twice.
start_server
id=$(farm submit "$scene" "${job[@]}" --error 0.3 --denoise)
farm pause "$id" >/dev/null
exits 0 farm extend "$id" --error "$error"
exits 0 farm resume "$id"
start_worker a
start_worker b
for units in 12 60; do
  wait_until 60 "some units are committed" committed_at_least "$id" "$units"
  kill_server
  start_server
done
kill_worker b
start_worker c
exits 0 farm watch "$id" --json
farm report "$id" --json >"$work/report.json"
equal "the same after three crashes" "$(json "$work/report.json" "$frame")" "$one"

exits 4 tessera render "$scene" --output "$work/capped.exr" --report "$work/capped.json" "${job[@]}" \
  --error 0.001 --max-spp 36 --denoise --workers 2 --threads 1
says CAPPED
equal "no pixel has more than --max-spp" "$(json "$work/capped.json" 'd["frames"][0]["spp_max"]')" 36
