#!/usr/bin/env bash
# Runs all tests of the dev preset several times in a row while a busy loop runs on every core: no test may
# depend on how fast the machine is. Prints a line for each run, and stops at the first that fails.
#
#   tests/repeat.sh [RUNS]    default: 10
#
# Build the preset dev first. The target repeated_tests runs this script.
set -euo pipefail
cd "$(dirname "$0")/.."
runs=${1:-10}

loops=()
trap 'kill "${loops[@]}"' EXIT
for ((core = 0; core < $(nproc); ++core)); do
  while :; do :; done &
  loops+=($!)
done

log=build/dev/repeat.log
for ((run = 1; run <= runs; ++run)); do
  start=$SECONDS
  status=0
  ctest --preset dev --parallel "$((2 * $(nproc) + 1))" >"$log" 2>&1 </dev/null || status=$?
  echo "run $run of $runs: $(grep -E '^[0-9]+% tests passed' "$log" || echo 'no verdict of ctest')," \
    "$((SECONDS - start)) s, load $(cut -d' ' -f1 /proc/loadavg)"
  if [ "$status" -ne 0 ]; then
    sed -n '/tests FAILED/,$p' "$log"
    exit "$status"
  fi
done
