#!/usr/bin/env bash
# Fails if an object calls a function of libm whose result differs between machines
# (docs/explanation/determinism.md); round() is exact everywhere. Fails as well if nm is missing or
# does not read every object. Usage: no_libm.sh OBJECT...
set -euo pipefail
export LC_ALL=C  # grep reads gigabytes of disassembly: bytes, not characters
functions='sin|cos|tan|asin|acos|atan|atan2|sinh|cosh|tanh|asinh|acosh|atanh|exp|exp2|exp10|expm1'
functions="$functions|log|log2|log10|log1p|pow|cbrt|hypot|erf|erfc|lgamma|tgamma|fmod|remainder"
functions="$functions|sincos|fma|sqrt|floor|ceil|rint|nearbyint|trunc|ldexp|scalbn|frexp|modf"
command -v nm >/dev/null || { echo "nm is not installed (package binutils)"; exit 1; }
[ "$#" -gt 0 ] || { echo "no object was given"; exit 1; }
found=0 count=0
for object in "$@"; do
  [ -f "$object" ] || { echo "$object: not found"; exit 1; }
  all=$(nm --format=posix "$object" | wc -l)
  # A stripped object has no symbols to look for.
  [ "$all" -gt 0 ] || { echo "$object: nm found no symbols"; exit 1; }
  symbols=$(nm --undefined-only --format=posix "$object")
  count=$((count + all))
  names=$(cut -d' ' -f1 <<<"$symbols" | grep -E "^(__)?($functions)(f|l|f32|f64)?(_finite)?$" || true)
  if [ -n "$names" ]; then
    echo "$object: $(tr '\n' ' ' <<<"$names")"
    found=1
  fi
done
echo "$# objects with $count symbols checked"
exit $found
