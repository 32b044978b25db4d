#!/usr/bin/env bash
# tessera bench: speed against error on a small scene, with a reference image and another acceleration structure.
. "$(dirname "$0")/farm.sh"

mkdir "$work/reference"
tessera render "$scenes/lit_square.gltf" -o "$work/reference/lit_square.exr" \
  --report "$work/reference/lit_square.json" --size 32x24 --spp 1024 --seed 1000003 --tile-size 16 \
  >"$work/render.log" || fail "render: status $?"

# measure NAME OPTIONS…: runs the benchmark and writes NAME.json.
measure() {
  local name=$1
  shift
  tessera bench "$scenes/lit_square.gltf" --reference "$work/reference" --seeds 2 --spp 64,8 --json \
    "$@" >"$work/$name.json" 2>"$work/$name.log" || fail "bench: status $? ($(tail -1 "$work/$name.log"))"
}
measure bench
check_schema <"$work/bench.json" || fail "bench.json does not match its schema"
rounds='[r["spp"] for r in d["scenes"][0]["rounds"]]'
errors='[r["relmse"]["value"] for r in d["scenes"][0]["rounds"]]'
equal "rounds come in order" "$(json "$work/bench.json" "$rounds")" "8 64"
equal "more samples, less error" \
  "$(json "$work/bench.json" 'd["scenes"][0]["rounds"][1]["relmse"]["high"] < d["scenes"][0]["rounds"][0]["relmse"]["low"]')" True
equal "rendering takes time" "$(json "$work/bench.json" 'd["scenes"][0]["seconds"]["render_cpu"] > 0')" True

# A reference with no setting at its default. If bench ignored one of them, the error would be large.
mkdir "$work/odd"
cp "$scenes/motion.gltf" "$work/odd.gltf"
tessera render "$scenes/lit_square.gltf" -o "$work/sky.exr" --size 16x8 --spp 64 --background 0.2,0.4,0.8 \
  >"$work/sky.log" || fail "sky: status $?"
render_odd() {
  tessera render "$work/odd.gltf" -o "$work/odd/odd.exr" --report "$work/odd/odd.json" --force --seed 2 \
    --size 40x30 --crop 6,4,24,20 --spp 1024 --max-depth 3 --filter gaussian --filter-width 2 "$@" \
    >"$work/odd.log" || fail "odd reference: status $?"
}
# bench_odd OPTIONS…: writes odd_bench.json.
bench_odd() {
  tessera bench "$work/odd.gltf" --reference "$work/odd" --seeds 2 --spp 16 --json "$@" \
    >"$work/odd_bench.json" 2>"$work/odd_bench.log"
}
odd_error='d["scenes"][0]["rounds"][0]["relmse"]["high"]'
sky=(--environment "$work/sky.exr")
render_odd --frames 6 --fps 12 --background 1,0.5,0.2 --clamp 0.5 \
  "${sky[@]}" --environment-rotation 130 --environment-strength 0.7
bench_odd "${sky[@]}" || fail "bench of an odd reference: status $? ($(tail -1 "$work/odd_bench.log"))"
echo "# relMSE of an odd reference: $(json "$work/odd_bench.json" "$odd_error")"
equal "the reference's settings are taken over" "$(json "$work/odd_bench.json" "$odd_error < 0.02")" True
equal "its seed is not" "$(json "$work/odd_bench.json" 'd["scenes"][0]["seeds_used"]')" "1 3"

# refused WHAT TEXT COMMAND…: checks that COMMAND exits with 2 and prints TEXT.
refused() {
  local what=$1 text=$2 status=0
  shift 2
  "$@" || status=$?
  equal "$what" "$status" 2
  grep -qF -- "$text" "$work/odd_bench.log" || fail "$what: missing message: $text"
}
refused "a missing --environment" "uses the environment map sky.exr; pass that file with --environment" bench_odd
cp "$work/reference/lit_square.exr" "$work/other.exr"
refused "another environment map" "the scene or its environment map has changed" bench_odd --environment "$work/other.exr"
sed -i 's/"scene"/ "scene"/' "$work/odd.gltf"
refused "a scene that has changed" "the scene or its environment map has changed" bench_odd "${sky[@]}"
render_odd --animation none
bench_odd || fail "bench without an environment map: status $?"
refused "an --environment that the reference lacks" "the reference has no environment map" bench_odd "${sky[@]}"

# The same seeds give the same pixels, and so the same errors, with every structure.
measure tree --accelerator kd-tree
equal "errors do not depend on the structure" "$(json "$work/tree.json" "$errors")" \
  "$(json "$work/bench.json" "$errors")"

status=0
tessera bench "$scenes/lit_square.gltf" --reference "$work" 2>"$work/missing.log" || status=$?
equal "without a reference" "$status" 2
grep -q "render a reference with: tessera render" "$work/missing.log" || fail "the message does not say what to do"
