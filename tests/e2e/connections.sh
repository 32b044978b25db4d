#!/usr/bin/env bash
# Connections with certificates that break: streams resume soon, and a server that is flooded with
# silent connections continues.
. "$(dirname "$0")/farm.sh"
tools=$(cd "$(dirname "$0")" && pwd)/connections
certs=$work/certs
# Streams resume within 5 s on an idle machine; without the pings and the steady attempts that this
# tests it takes 25 to 35 s, or for ever. On a busy machine the limit grows by the time for which
# processes waited for a CPU meanwhile, up to twice its value.
limit_ms=5000

tessera-server init-certs "$certs" --host 127.0.0.1 2>"$work/err"
for who in client:ann worker:rack; do
  tessera-server issue-cert "$certs" --role "${who%:*}" --name "${who#*:}" >>"$work/issued"
done

ann() { tessera "$1" --server "$address" --certs "$certs/client-ann" "${@:2}"; }
now_ms() { date +%s%3N; }
# stalled_ms: prints for how long processes have waited for a CPU since the machine started.
stalled_ms() {
  awk -F= '/^some/ {printf "%.0f\n", $NF / 1000; is_known = 1} END {exit !is_known}' /proc/pressure/cpu 2>/dev/null ||
    echo 0
}
start_clock() { since=$(now_ms) stalled_since=$(stalled_ms); }
joins() { grep -c "connected: one" "$work/server.log"; }
has_joined_again() { [ "$(joins)" -gt "$1" ]; }
has_lines() { [ "$(wc -l <"$1")" -gt "$2" ]; }
# within WHAT: fails if WHAT has taken too long since start_clock.
within() {
  local took=$(($(now_ms) - since)) stalled=$(($(stalled_ms) - stalled_since))
  [ "$took" -le $((limit_ms + (stalled < limit_ms ? stalled : limit_ms))) ] ||
    fail "$1 took $took ms; for $stalled ms of these, processes waited for a CPU"
  say "$1 after $took ms (processes waited for a CPU for $stalled ms)"
}
# start_proxy NAME [BYTES_PER_SECOND]: sets $through to the address of a proxy of the server.
start_proxy() {
  "$tools/proxy.py" "${address##*:}" "${@:2}" >"$work/$1.port" 2>"$work/$1.log" &
  worker_pid[$1]=$!
  wait_until 20 "the proxy listens" test -s "$work/$1.port"
  through=127.0.0.1:$(cat "$work/$1.port")
}

start_secure_server 127.0.0.1:0
start_proxy proxy
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
start_clock
ann resume "$job" >/dev/null # an event that the abandoned stream does not deliver
wait_until 60 "the worker has left its half-open connection" has_joined_again "$seen"
within "the worker left a half-open connection"
wait_until 60 "the client has left its half-open connection" has_lines "$work/events" "$lines"
within "a stream of events left a half-open connection"
ann watch "$job" >/dev/null
say "the job renders afterwards"

# Downloads that break: half-open connections, and a restart of the server.
image_job=$(ann submit "$scenes/lit_square.gltf" --size 640x480 --spp 8 --name big \
  --aov albedo,normal,position,stderr,denoising) # 4 MB
ann watch "$image_job" >/dev/null
ann fetch "$image_job" -o "$work/whole" >/dev/null
is_partly_fetched() { [ -s "$work/$1/big.exr.part" ]; }
# start_fetch NAME: downloads the image slowly to the directory NAME; returns when a part is there.
start_fetch() {
  start_proxy "slow_$1" 1000000
  tessera fetch "$image_job" --server "$through" --certs "$certs/client-ann" -o "$work/$1" \
    >"$work/fetch_$1.log" 2>&1 &
  worker_pid[$1]=$!
  wait_until 60 "a part of the image has arrived" is_partly_fetched "$1"
}
# fetches WHAT NAME: waits for the download, which nothing slows down from now on.
fetches() {
  kill -USR2 "${worker_pid[slow_$2]}"
  start_clock
  wait_until 60 "$1" gone "${worker_pid[$2]}"
  within "$1"
  [ "$(wc -l <"$work/slow_$2.log")" -ge 2 ] || fail "$1: the download was not interrupted"
  cmp "$work/whole/big.exr" "$work/$2/big.exr" || fail "$1: the image is another one"
}
start_fetch half_open
kill -USR1 "${worker_pid[slow_half_open]}"
fetches "fetch left a half-open connection and was complete" half_open
start_fetch restart
kill_server
sleep 2
start_secure_server "$address"
fetches "fetch was complete after a restart of the server" restart

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
start_clock
ann cancel "$job" >/dev/null
wait_until 60 "watch has followed the job to its end" gone "${worker_pid[watch]}"
within "watch followed a restarted server"
wait_until 60 "the worker has come back" has_joined_again "$seen"
within "the worker followed a restarted server"

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
running=$(ann submit "$scenes/lit_square.gltf" --size 256x256 --spp 256 --tile-size 16)
ann watch "$running" >"$work/watch_flooded" 2>&1 &
worker_pid[watch_flooded]=$!
wait_until 60 "the job is being rendered" grep -qi "job $running is running" "$work/server.log"
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
gone "${worker_pid[watch_flooded]}" && fail "the job ended before the flood"
wait_until 120 "the job has ended" gone "${worker_pid[watch_flooded]}"
wait "${worker_pid[watch_flooded]}" || fail "the job is not done: $(tail -n 1 "$work/watch_flooded")"
gone "${worker_pid[flood]}" && fail "the flood ended before the job"
kill -KILL "${worker_pid[flood]}"
image=$work/flooded.exr
job=$(ann submit "$scenes/lit_square.gltf" --size 48x32 --spp 8 --tile-size 16)
ann watch "$job" >/dev/null
ann fetch "$job" -o "$image" >/dev/null
gone "$server_pid" && fail "the server has ended"
say "a server that is out of descriptors refuses connections, continues and recovers"
