#!/usr/bin/env bash
# Combinations of workers, tile size, threads, instruction set and compiler on thirteen scenes. Nine
# combinations cover every pair of values.
#
#   same_bits_cover.sh         three of the nine on each scene; sanitizer builds: on the first
#   same_bits_cover.sh --all   the nine on each scene, and all 72 on one (target same_bits_all)
#
# TESSERA_OTHER_BIN: programs of the other compiler. Without them, or without AVX-512, the combinations that
# need them are left out; with --all they are counted as skipped.
. "$(dirname "$0")/farm.sh"

# workers tile threads isa compiler
cover=(
  "1 8 1 avx2 own" "1 32 2 avx512 other" "1 64 1 avx512 other"
  "3 8 2 avx512 own" "3 32 1 avx2 other" "3 64 1 avx512 own"
  "8 8 1 avx512 other" "8 32 1 avx512 own" "8 64 2 avx2 own"
)
every=()
for workers in 1 3 8; do
  for tile in 8 32 64; do
    for rest in "1 avx2" "1 avx512" "2 avx2" "2 avx512"; do
      every+=("$workers $tile $rest own" "$workers $tile $rest other")
    done
  done
done

# Programs of a compiler whose workers use an instruction set: $work/COMPILER-ISA.
make_programs() {
  local compiler=$1 isa=$2 folder=$3
  TESSERA_BIN=$folder stand_in tessera-worker <<EOF
#!/bin/sh
[ "\$1" = inspect ] && exec $folder/tessera-worker "\$@"
exec $folder/tessera-worker "\$@" --isa $isa
EOF
  mv "$work/bin" "$work/$compiler-$isa"
}
for isa in avx2 avx512; do
  [ "$isa" = avx2 ] || tessera-worker --version | grep -q "isa $isa" || continue
  make_programs own "$isa" "$TESSERA_BIN"
  [ -z "${TESSERA_OTHER_BIN:-}" ] || make_programs other "$isa" "$TESSERA_OTHER_BIN"
done

# same SCENE COMBINATION…: checks that all combinations give the same pixels.
same() {
  local scene=$1 name expected= got workers tile threads isa compiler
  name=$(basename "$scene" .gltf)
  shift
  for combination in "$@"; do
    read -r workers tile threads isa compiler <<<"$combination"
    if [ ! -d "$work/$compiler-$isa" ]; then
      skipped=$((skipped + 1))
      continue
    fi
    PATH=$work/$compiler-$isa:$PATH tessera render "$scene" --output "$work/out.exr" --force \
      --report "$work/report.json" --size 72x56 --spp 24 --max-depth 5 --frames 3 --workers "$workers" \
      --threads "$threads" --tile-size "$tile" >"$work/render.log" 2>&1 </dev/null || fail "$name: $combination"
    got=$(pixels "$work/report.json")
    [ "$got" = "${expected:=$got}" ] || fail "$name: $combination: $got is not $expected"
    rendered=$((rendered + 1))
  done
  say "$name: $expected"
}

rendered=0
skipped=0
all=0
[ "${1:-}" != --all ] || all=1
# Without programs of the other compiler, the three come from the rest of the nine.
usable=()
for combination in "${cover[@]}"; do
  read -r workers tile threads isa compiler <<<"$combination"
  [ "$all" = 0 ] && [ ! -d "$work/$compiler-$isa" ] || usable+=("$combination")
done
index=0
python3 "$scenes/../bench/coverage/make_scenes.py" "$work/scenes"
for scene in "$work"/scenes/{foliage,checker,caustic,many_lamps,cornell}.gltf \
  "$scenes"/{motion,lens,textures,optics,fog,terrain,lamps,nested}.gltf; do
  chosen=("${usable[@]}" "${usable[@]}")
  [ "$all" = 1 ] || chosen=("${chosen[@]:index % ${#usable[@]}:3}")
  same "$scene" "${chosen[@]::${#usable[@]}}"
  index=$((index + 1))
  [ -z "${TESSERA_E2E_SMALL:-}" ] || break
done
[ "$all" = 0 ] || same "$scenes/same_bits.gltf" "${every[@]}"
echo "$rendered rendered with equal bits, $skipped skipped"
