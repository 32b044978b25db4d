#!/usr/bin/env bash
# From a clean clone to a picture: installs what is missing, builds Release, renders on a farm of
# two workers on this machine, and says where the result is.
#
#   deploy/quickstart.sh [SCENE.gltf|SCENE.glb|NAME] [render options]
#
# Without a scene: a box of our own with a glass ball. NAME is one of tests/scenes: `course` is the
# showpiece. Files go to the current folder as SCENE.exr, SCENE.png and SCENE.report.json. Render
# options: `tessera render --help`. TESSERA_PRESET names another preset of CMakePresets.json than release.
set -euo pipefail
source_folder=$(cd "$(dirname "$0")/.." && pwd)

scene=quickstart
options=("$@")
if [ "$#" -gt 0 ] && [ "${1#-}" = "$1" ]; then
  scene=$1
  options=("${@:2}")
fi
if [ ! -f "$scene" ] && [ -f "$source_folder/tests/scenes/$scene.gltf" ]; then
  case ${#options[@]}$scene in
    0quickstart) options=(--size 640x480 --spp 128) ;;
    0*) options=(--size 640x360 --spp 64) ;;
  esac
  scene=$source_folder/tests/scenes/$scene.gltf
fi
[ -f "$scene" ] || { echo "quickstart: no such scene: $scene" >&2; exit 2; }

"$source_folder/deploy/install-deps.sh" --build
preset=${TESSERA_PRESET:-release}
build=$source_folder/build/$preset
cmake -S "$source_folder" --preset "$preset" -B "$build" >/dev/null
cmake --build "$build" --target tessera tessera-server tessera-worker

name=$(basename "${scene%.*}")
PATH=$build/bin:$PATH
result=$(tessera render "$scene" --output "$PWD/$name.exr" --report "$PWD/$name.report.json" \
  --workers 2 --force "${options[@]}")
oiiotool "$PWD/$name.exr" --ch R,G,B --clamp:min=0:max=1 --colorconvert linear sRGB -d uint8 \
  -o "$PWD/$name.png"

echo "image:   $PWD/$name.exr"
echo "as PNG:  $PWD/$name.png"
echo "result:  ${result##*/}"  # size, samples, estimated error, seconds
