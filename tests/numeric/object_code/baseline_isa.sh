#!/bin/sh
# Fails if a function that is not named for AVX-512 has an AVX-512 instruction (EVEX prefix 0x62):
# the linker may keep that copy of an inline function, and it would crash on a processor with AVX2
# only. See worker/accel/kernels/avx512.h. Usage: baseline_isa.sh OBJECT...
set -eu
command -v objdump >/dev/null || { echo "objdump is not installed"; exit 1; }
[ "$#" -gt 0 ] || { echo "no object was given"; exit 1; }
disassembly=$(mktemp)
trap 'rm -f "$disassembly"' EXIT
# One line per instruction: a wrapped line could begin with the text of a constant that equals 0x62.
objdump -d --insn-width=15 "$@" >"$disassembly"
awk -F'\t' '
  /^[0-9a-f]+ <.*>:$/ { name = $0; sub(/^[0-9a-f]+ </, "", name); allowed = name ~ /[Aa]vx512/ }
  $2 ~ /^62 / { if (allowed) kernels++; else found[name]++ }
  END {
    if (kernels == 0) { print "no AVX-512 kernel was given"; exit 1 }
    for (name in found) { print "AVX-512 in " name; failed = 1 }
    exit failed
  }' "$disassembly"
echo "$# objects checked"
