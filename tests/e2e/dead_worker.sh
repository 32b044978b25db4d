#!/usr/bin/env bash
# A dead worker is noticed within 6 s, and its units run elsewhere within 1 s more.
exec "$(dirname "$0")/chaos.sh" --kinds kill_worker --rounds 1
