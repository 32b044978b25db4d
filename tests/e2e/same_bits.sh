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
job=(--size "$size" --spp 80 --max-depth 5 --frames 12)

# draw NAME OPTIONS…: renders $scene to NAME.exr and NAME.json.
seed=7
scene=same_bits
draw() {
  local name=$1
  shift
  tessera render "$scenes/$scene.gltf" --output "$work/$name.exr" --report "$work/$name.json" --force \
    --seed "$seed" "${job[@]}" "$@" >"$work/$name.log" 2>&1 </dev/null || fail "render $name: status $?"
}

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
  id=$(farm submit "$scenes/$scene.gltf" --tile-size 16 --seed "$seed" "${job[@]}")
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

seed=8 draw seed --tile-size 16 --workers 2 --threads 1
[ "$(pixels "$work/seed.json")" != "$reference" ] || fail "another seed gave the same pixels"
say "another seed gives other pixels"

# The programs of the other compiler, if TESSERA_OTHER_BIN is set.
if [ -n "${TESSERA_OTHER_BIN:-}" ]; then
  PATH=$TESSERA_OTHER_BIN:$PATH draw compiler --tile-size 16 --workers 2 --threads 1
  equal "another compiler" "$(pixels "$work/compiler.json")" "$reference"
else
  echo "# no other compiler's programs (TESSERA_OTHER_BIN): the asan stage of .ci/run compares them"
fi

# Every acceleration structure, in a worker that is told to use it; both instruction sets.
drawn_with() {
  stand_in tessera-worker <<EOF
#!/bin/sh
[ "\$1" = inspect ] && exec $TESSERA_BIN/tessera-worker "\$@"
exec $TESSERA_BIN/tessera-worker "\$@" $*
EOF
  PATH=$work/bin:$PATH draw structure --tile-size 16 --workers 1 --threads 2
  pixels "$work/structure.json"
}
tessera inspect "$scenes/lit_square.gltf" --accelerators --json >"$work/accelerators.json"
structures=$(json "$work/accelerators.json" '[s["name"] for s in d["accelerators"]["structures"] if not s["name"].startswith("wide-bvh")]')
for scene in same_bits shapes csg blobs motion textures fog course; do
  case $scene in
    same_bits) job=(--size 48x40 --spp 16 --max-depth 4) ;;
    shapes | csg | blobs) job=(--size 48x40 --spp 16 --max-depth 8) ;;
    *) job=(--size 24x20 --spp 8 --max-depth 6 --frames 5) ;;
  esac
  [ -z "${TESSERA_E2E_SMALL:-}" ] || job=(--size 24x20 --spp 8 --max-depth 5)
  draw few --tile-size 16 --workers 1 --threads 1
  few=$(pixels "$work/few.json")
  draw few --tile-size 16 --workers 2 --threads 1
  equal "$scene: two workers" "$(pixels "$work/few.json")" "$few"
  for name in $structures; do
    draw structure --tile-size 16 --workers 1 --threads 2 --accelerator "$name"
    equal "$scene: $name" "$(pixels "$work/structure.json")" "$few"
    equal "$scene: the report counts visits" \
      "$(json "$work/structure.json" '(d["accelerator"]["name"], d["accelerator"]["primitives_per_ray"] > 0)')" \
      "('$name', True)"
  done
  for isa in avx2 avx512; do
    [ "$isa" = avx2 ] || tessera-worker --version | grep -q "isa $isa" || continue  # lacks it
    equal "$scene: $isa" "$(drawn_with --isa "$isa")" "$few"
  done
done
json "$work/accelerators.json" 'sum(s[q]["wrong"] for s in d["accelerators"]["structures"] for q in ("closest_hit", "any_hit"))' >"$work/wrong"
equal "rays that structures of inspect answered otherwise" "$(cat "$work/wrong")" 0

# Textures that exceed the renderer's memory are mapped from a file: 256 MB of texels, a limit of 200 MB.
# Not with sanitizers, which need more memory than any limit.
if [ -z "${TESSERA_E2E_SMALL:-}" ]; then
  python3 - "$work/many_texels.gltf" <<'PYTHON'
import base64, json, struct, sys, zlib

def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

def picture(k):
    rows = b"".join(b"\0" + bytes((x * k + y) // 16 % 256 for x in range(16)) * 1024 for y in range(256))
    data = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">2I5B", 4096, 4096, 8, 6, 0, 0, 0))
    return data + chunk(b"IDAT", zlib.compress(rows * 16, 1)) + chunk(b"IEND", b"")

uri = lambda kind, data: f"data:{kind};base64," + base64.b64encode(data).decode()
corners = struct.pack("<20f", *[c for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)) for c in (u, v, 0, u, 1 - v)])
number = lambda count, kind, offset: {"bufferView": 0, "byteOffset": offset, "componentType": 5126,
                                      "count": count, "type": kind}
json.dump({
    "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1, 2, 3]}],
    "nodes": [{"mesh": k, "translation": [k % 2, k // 2, 0]} for k in range(4)],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2,
                                "material": k}]} for k in range(4)],
    "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": k}}} for k in range(4)],
    "textures": [{"source": k} for k in range(4)],
    "images": [{"uri": uri("image/png", picture(3 + k))} for k in range(4)],
    "accessors": [{**number(4, "VEC3", 0), "min": [0, 0, 0], "max": [1, 1, 0]}, number(4, "VEC2", 12),
                  {"bufferView": 1, "componentType": 5121, "count": 6, "type": "SCALAR"}],
    "bufferViews": [{"buffer": 0, "byteLength": 80, "byteStride": 20},
                    {"buffer": 0, "byteOffset": 80, "byteLength": 6}],
    "buffers": [{"byteLength": 86, "uri": uri("application/octet-stream", corners + bytes([0, 1, 2, 0, 2, 3]))}],
}, open(sys.argv[1], "w"))
PYTHON
  scenes=$work scene=many_texels job=(--size 96x96 --spp 8)
  draw texels --tile-size 16 --workers 1 --threads 2
  texels=$(pixels "$work/texels.json")
  equal "texels in a file, in little memory" "$(drawn_with --texture-mb 64 --memory-mb 200)" "$texels"
  (drawn_with --texture-mb 1000 --memory-mb 200) >"$work/too_little.log" 2>&1 && fail "256 MB of texels fitted into 200 MB"
  say "without the file they do not fit"
fi
