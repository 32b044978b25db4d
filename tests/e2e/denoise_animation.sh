#!/usr/bin/env bash
# An animation with a moving lamp, ball and camera: `tessera denoise --animation` has less error than
# frames denoised alone, the same bits for any threads, and refuses frames that do not follow each other.
. "$(dirname "$0")/farm.sh"

scene=$scenes/moving_lamp.gltf
size=(--size 96x72 --max-depth 5 --camera driving)
last=13

mkdir "$work/raw" "$work/reference"
tessera render "$scene" "${size[@]}" --frames 10-$last --spp 8 --aov denoising,motion -o "$work/raw/" \
  --workers 1 --threads 1 >/dev/null
tessera render "$scene" "${size[@]}" --frames 10-$last --spp 256 --seed 99 -o "$work/reference/" >/dev/null
mapfile -t frames < <(find "$work/raw" -name '*.exr' | sort)
equal "frames" "${#frames[@]}" 4

tessera denoise --animation "${frames[@]}" -o "$work/one" --threads 1 >"$work/one.txt"
tessera denoise --animation "${frames[@]}" -o "$work/three" --threads 3 --json >"$work/three.json"
check_schema <"$work/three.json" || fail "denoise --json does not match its schema"
equal "frames of the JSON" "$(json "$work/three.json" '[f["frame"] for f in d["frames"]]')" "10 11 12 13"
for frame in "${frames[@]}"; do
  cmp "$work/one/$(basename "$frame")" "$work/three/$(basename "$frame")"
done
equal "lines of the table" "$(wc -l <"$work/one.txt")" 5
say "one thread and three give the same files"

# error FILE NAME: relMSE against the reference of frame NAME.
error() {
  tessera compare "$1" "$work/reference/$2" --json >"$work/compare.json"
  json "$work/compare.json" 'd["relmse"]'
}
raw=0 alone=0 animation=0
for frame in "${frames[@]:1:2}"; do
  name=$(basename "$frame")
  tessera denoise "$frame" -o "$work/alone.exr" --force >/dev/null
  raw="$raw + $(error "$frame" "$name")"
  alone="$alone + $(error "$work/alone.exr" "$name")"
  animation="$animation + $(error "$work/one/$name" "$name")"
done
say "relMSE of two frames: raw $raw; alone $alone; with their neighbours $animation"
python3 -c "assert $animation < $alone < $raw"

# The first frame has no previous one, and a single frame no neighbours at all.
tessera denoise --animation "${frames[0]}" -o "$work/single" >/dev/null
tessera denoise "${frames[0]}" -o "$work/first.exr" >/dev/null
tessera compare "$work/single/$(basename "${frames[0]}")" "$work/first.exr" --fail-above largest=0 >/dev/null
say "a single frame is denoised as without --animation"

# refused TEXT ARGUMENTS…: tessera denoise fails with a message that contains TEXT.
refused() {
  local text=$1
  shift
  if tessera denoise "$@" 2>"$work/message.txt"; then fail "not refused: $*"; fi
  grep -q -- "$text" "$work/message.txt" || fail "no '$text' in: $(cat "$work/message.txt")"
}
refused "frame after" --animation "${frames[0]}" "${frames[2]}" -o "$work/none"
refused "aov denoising,motion" --animation "$work/reference/$(basename "${frames[0]}")" -o "$work/none"
refused "already exists" --animation "${frames[@]}" -o "$work/one"
refused "same file" --animation "${frames[@]}" -o "$work/raw" --force
refused "add --animation" "${frames[@]}" -o "$work/none.exr"
[ -z "$(find "$work" -name '*.part')" ] || fail "a file was left"
say "frames that do not follow each other are refused"
