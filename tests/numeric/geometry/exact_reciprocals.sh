#!/bin/sh
# Fails if an object of the pixel path has an instruction that approximates 1/x or 1/sqrt(x): its
# results differ between makes of processors (hard case 78). Usage: exact_reciprocals.sh OBJECT...
set -eu
[ "$#" -gt 0 ] || { echo "no object was given"; exit 1; }
found=$(objdump -d --no-show-raw-insn "$@" |
  grep -E '\bv?(rcp|rsqrt)(14|28)?[sp][sdh]\b' | head -n 20 || true)
echo "$# objects checked"
[ -z "$found" ] || { echo "$found"; exit 1; }
