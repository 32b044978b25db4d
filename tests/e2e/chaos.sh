#!/usr/bin/env bash
# Chaos test: farms of real processes under injected faults; see chaos/__main__.py. `--rounds 200` is the soak.
set -euo pipefail
: "${TESSERA_BIN:?folder of tessera, tessera-server and tessera-worker}"
: "${TESSERA_FAULTS:=$TESSERA_BIN/tessera_faults.so}"
export TESSERA_BIN TESSERA_FAULTS PYTHONDONTWRITEBYTECODE=1
unset TESSERA_SERVER TESSERA_TOKEN TESSERA_CERTS
chaos=(python3 "$(dirname "$0")/chaos" "$@")
# Mounts disappear with the namespace.
if [ "$(id -u)" -eq 0 ] && unshare --mount true 2>/dev/null; then exec unshare --mount "${chaos[@]}"; fi
exec "${chaos[@]}"
