#!/usr/bin/env bash
# tessera inspect --validate gives the findings of the Khronos glTF validator: for the cases of
# tests/scenes/maker/invalid.py, whose findings are in validator/verdicts.txt, for the project's scenes, valid
# and malformed, and for mutations of valid documents.
#
# Needs node and npm, which fetches the validator in a few seconds.
. "$(dirname "$0")/farm.sh"
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)

for program in node npm; do
  command -v $program >/dev/null || skip "$program is not installed"
done
cp -r "$here/validator" "$work/check"
(cd "$work/check" && HOME=$HOME timeout 120 npm install --prefer-offline --no-audit --no-fund --silent >"$work/npm.log" 2>&1) ||
  skip "npm cannot get gltf-validator"
compare() { (cd "$work/check" && python3 compare.py "$@"); }

python3 "$root/tests/scenes/make_invalid.py" "$work/cases"
exits 0 compare check "$work/cases"
say "table: $(tail -n 1 "$work/out")"
exits 0 compare both "$root"/tests/scenes/*.gltf "$root"/tests/scenes/malformed/*.gl*
say "scenes: $(tail -n 1 "$work/out")"
python3 "$root/tests/scenes/make_invalid.py" "$work/mutations" 53
exits 0 compare both "$work"/mutations/*.gltf
say "mutations: $(tail -n 1 "$work/out")"
