#!/usr/bin/env bash
# `tessera render` leaves nothing behind, however it ends; with --store it resumes.
. "$(dirname "$0")/farm.sh"

export TMPDIR=$work/tmp
mkdir "$TMPDIR"
scene=$scenes/same_bits.gltf
long=(--size 256x256 --spp 4000 --tile-size 16)

# descendants PID: pids of all its descendants, from /proc.
descendants() {
  python3 -c '
import os, sys
parent = {}
for pid in filter(str.isdigit, os.listdir("/proc")):
    try:
        parent[int(pid)] = int(open(f"/proc/{pid}/stat").read().rsplit(")", 1)[1].split()[1])
    except OSError:
        pass
found = {int(sys.argv[1])}
while True:
    more = {p for p, q in parent.items() if q in found} - found
    if not more:
        break
    found |= more
print(*sorted(found - {int(sys.argv[1])}))' "$1"
}

has_children() { [ "$(descendants "$1" | wc -w)" -ge "$2" ]; }
all_gone() {
  local pid
  for pid in "$@"; do gone "$pid" || return 1; done
}
nothing_left() { [ -z "$(find "$TMPDIR" "$XDG_RUNTIME_DIR" -mindepth 1)" ]; }

for signal in INT KILL; do
  start_interruptible "$signal" tessera render "$scene" -o "$work/never.exr" "${long[@]}" --workers 2
  pid=$started
  # A server, two agents, two renderers.
  wait_until 60 "server, agents and renderers run" has_children "$pid" 5
  sleep 0.5
  children=$(descendants "$pid")
  if [ "$signal" = INT ]; then
    interrupted INT "$pid"
  else
    kill -KILL "$pid"
    wait "$pid" 2>/dev/null || true
  fi
  # shellcheck disable=SC2086
  wait_until 60 "every process of it is gone after SIG$signal" all_gone $children
  wait_until 60 "its private folder is gone after SIG$signal" nothing_left
  [ ! -e "$work/never.exr" ] && [ -z "$(find "$work" -name '*.part')" ] || fail "a file was left behind"
  say "SIG$signal: $(wc -w <<<"$children") processes gone, no folder, no file"
done

# A frame is written as soon as it is finished and is kept if the command is interrupted.
start_interruptible frames tessera render "$scene" -o "$work/clip.exr" --frames 0-7 \
  --size 64x64 --spp 800 --tile-size 16 --workers 1
wait_until 120 "the first frame is there" test -s "$work/clip.0000.exr"
interrupted frames "$started"
[ ! -e "$work/clip.0007.exr" ] || fail "the job was done before it could be interrupted"
exits 0 tessera compare "$work/clip.0000.exr" "$work/clip.0000.exr"
say "a frame is fetched while the next is being rendered"

# A store keeps committed units; the same command finishes the job with the same pixels.
spp=200
[ -z "${TESSERA_E2E_SMALL:-}" ] || spp=80
job=(--size 96x96 --spp "$spp" --tile-size 8 --workers 1 --threads 1)
tessera render "$scene" -o "$work/straight.exr" "${job[@]}" --report "$work/straight.json" \
  >"$work/straight.log" 2>&1
start_interruptible first tessera render "$scene" -o "$work/out.exr" "${job[@]}" --store "$work/store"
pid=$started
journal() {  # one figure of the store's journal, by SQL
  python3 -c '
import sqlite3, sys
try:
    journal = sqlite3.connect(f"file:{sys.argv[1]}/store.db?mode=ro", uri=True)
    print(journal.execute(sys.argv[2]).fetchone()[0])
except sqlite3.Error:
    print(0)' "$work/store" "$1"
}
rows() { journal "select count(*) from units"; }
some_rows() { [ "$(rows)" -ge 40 ]; }
wait_until 60 "some units are committed" some_rows
children=$(descendants "$pid")
kill -KILL "$pid"
wait "$pid" 2>/dev/null || true
# shellcheck disable=SC2086
wait_until 60 "its processes are gone" all_gone $children
before=$(rows)
first_worker=$(journal "select worker from units")
total=$(json "$work/straight.json" 'd["units"]["total"]')
[ "$before" -lt "$total" ] || fail "the job was done before it could be killed"
tessera render "$scene" -o "$work/out.exr" "${job[@]}" --store "$work/store" \
  --report "$work/resumed.json" >"$work/resumed.log" 2>&1 </dev/null || fail "the second run failed"
equal "a resumed render has the same pixels" "$(pixels "$work/resumed.json")" \
  "$(pixels "$work/straight.json")"
equal "no unit was rendered twice" \
  "$(json "$work/resumed.json" 'sum(w["units"] for w in d["workers"])')" "$total"
kept=$(json "$work/resumed.json" "sum(w['units'] for w in d['workers'] if w['id'] == '$first_worker')")
equal "the second run did only the units that were not committed" "$kept" "$before"

# A warning about the scene is printed once and stored in the report.
python3 -c '
import json, sys
scene = json.load(open(sys.argv[1]))
scene["extensionsUsed"] = [*scene.get("extensionsUsed", []), "ACME_glow"]
json.dump(scene, open(sys.argv[2], "w"))' "$scenes/lit_square.gltf" "$work/odd.gltf"
exits 0 tessera render "$work/odd.gltf" -o "$work/odd.exr" --size 16x16 --spp 4 --report "$work/odd.json"
equal "the scene's warnings are said once" "$(grep -c ACME_glow "$work/err")" 1
equal "and are in the report" "$(json "$work/odd.json" 'd["warnings"]')" \
  "odd.gltf: extensionsUsed: ACME_glow is not supported and is ignored"

exits 0 tessera render "$scene" -o "$work/flat.png" --size 16x16 --spp 4 --aov albedo --half
says "flat.png: ignoring --aov and --half, supported only for EXR"

# render waits for a slow server as long as the server runs, and fails at once when it has died.
listen_for=$(
  cat <<'PY'
import socket, sys, time
listener = socket.socket(socket.AF_UNIX)
listener.bind(sys.argv[1].removeprefix("unix:"))
listener.listen()
time.sleep(float(sys.argv[2]))
PY
)
stand_in tessera-server <<EOF
#!/bin/sh
python3 -c '$listen_for' "\$2" 4 || exit
exec $TESSERA_BIN/tessera-server "\$@"
EOF
exits 0 "$work/bin/tessera" render "$scene" -o "$work/late.exr" --size 16x16 --spp 4
say "a server that takes four seconds to answer is waited for"

stand_in tessera-server <<EOF
#!/bin/sh
python3 -c '$listen_for' "\$2" 1
echo 'tessera-server: the disk is gone' >&2
exit 7
EOF
started_at=$(date +%s%N)
exits 3 "$work/bin/tessera" render "$scene" -o "$work/dead.exr" --size 16x16 --spp 4
took_ms=$((($(date +%s%N) - started_at) / 1000000))
says "ended with status 7: tessera-server: the disk is gone"
[ "$took_ms" -lt 25000 ] || fail "render waited $took_ms ms for a dead server"
nothing_left || fail "a directory was left behind"
say "a server that dies ends the wait, with its last words"
