#!/usr/bin/env bash
# A dead worker is noticed within 6 s; how long its units wait then is printed.
exec "$(dirname "$0")/chaos.sh" --kinds kill_worker --rounds 1
