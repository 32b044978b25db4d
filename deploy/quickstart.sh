#!/usr/bin/env bash
# Builds a clone and renders an image: installs missing packages, builds the release preset, renders with
# two workers on this machine, and prints the paths of the results.
#
#   deploy/quickstart.sh [SCENE.gltf|SCENE.glb|NAME] [render options]
#
# NAME is a scene of tests/scenes (default: quickstart, a box with a glass ball; `course` shows every
# feature). Writes SCENE.exr, SCENE.png and SCENE.report.json to the current directory. Render options:
# `tessera render --help`. TESSERA_PRESET selects another preset of CMakePresets.json.
set -euo pipefail
source_dir=$(cd "$(dirname "$0")/.." && pwd)

scene=quickstart
options=("$@")
if [ "$#" -gt 0 ] && [ "${1#-}" = "$1" ]; then
  scene=$1
  options=("${@:2}")
fi
if [ ! -f "$scene" ] && [ -f "$source_dir/tests/scenes/$scene.gltf" ]; then
  case ${#options[@]}$scene in
    0quickstart) options=(--size 640x480 --spp 64 --guiding --denoise) ;;
    0*) options=(--size 640x360 --spp 64 --denoise) ;;
  esac
  scene=$source_dir/tests/scenes/$scene.gltf
fi
[ -f "$scene" ] || { echo "quickstart: scene not found: $scene" >&2; exit 2; }

"$source_dir/deploy/install-deps.sh" --build
preset=${TESSERA_PRESET:-release}
build=$source_dir/build/$preset
(cd "$source_dir" && cmake --preset "$preset" >/dev/null &&
  cmake --build --preset "$preset" --target tessera tessera-server tessera-worker)

name=$(basename "${scene%.*}")
PATH=$build/bin:$PATH
store=$(mktemp -d)  # keeps the samples for the second image
trap 'rm -rf "$store"' EXIT
render() { tessera render "$scene" --store "$store" --workers 2 --force "${options[@]}" "$@"; }
result=$(render --output "$PWD/$name.exr" --report "$PWD/$name.report.json")
render --output "$PWD/$name.png" >/dev/null

echo "image:   $PWD/$name.exr"
echo "PNG:     $PWD/$name.png"
echo "result:  ${result##*/}"  # size, samples, estimated error, seconds
