#!/usr/bin/env bash
# Renders the pictures of docs/gallery.md into this directory. Needs tessera on the path.
#
#   docs/gallery/render.sh [NAME…]     all pictures, or those with the given names
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
scenes=$here/../../tests/scenes

# picture NAME SCENE OPTION…: renders NAME.jpg if NAME was asked for, or none was.
wanted=" $* "
picture() {
  local name=$1 scene=$2
  shift 2
  [ "$wanted" = "  " ] || [[ $wanted == *" $name "* ]] || return 0
  tessera render "$scenes/$scene.gltf" --output "$here/$name.jpg" --force --denoise "$@"
}

picture lens lens --size 420x210 --spp 1024
picture motion motion --frames 12 --size 420x230 --spp 192
picture panning motion --camera panning --frames 12 --size 420x230 --spp 192
picture textures textures --size 480x208 --spp 64
picture optics optics --size 360x200 --spp 512 --guiding
picture nested nested --size 360x190 --spp 256 --guiding
picture materials materials --size 400x240 --spp 256 --guiding
picture shapes shapes --size 400x240 --spp 256 --guiding
picture planes planes --size 420x236 --spp 192 --background 0.45,0.62,0.9 --clamp 4
picture lamps lamps --size 420x190 --spp 192
picture csg csg --size 400x240 --spp 256 --guiding
picture blobs blobs --size 420x270 --spp 256 --guiding
picture fog fog --size 400x225 --spp 512
picture flame flame --size 420x236 --spp 512
picture underwater underwater --size 420x236 --spp 144 --clamp 3
picture terrain terrain --size 400x225 --spp 64
picture course course --size 640x360 --spp 64
picture spherical screens --camera spherical --size 360x180 --spp 64
picture cylindrical screens --camera cylindrical --size 360x102 --spp 64
picture equidistant screens --camera equidistant --size 180x180 --spp 64
picture equisolid screens --camera equisolid --size 180x180 --spp 64
picture off-axis screens --camera off-axis --size 240x165 --spp 64
picture oblique screens --camera oblique --size 240x190 --spp 64
