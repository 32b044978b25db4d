#!/usr/bin/env bash
# Speed against error: bench on a small scene, with its reference, and with a reference structure.
. "$(dirname "$0")/farm.sh"

mkdir "$work/reference"
tessera render "$scenes/lit_square.gltf" -o "$work/reference/lit_square.exr" \
  --report "$work/reference/lit_square.json" --size 32x24 --spp 1024 --seed 1000003 --tile 16 \
  >"$work/render.log" || fail "render: status $?"

# measure NAME OPTIONS…: leaves NAME.json.
measure() {
  local name=$1
  shift
  tessera bench "$scenes/lit_square.gltf" --reference "$work/reference" --seeds 2 --spp 64,8 --json \
    "$@" >"$work/$name.json" 2>"$work/$name.log" || fail "bench: status $? ($(tail -1 "$work/$name.log"))"
}
measure bench
check_schema <"$work/bench.json" || fail "not what docs/schema says"
rounds='[r["spp"] for r in d["scenes"][0]["rounds"]]'
errors='[r["relmse"]["value"] for r in d["scenes"][0]["rounds"]]'
equal "rounds come in order" "$(json "$work/bench.json" "$rounds")" "8 64"
equal "more samples, less error" \
  "$(json "$work/bench.json" 'd["scenes"][0]["rounds"][1]["relmse"]["high"] < d["scenes"][0]["rounds"][0]["relmse"]["low"]')" True
equal "rendering takes time" "$(json "$work/bench.json" 'd["scenes"][0]["seconds"]["render_cpu"] > 0')" True

# The same seeds give the same pixels in any structure, so the same errors.
measure tree --accelerator kd-tree
equal "errors do not depend on the structure" "$(json "$work/tree.json" "$errors")" \
  "$(json "$work/bench.json" "$errors")"

status=0
tessera bench "$scenes/lit_square.gltf" --reference "$work" 2>"$work/missing.log" || status=$?
equal "without a reference" "$status" 2
grep -q "make a reference by: tessera render" "$work/missing.log" || fail "what to do is not said"
