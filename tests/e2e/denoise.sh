#!/usr/bin/env bash
# --denoise gives the same pixels for any workers and tiles, and those of `tessera denoise`; the raw
# image stays that of a plain render, and the report says what error is left.
. "$(dirname "$0")/farm.sh"

scene=$scenes/same_bits.gltf
small=(--size 150x140 --spp 16)

tessera render "$scene" "${small[@]}" -o "$work/plain.exr" --report "$work/plain.json"
tessera render "$scene" "${small[@]}" -o "$work/one.exr" --report "$work/one.json" --denoise \
  --workers 1 --threads 1
tessera render "$scene" "${small[@]}" -o "$work/three.exr" --report "$work/three.json" --denoise \
  --workers 3 --tile-size 16
tessera render "$scene" "${small[@]}" -o "$work/layers.exr" --aov denoising
tessera denoise "$work/layers.exr" -o "$work/later.exr" --threads 3 >"$work/later.txt"

python3 - "$work" <<'EOF'
import json, sys
frames = {name: json.load(open(f"{sys.argv[1]}/{name}.json"))["frames"][0]
          for name in ("plain", "one", "three")}
plain, one, three = frames["plain"], frames["one"], frames["three"]
denoised = one["denoised"]
assert plain["denoised"] is None
assert denoised["raw_pixels_sha256"] == plain["pixels_sha256"] != one["pixels_sha256"]
assert one["pixels_sha256"] == three["pixels_sha256"]
assert denoised == three["denoised"]
assert 0 < denoised["error_denoised"] < denoised["error_denoised_upper95"]
assert denoised["error_denoised"] < plain["estimated"]["error"]
assert 0 <= denoised["raw_tile_share"] < 1
EOF
say "three workers and one give the same denoised pixels"

tessera compare "$work/later.exr" "$work/one.exr" --fail-above largest=0 >/dev/null
grep -q error_upper95 "$work/later.txt" || fail "tessera denoise does not print the bound"
tessera denoise "$work/layers.exr" -o "$work/later.exr" --force --json >"$work/denoise.json"
check_schema <"$work/denoise.json" || fail "denoise --json does not match its schema"
python3 - "$work" <<'EOF'
import json, sys
read = lambda name: json.load(open(f"{sys.argv[1]}/{name}.json"))["frames"][0]
later, one = read("denoise"), read("one")["denoised"]
assert later["output"] == f"{sys.argv[1]}/later.exr" and later["frame"] == 0
for key in ("error_denoised", "error_denoised_upper95", "n_eff", "raw_tile_share"):
    assert later[key] == one[key], f"{key}: {later[key]}, and {one[key]} in the report"
EOF
say "tessera denoise gives the pixels of --denoise"

if tessera denoise "$work/plain.exr" -o "$work/no.exr" 2>"$work/message.txt"; then
  fail "a file without the layers was denoised"
fi
grep -q -- "--aov denoising" "$work/message.txt" || fail "the message does not say what to do"
if tessera denoise "$work/layers.exr" -o "$work/later.exr" 2>/dev/null; then
  fail "an existing file was overwritten"
fi
[ ! -e "$work/no.exr" ] && [ -z "$(find "$work" -name '*.part')" ] || fail "a file was left"
say "files that cannot be denoised are refused"
