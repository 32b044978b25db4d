#!/usr/bin/env bash
# Damaged pages of the database: the server says what to do, `recover` keeps what can be read, and what is lost is
# rendered again with the same pixels.
. "$(dirname "$0")/farm.sh"
scene=$scenes/lit_square.gltf
job=(--size 64x48 --spp 8 --tile-size 16)
long=(--size 320x240 --spp 256 --tile-size 16)

stop_server() {
  kill -TERM "$server_pid"
  wait "$server_pid" || fail "the server stops with status $?"
  server_pid=
}
# damage TABLE NUMBER: overwrites a page of a table of $work/store; NUMBER counts its pages, and may be negative.
damage() {
  python3 - "$work/store/store.db" "$1" "$2" <<'END'
import sqlite3, sys
path, table, number = sys.argv[1:]
pages = [page for (page,) in sqlite3.connect(path).execute(
    "SELECT pageno FROM dbstat WHERE name=? ORDER BY path", (table,))]
with open(path, "r+b") as database:
    database.seek((pages[int(number)] - 1) * 4096)
    database.write(b"\xee" * 4096)
END
}
state_of() { farm status "$1" --json >"$work/status.json" && json "$work/status.json" 'd["state"]'; }
# same JOB REFERENCE: checks that the job ends with the pixels of $work/REFERENCE.json.
same() {
  exits 0 timeout 120 tessera watch --server "$socket" "$1"
  farm report "$1" --json >"$work/report.json"
  equal "job $1 has the pixels of an undamaged farm" "$(pixels "$work/report.json")" "$(pixels "$work/$2.json")"
}

exits 0 tessera render "$scene" "${job[@]}" --output "$work/alone.exr" --report "$work/alone.json"
exits 0 tessera render "$scene" "${long[@]}" --output "$work/long.exr" --report "$work/long.json"

start_server
start_worker one --id w-one
done_job=$(farm submit "$scene" "${job[@]}" --name "done")
same "$done_job" alone
half=$(farm submit "$scene" "${long[@]}" --name half)
wait_until 60 "results arrive" committed_at_least "$half" 20
kill_worker one
stop_server
exits 2 tessera-server recover "$work/store"
says "store.db is not damaged"
exits 2 tessera-server recover "$work/no-store"

damage bans 0
damage units -1
damage images 0
exits 1 tessera-server --listen "$socket" --store "$work/store"
says "restore a backup, or keep what can be read: \`tessera-server recover $work/store\`"
say "the server does not start and says what to do"
exits 1 tessera-server check "$work/store"

exits 0 tessera-server recover "$work/store"
says "lost rows of bans (0 kept): banned workers may return"
says "lost rows of images (0 kept): frames are rendered again"
says "the damaged database is $work/store/store.db.damaged"
exits 0 tessera-server check "$work/store"
say "the recovered store has no faults"

start_server
grep -qF "job $done_job: frames are lost: 1; rendering them again" "$work/server.log" || fail "the log names the job"
equal "the job that was done runs again" "$(state_of "$done_job")" running
[ "$(committed "$half")" -ge 1 ] || fail "results of readable pages are lost"
exits 2 tessera-server recover "$work/store"
says "is held by another process"
start_worker two --id w-two
same "$done_job" alone
same "$half" long
stop_server
exits 0 tessera-server check "$work/store"
say "the store has no faults after the jobs' end"

damage jobs 0
exits 2 tessera-server recover "$work/store"
says "store.db.damaged is left from an earlier recovery; move it away"
