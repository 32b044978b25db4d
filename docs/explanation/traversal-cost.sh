#!/usr/bin/env bash
# Renders traversal-cost.jpg and structures-of-stadium.svg of acceleration-structures.md into this
# directory. Needs tessera and oiiotool on the path; takes some minutes.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
scene=$here/../../tests/scenes/stadium.gltf
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# cost NAME: the triangles tested per sample by a structure, 1 to 30,000 on a logarithmic scale.
cost() {
  tessera render "$scene" --output "$work/$1.exr" --size 240x135 --spp 4 --max-depth 1 \
    --aov traversal-cost --accelerator "$1"
  # log(x) = limit of n (x^(1/n) - 1); n = 1024. log(30000) = 10.309
  oiiotool "$work/$1.exr" --ch traversal-cost.primitives --maxc 1 --powc 0.0009765625 --subc 1 \
    --mulc 99.33 --colormap viridis -o "$work/$1.png"
}

cost bvh2
cost grid
oiiotool "$work/bvh2.exr" --ch R,G,B --mulc 0.3 --colorconvert linear sRGB -o "$work/picture.png"
oiiotool "$work/picture.png" "$work/bvh2.png" "$work/grid.png" --mosaic:pad=4 3x1 \
  --compression jpeg:92 -o "$here/traversal-cost.jpg"
tessera inspect "$scene" --plot "$here/structures-of-stadium.svg"
