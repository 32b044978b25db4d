#!/usr/bin/env bash
# Fails if an object approximates 1/x or 1/sqrt(x) by an instruction: the results differ between CPU
# vendors (hard case 78). Fails as well if objdump is missing or does not read every object.
# Usage: exact_reciprocals.sh OBJECT...
set -euo pipefail
export LC_ALL=C  # grep reads gigabytes of disassembly: bytes, not characters
command -v objdump >/dev/null || { echo "objdump is not installed (package binutils)"; exit 1; }
[ "$#" -gt 0 ] || { echo "no object was given"; exit 1; }
disassembly=$(mktemp)
trap 'rm -f "$disassembly"' EXIT
objdump -d --no-show-raw-insn "$@" >"$disassembly"
read_count=$(grep -c ': *file format elf' "$disassembly" || true)
[ "$read_count" -eq "$#" ] || { echo "objdump read $read_count of $# objects"; exit 1; }
grep -qw sqrtss "$disassembly" || grep -qw vsqrtss "$disassembly" ||
  { echo "no square root in $# objects: these are not the objects of the renderer"; exit 1; }
echo "$# objects checked"
if grep -E '\bv?(rcp|rsqrt)(14|28)?[sp][sdh]\b' "$disassembly" | head -n 20 | grep .; then exit 1; fi
