# Sourced by the end-to-end tests: a private directory, a farm of real processes, and checks.
#
# TESSERA_BIN is the directory of the programs (ctest sets it). Servers listen only on Unix sockets in the
# private directory. Processes that a test starts with these functions are stopped when it ends.
# shellcheck shell=bash
set -euo pipefail

: "${TESSERA_BIN:?folder of tessera, tessera-server and tessera-worker}"
PATH=$TESSERA_BIN:$PATH
scenes=$(cd "$(dirname "${BASH_SOURCE[0]}")/../scenes" && pwd)
work=$(mktemp -d "${TMPDIR:-/tmp}/tessera-e2e.XXXXXX")
socket=unix:$work/server.sock
unset TESSERA_SERVER TESSERA_TOKEN TESSERA_CERTS
export XDG_RUNTIME_DIR=$work/run XDG_CONFIG_HOME=$work/config XDG_CACHE_HOME=$work/cache
mkdir -m 700 "$XDG_RUNTIME_DIR" "$XDG_CONFIG_HOME" "$XDG_CACHE_HOME"
server_pid=
declare -A worker_pid=()
checks=0

cleanup() {
  local status=$? pid
  for pid in ${server_pid:-} "${worker_pid[@]}"; do
    kill -CONT "$pid" 2>/dev/null || true
    kill -KILL "$pid" 2>/dev/null || true
  done
  if [ "$status" -ne 0 ] && [ "$status" -ne 77 ]; then
    echo "--- logs of the failed test" >&2
    tail -n 25 "$work"/*.log >&2 2>/dev/null || true
  fi
  wait 2>/dev/null || true
  [ -n "${KEEP:-}" ] && echo "kept: $work" >&2 || rm -rf "$work"
}
trap cleanup EXIT
trap "exit 143" HUP INT TERM

fail() {
  echo "FAILED: $*" >&2
  exit 1
}

# skip REASON: ends the test; ctest reports it as skipped, and tests/summary.py checks that CI allows it.
skip() {
  echo "SKIPPED: $*"
  exit 77
}

# say TEXT: prints a line about a check that has passed.
say() {
  checks=$((checks + 1))
  echo "ok $checks - $*"
}

# wait_until SECONDS WHAT COMMAND…: runs COMMAND until it succeeds.
wait_until() {
  local limit=$1 what=$2 end
  shift 2
  end=$((SECONDS + limit))
  until "$@"; do
    [ "$SECONDS" -lt "$end" ] || fail "timed out after $limit s: $what"
    sleep 0.05
  done
}

gone() { ! kill -0 "$1" 2>/dev/null; }

# start_server [OPTIONS]: starts a server on $socket with the store $work/store.
start_server() {
  rm -f "$work/server.sock"
  tessera-server --listen "$socket" --store "$work/store" "$@" >>"$work/server.log" 2>&1 &
  server_pid=$!
  wait_until 60 "the server listens" test -S "$work/server.sock"
}

# start_secure_server ADDRESS: starts a server with the certificates in $work/certs and sets $address to
# the address it listens on.
start_secure_server() {
  : >"$work/address"
  tessera-server --listen "$1" --store "$work/store" --certs "$work/certs" --log-level debug \
    >"$work/address" 2>>"$work/server.log" &
  server_pid=$!
  wait_until 60 "the server listens" grep -q : "$work/address"
  address=$(cat "$work/address")
}

kill_server() {
  kill -KILL "$server_pid"
  wait "$server_pid" 2>/dev/null || true
  server_pid=
}

# start_worker NAME [OPTIONS]: starts $worker_program (tessera-worker) with $threads threads (1).
threads=1
worker_program=tessera-worker
start_worker() {
  local name=$1
  shift
  "$worker_program" --server "$socket" --name "$name" --threads "$threads" --cache "$work/cache-$name" "$@" \
    >>"$work/worker-$name.log" 2>&1 &
  worker_pid[$name]=$!
}

kill_worker() {
  kill -KILL "${worker_pid[$1]}"
  wait "${worker_pid[$1]}" 2>/dev/null || true
  unset "worker_pid[$1]"
}

# children_of PID: prints the pids of its child processes.
children_of() {
  grep -ls "^PPid:[[:space:]]*$1\$" /proc/[0-9]*/status 2>/dev/null | cut -d/ -f3 || true
}

# stand_in PROGRAM: creates $work/bin, in which the script on stdin replaces PROGRAM. `tessera render` runs
# the programs in its own directory.
stand_in() {
  local program
  mkdir -p "$work/bin"
  cp "$TESSERA_BIN/tessera" "$work/bin/tessera"
  for program in tessera-server tessera-worker; do
    printf '#!/bin/sh\nexec %s "$@"\n' "$TESSERA_BIN/$program" >"$work/bin/$program"
  done
  cat >"$work/bin/$1"
  chmod +x "$work/bin/"*
}

# farm COMMAND…: runs a client command on this farm.
farm() { tessera "$1" --server "$socket" "${@:2}"; }

# json FILE EXPRESSION: prints a Python expression of the document `d`; lists are separated by spaces.
json() {
  python3 -c '
import json, sys
d = json.load(open(sys.argv[1]))
value = eval(sys.argv[2])
print(*value) if isinstance(value, list) else print(value)' "$1" "$2"
}

pixels() { json "$1" 'd["frames"][0]["pixels_sha256"]'; }

# draw NAME OPTIONS…: renders $scene with the options ${job[@]} to NAME.exr and NAME.json in $work.
draw() {
  local name=$1
  shift
  tessera render "$scene" --output "$work/$name.exr" --report "$work/$name.json" --force \
    "${job[@]}" "$@" >"$work/$name.log" 2>&1 </dev/null || fail "render $name: status $?"
}

# equal WHAT A B
equal() {
  [ "$2" = "$3" ] || fail "$1: '$2' is not '$3'"
  say "$1"
}

# exits CODE COMMAND…: checks that COMMAND exits with CODE; its output goes to $work/out and $work/err.
exits() {
  local want=$1 status=0
  shift
  "$@" >"$work/out" 2>"$work/err" </dev/null || status=$?
  [ "$status" -eq "$want" ] || {
    cat "$work/out" "$work/err" >&2
    fail "exit code $status, not $want: $*"
  }
}

# says TEXT: checks that the command of the last `exits` printed TEXT to stdout or stderr.
says() {
  grep -qF -- "$1" "$work/out" "$work/err" || {
    cat "$work/out" "$work/err" >&2
    fail "missing message: '$1'"
  }
}

# committed JOB: prints the number of units committed so far.
committed() {
  farm status "$1" --json >"$work/status.json" 2>/dev/null || { echo 0; return; }
  json "$work/status.json" 'd["progress"]["units_committed"]'
}

committed_at_least() { [ "$(committed "$1")" -ge "$2" ]; }

# start_interruptible NAME COMMAND…: runs COMMAND in the background with SIGINT enabled, as in a terminal
# (bash makes background jobs ignore it). Output: $work/NAME.out and .err; pid: $started.
start_interruptible() {
  local name=$1
  shift
  python3 -c '
import os, signal, sys
signal.signal(signal.SIGINT, signal.SIG_DFL)
os.execvp(sys.argv[1], sys.argv[1:])' "$@" >"$work/$name.out" 2>"$work/$name.err" </dev/null &
  started=$!
}

# interrupted NAME PID: sends SIGINT and checks that the command ends with 130.
interrupted() {
  local status=0
  kill -INT "$2"
  wait "$2" || status=$?
  [ "$status" -eq 130 ] || {
    cat "$work/$1.err" >&2
    fail "$1: Ctrl-C gave exit code $status, not 130"
  }
}
