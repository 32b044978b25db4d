#!/usr/bin/env bash
# Shows that the checks of object files (hard case 78) fail where they must: for objects with what
# they forbid, without objects, for files that are none, and without the tools that they run.
# Usage: object_checks_test.sh DIRECTORY RECIPROCAL INVERSE_ROOT LIBM AVX512, where DIRECTORY has the
# scripts and the others are the objects of forbidden/.
set -euo pipefail
scripts=$1 reciprocal=$2 inverse_root=$3 libm=$4 avx512=$5
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# fails TEXT COMMAND...: the command fails and prints TEXT.
fails() {
  local text=$1
  shift
  if "$@" >"$work/output" 2>&1; then
    echo "this passes, but must fail: $*"
    exit 1
  fi
  grep -qF -e "$text" "$work/output" || { echo "no '$text' from $*:"; cat "$work/output"; exit 1; }
}

fails "rcpss" "$scripts/exact_reciprocals.sh" "$reciprocal"
fails "rsqrt14ps" "$scripts/exact_reciprocals.sh" "$inverse_root"
fails "sinf" "$scripts/no_libm.sh" "$reciprocal" "$libm"
fails "double_everywhere" "$scripts/baseline_isa.sh" "$avx512"
# What is allowed passes, so the failures above are not those of every object.
"$scripts/no_libm.sh" "$reciprocal" >/dev/null

for script in exact_reciprocals no_libm baseline_isa; do
  fails "no object was given" "$scripts/$script.sh"
  fails "" "$scripts/$script.sh" "$work/missing.o"
  echo "text" >"$work/text.o"
  fails "" "$scripts/$script.sh" "$reciprocal" "$work/text.o"
done
fails "no square root" "$scripts/exact_reciprocals.sh" "$libm"
fails "no AVX-512 kernel" "$scripts/baseline_isa.sh" "$libm"

# Every other tool of theirs is there.
mkdir "$work/bin"
for tool in awk bash cat cut env grep head mktemp rm sh tr; do ln -s "$(command -v "$tool")" "$work/bin/$tool"; done
fails "objdump is not installed" env PATH="$work/bin" "$scripts/exact_reciprocals.sh" "$libm"
fails "objdump is not installed" env PATH="$work/bin" "$scripts/baseline_isa.sh" "$avx512"
fails "nm is not installed" env PATH="$work/bin" "$scripts/no_libm.sh" "$reciprocal"
echo "the checks of objects find what they must"
