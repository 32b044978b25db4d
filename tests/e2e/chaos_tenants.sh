#!/usr/bin/env bash
# Chaos with five tenants; see chaos/__main__.py. Every kind of fault takes effect in the default number of rounds.
exec "$(dirname "$0")/chaos.sh" --tenants "$@"
