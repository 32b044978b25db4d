#!/usr/bin/env bash
# Installs missing packages, builds the dev preset and runs every test. Arguments go to ctest:
#
#   tests/run.sh                 all tests
#   tests/run.sh -L unit         tests of one kind: unit, numeric, integration or e2e
#   tests/run.sh -R same_bits    tests by name
#
# Prints at the end how many tests passed, the end of the output of those that failed, and which were skipped
# and why. With TESSERA_STRICT_SKIPS=1, as in .ci/run, a skip that tests/allowed_skips.txt does not list is a
# failure.
set -euo pipefail
cd "$(dirname "$0")/.."

deploy/install-deps.sh
cmake --preset dev
cmake --build --preset dev

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
status=0
# More than twice the cores: end-to-end tests mostly wait.
ctest --preset dev --parallel "$((2 * $(nproc) + 1))" --output-junit "$scratch/report.xml" "$@" </dev/null 2>&1 |
  tee "$scratch/log" || status=$?
echo "tests/run.sh: $(grep -E '^[0-9]+% tests passed' "$scratch/log" || echo 'ctest gave no verdict')"
if [ -f "$scratch/report.xml" ]; then
  strict=()
  [ "${TESSERA_STRICT_SKIPS:-0}" = 0 ] || strict=(--strict)
  tests/summary.py "$scratch/report.xml" "${strict[@]}" || status=1
fi
exit "$status"
