#!/usr/bin/env bash
# `tessera farm up` and `down`: the farm keeps running, restarts killed processes, and resumes its jobs.
. "$(dirname "$0")/farm.sh"
export XDG_DATA_HOME=$work/data TMPDIR=$work
home=$XDG_RUNTIME_DIR/tessera

# processes: prints the pids of the farm's programs, which have its socket in their arguments.
processes() { pgrep -f -- "unix:$home/server.sock" || true; }
server() { pgrep -f -- "--listen unix:$home/server.sock"; }
parent_of() { awk '/^PPid/ {print $2}' "/proc/$1/status"; }
nobody() { [ -z "$(processes)" ]; }
finish() {
  local status=$?
  tessera farm down >/dev/null 2>&1 || true
  cp "$home"/*.log "$work" 2>/dev/null || true
  if (exit "$status"); then cleanup; else cleanup; fi  # which looks at the status
}
trap finish EXIT

exits 3 tessera farm down
says "no farm is running"
exits 0 tessera farm up --workers 2 --threads 1
equal "farm up says where it is" "$(cat "$work/out")" "unix:$home/server.sock"
supervisor=$(parent_of "$(server)")
equal "a server and two workers run" "$(children_of "$supervisor" | wc -l)" 3
equal "in a session of their own" "$(ps -o sid= -p "$supervisor" | tr -d ' ')" "$supervisor"
exits 2 tessera farm up
says "your farm is already running"
equal "both workers have joined" "$(tessera workers --json | grep -c '"state": "idle"')" 2

scene=$scenes/same_bits.gltf
size=(--size 96x64 --tile-size 16) spp=128
tessera render "$scene" -o "$work/alone.exr" --report "$work/alone.json" "${size[@]}" --spp $spp >/dev/null 2>&1
job=$(tessera submit "$scene" "${size[@]}" --spp $spp 2>/dev/null)
begun() {
  tessera status "$job" --json >"$work/status.json"
  [ "$(json "$work/status.json" 'd["progress"]["units_committed"]')" -ge 2 ]
}
wait_until 60 "units are committed" begun

# The server and a worker are killed; both are restarted.
before=$(children_of "$supervisor" | sort)
# shellcheck disable=SC2086
kill -KILL $(head -n 2 <<<"$before") "$(server)" 2>/dev/null || true
back() {
  [ "$(children_of "$supervisor" | wc -l)" -eq 3 ] &&
    [ "$(comm -12 <(children_of "$supervisor" | sort) <(echo "$before") | wc -l)" -le 1 ]
}
wait_until 60 "the killed server and worker are started again" back
say "a killed server and a killed worker are started again"

tessera farm down
nobody || fail "processes are still running: $(processes)"
[ ! -e "$home/server.sock" ] || fail "the socket was not removed"
exits 3 tessera status "$job"
say "farm down leaves no process and no socket"
tessera farm up --workers 1 >/dev/null 2>&1
tessera watch "$job" >/dev/null 2>&1 || fail "the job was not resumed: $?"
tessera report "$job" --json >"$work/report.json"
equal "the job continues after down and up, with the same pixels" "$(pixels "$work/report.json")" "$(pixels "$work/alone.json")"

# The supervisor is killed. Only the socket's file remains, which does not prevent the next start.
kill -KILL "$(parent_of "$(server)")"
wait_until 30 "all die with the supervisor" nobody
exits 0 tessera farm up --workers 1
exits 0 tessera report "$job" --json
say "the farm of a killed supervisor ends, and the next farm has its jobs"
tessera farm down

# Errors give a message and leave nothing behind.
chmod 755 "$home"
exits 2 tessera farm up
says "other users have access"
chmod 700 "$home"
tessera-server --listen "unix:$work/run/held.sock" --store "$XDG_DATA_HOME/tessera/farm" >/dev/null 2>&1 &
server_pid=$!
wait_until 60 "another server holds the store" test -S "$work/run/held.sock"
exits 3 tessera farm up
says "the server ended with status"
nobody || fail "a farm that failed to start left processes"
say "a folder that others can enter, or a store in use, is refused"
