#!/usr/bin/env bash
# Tests the error claims of --error with many seeds on a battery of small scenes, some with rare events.
#
#   tests/bench/coverage.sh [--seeds N (400)] [--bin DIR (build/dev/bin)] [--jobs N (cores)]
#                           [--results FILE.jsonl] [--out FILE.md] [--denoise] [--no-guiding]
#                           [--size WxH (64x64)] [--error-scale FACTOR (1)] [SCENE…]
#
# With --denoise the claims are about denoised frames, and only whether they hold is judged.
# --error-scale multiplies the error target of each scene.
# With --results every run is stored in FILE, and runs that FILE contains are not repeated.
#
# At a nominal 95 %, a scene with 400 seeds fails if more than 31 claims are wrong (1 % false alarms);
# for other numbers of seeds the limit follows from the same binomial tail. A failing scene is run again
# with new seeds, and both runs count. UNCERTAIN and CAPPED are not claims. On well-behaved scenes at
# most 1 % of the seeds may end so, and the median of bound / true error may be at most 1.5.
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
exec python3 "$root/tests/bench/coverage/run.py" "$@"
