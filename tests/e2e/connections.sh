#!/usr/bin/env bash
# Connections with certificates that break: streams resume soon, and a server that is flooded with
# silent connections continues.
. "$(dirname "$0")/farm.sh"
tools=$(cd "$(dirname "$0")" && pwd)/connections
certs=$work/certs
# Streams resume within 5 s on an idle machine; without the pings and the steady attempts that this
# tests it takes 25 to 35 s, or for ever.
limit_ms=12000

tessera-server init-certs "$certs" --host 127.0.0.1 2>"$work/err"
for who in client:ann worker:rack; do
  tessera-server issue-cert "$certs" --role "${who%:*}" --name "${who#*:}" >>"$work/issued"
done

ann() { tessera "$1" --server "$address" --certs "$certs/client-ann" "${@:2}"; }
now_ms() { date +%s%3N; }
joins() { grep -c "connected: one" "$work/server.log"; }
has_joined_again() { [ "$(joins)" -gt "$1" ]; }
has_lines() { [ "$(wc -l <"$1")" -gt "$2" ]; }
# within WHAT SINCE: fails if more than $limit_ms have passed since the time SINCE.
within() {
  local took=$(($(now_ms) - $2))
  [ "$took" -le "$limit_ms" ] || fail "$1 took $took ms"
  say "$1 after $took ms"
}

start_secure_server 127.0.0.1:0
"$tools/proxy.py" "${address##*:}" >"$work/proxy.port" 2>"$work/proxy.log" &
worker_pid[proxy]=$!
wait_until 20 "the proxy listens" test -s "$work/proxy.port"
through=127.0.0.1:$(cat "$work/proxy.port")
tessera-server tokens create --store "$work/store" --max-joins 1 --out "$work/join.token"

# A paused job, so that nothing is sent but what the test causes.
job=$(ann submit "$scenes/lit_square.gltf" --size 48x32 --spp 8 --tile-size 16)
ann pause "$job" >/dev/null
tessera-worker --server "$through" --certs "$certs/worker-rack" --threads 1 --name one \
  --cache "$work/cache-one" --token "$work/join.token" --log-level debug >>"$work/worker-one.log" 2>&1 &
worker_pid[one]=$!
wait_until 60 "the worker is connected" grep -q "connected: one" "$work/server.log"
tessera events --follow --json --server "$through" --certs "$certs/client-ann" \
  >"$work/events" 2>"$work/events.log" &
worker_pid[events]=$!
wait_until 30 "events arrive" has_lines "$work/events" 0

# Half-open connections.
sleep 2
seen=$(joins)
lines=$(wc -l <"$work/events")
kill -USR1 "${worker_pid[proxy]}"
since=$(now_ms)
ann resume "$job" >/dev/null # an event that the abandoned stream does not deliver
wait_until 60 "the worker has left its half-open connection" has_joined_again "$seen"
within "the worker left a half-open connection" "$since"
wait_until 60 "the client has left its half-open connection" has_lines "$work/events" "$lines"
within "a stream of events left a half-open connection" "$since"
ann watch "$job" >/dev/null
say "the job renders afterwards"

# A restart of the server, with a job that is far from its end.
job=$(ann submit "$scenes/lit_square.gltf" --size 48x32 --spp 1048576 --tile-size 16)
ann pause "$job" >/dev/null
tessera watch "$job" --server "$address" --certs "$certs/client-ann" >"$work/watch" 2>&1 &
worker_pid[watch]=$!
sleep 1
kill_server
sleep 2
seen=$(joins)
start_secure_server "$address"
since=$(now_ms)
ann cancel "$job" >/dev/null
wait_until 60 "watch has followed the job to its end" gone "${worker_pid[watch]}"
within "watch followed a restarted server" "$since"
wait_until 60 "the worker has come back" has_joined_again "$seen"
within "the worker followed a restarted server" "$since"

# Silent connections, more than the server may have descriptors.
kill_server
(
  ulimit -n 256
  exec tessera-server --listen "$address" --store "$work/store" --certs "$certs" --log-level debug \
    >"$work/address" 2>>"$work/server.log"
) &
server_pid=$!
wait_until 60 "the server listens again" grep -q "$address" "$work/address"
wait_until 60 "the worker is back" ann list
python3 - "$address" <<'PYTHON' &
import socket, sys, time
host, port = sys.argv[1].split(":")
ends = []
for _ in range(600):
    try:
        ends.append(socket.create_connection((host, int(port)), timeout=2))
    except OSError:
        pass
time.sleep(300)
PYTHON
worker_pid[flood]=$!
wait_until 60 "connections are refused" grep -q "file descriptors" "$work/server.log"
used=$(find "/proc/$server_pid/fd" -mindepth 1 | wc -l)
[ "$used" -le 140 ] || fail "$used descriptors are in use: none are kept for files"
kill -KILL "${worker_pid[flood]}"
image=$work/flooded.exr
job=$(ann submit "$scenes/lit_square.gltf" --size 48x32 --spp 8 --tile-size 16)
ann watch "$job" >/dev/null
ann fetch "$job" -o "$image" >/dev/null
gone "$server_pid" && fail "the server has ended"
say "a server that is out of descriptors refuses connections, continues and recovers"
