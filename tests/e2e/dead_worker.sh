#!/usr/bin/env bash
# The coordinator gives up a killed worker within 6 s. Prints how long its units then wait to be started.
exec "$(dirname "$0")/chaos.sh" --kinds kill_worker --rounds 1
