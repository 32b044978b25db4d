#!/usr/bin/env bash
# The image does not depend on the acceleration structure, on the instruction set, or on textures that
# are mapped from a file.
#
#   same_bits_structures.sh         every structure on two of the eight scenes
#   same_bits_structures.sh --all   every structure on every scene (target same_bits_all)
. "$(dirname "$0")/farm.sh"

# drawn_with OPTIONS…: renders $scene with these options of the worker and prints the digest of its pixels.
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
mapfile -t structures < <(json "$work/accelerators.json" '[s["name"] for s in d["accelerators"]["structures"] if not s["name"].startswith("wide-bvh")]' |
  tr ' ' '\n')
# structures_of INDEX: the structures that render the scene of that index.
structures_of() {
  local index
  for index in "${!structures[@]}"; do
    [ "$all" = 0 ] && [ $((index % 4)) -ne $(($1 % 4)) ] || echo "${structures[$index]}"
  done
}
all=0
[ "${1:-}" != --all ] || all=1
index=0
for shown in same_bits shapes csg blobs motion textures fog course; do
  scene=$scenes/$shown.gltf
  case $shown in
    same_bits) job=(--size 48x40 --spp 16 --max-depth 4) ;;
    shapes | csg | blobs) job=(--size 48x40 --spp 16 --max-depth 8) ;;
    *) job=(--size 24x20 --spp 8 --max-depth 6 --frames 5) ;;
  esac
  [ -z "${TESSERA_E2E_SMALL:-}" ] || job=(--size 24x20 --spp 8 --max-depth 5)
  draw few --tile-size 16 --workers 1 --threads 1
  few=$(pixels "$work/few.json")
  draw few --tile-size 16 --workers 2 --threads 1
  equal "$shown: two workers" "$(pixels "$work/few.json")" "$few"
  for name in $(structures_of "$index"); do
    draw structure --tile-size 16 --workers 1 --threads 2 --accelerator "$name"
    equal "$shown: $name" "$(pixels "$work/structure.json")" "$few"
    equal "$shown: the report counts visits" \
      "$(json "$work/structure.json" '(d["accelerator"]["name"], d["accelerator"]["primitives_per_ray"] > 0)')" \
      "('$name', True)"
  done
  for isa in avx2 avx512; do
    [ "$isa" = avx2 ] || tessera-worker --version | grep -q "isa $isa" || continue  # lacks it
    equal "$shown: $isa" "$(drawn_with --isa "$isa")" "$few"
  done
  index=$((index + 1))
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
  scene=$work/many_texels.gltf job=(--size 96x96 --spp 8)
  draw texels --tile-size 16 --workers 1 --threads 2
  texels=$(pixels "$work/texels.json")
  equal "texels in a file, in little memory" "$(drawn_with --texture-mb 64 --memory-mb 200)" "$texels"
  (drawn_with --texture-mb 1000 --memory-mb 200) >"$work/too_little.log" 2>&1 && fail "256 MB of texels fitted into 200 MB"
  say "without the file they do not fit"
fi
