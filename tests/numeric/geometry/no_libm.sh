#!/bin/sh
# Fails if an object of the pixel path calls libm: its results differ between machines ("The
# bits", rule 4). Usage: no_libm.sh OBJECT...; objects of other folders are passed over.
set -eu
functions='sin|cos|tan|asin|acos|atan|atan2|sinh|cosh|tanh|asinh|acosh|atanh|exp|exp2|exp10|expm1'
functions="$functions|log|log2|log10|log1p|pow|cbrt|hypot|erf|erfc|lgamma|tgamma|fmod|remainder"
functions="$functions|sincos|fma|sqrt|floor|ceil|rint|nearbyint|round|trunc|ldexp|scalbn|frexp|modf"
found=0
checked=0
for object in "$@"; do
  path=${object##*tessera_render.dir/}
  case "${path#./}" in
    math/* | sampling/* | geometry/* | accel/* | shading/* | light/* | render/*) ;;
    *) continue ;;
  esac
  checked=$((checked + 1))
  names=$(nm --undefined-only --format=posix "$object" | cut -d' ' -f1 |
    grep -E "^(__)?($functions)(f|l|f32|f64)?(_finite)?$" || true)
  if [ -n "$names" ]; then
    echo "$object: $(echo "$names" | tr '\n' ' ')"
    found=1
  fi
done
[ "$checked" -gt 0 ] || { echo "no object of the pixel path was given"; exit 1; }
echo "$checked objects checked"
exit $found
