#!/usr/bin/env bash
# Does what --error claims hold? Many seeds of a battery of small scenes, the rare events among them.
#
#   tests/bench/coverage.sh [--seeds N (400)] [--bin DIR (build/dev/bin)] [--jobs N (cores)]
#                           [--results FILE.jsonl] [--out FILE.md] [SCENE…]
#
# With --results every run is kept in FILE as it comes, and those that it has are not run again.
#
# At nominal 95 % a scene of 400 seeds fails with more than 31 claims that do not hold (1 % false
# alarms); other counts of seeds are judged by the same binomial tail. A failing scene is run once
# more with new seeds, and both runs count. Statuses UNCERTAIN and CAPPED are no claims; on well
# behaved scenes they may come up in 1 % of the seeds, and the median of bound over true error may
# be 1.5.
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
exec python3 "$root/tests/bench/coverage/run.py" "$@"
