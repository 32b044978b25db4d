#!/usr/bin/env bash
# A store on a full disk: `render` ends with the reason, jobs can be removed, a server starts.
if [ -z "${TESSERA_SMALL_DISK:-}" ]; then
  unshare --user --map-root-user --mount true 2>/dev/null || {
    echo "SKIPPED: no mount namespaces here"
    exit 77
  }
  TESSERA_SMALL_DISK=1 exec unshare --user --map-root-user --mount "$0"
fi
. "$(dirname "$0")/farm.sh"
disk=$work/disk
mkdir "$disk"
mount -t tmpfs -o size=96m tessera "$disk" || skip "cannot mount a tmpfs"
trap 'code=$?; set +e; umount -l "$disk"; (exit "$code"); cleanup' EXIT
free_kib() { df --output=avail -k "$disk" | tail -1; }
fill_disk() { dd if=/dev/zero of="$disk/filler" bs=64k status=none 2>/dev/null || true; }

# An image of 40 MB of sums does not fit beside the filler.
scene=$scenes/lit_square.gltf
large=(--size 2048x1024 --spp 4 --tile-size 64)
dd if=/dev/zero of="$disk/filler" bs=1M count=72 status=none
mkdir -m 700 "$disk/private"
exits 3 timeout 120 tessera render "$scene" "${large[@]}" --store "$disk/private" -o "$work/no.exr"
says "the disk of $disk/private"
says "MB free"
say "a job that does not fit on the disk is refused"
rm -rf "$disk/private" "$disk/filler"

long=(--size 256x256 --spp 4096 --tile-size 16)
mkdir -m 700 "$disk/private"
timeout 120 tessera render "$scene" "${long[@]}" --store "$disk/private" -o "$work/no.exr" 2>"$work/render.log" &
render_pid=$!
wait_until 60 "the render stores results" compgen -G "$disk/private/segments/*/0.seg" >/dev/null
fill_disk
code=0
wait "$render_pid" || code=$?
equal "exit code of a render when the disk fills" "$code" 3
grep -q "store full: the disk of $disk/private.* is full" "$work/render.log" || fail "$(cat "$work/render.log")"
say "render on a full disk ends with the reason"
rm -rf "$disk/private" "$disk/filler"

start_full_server() {
  rm -f "$work/server.sock"
  tessera-server --listen "$socket" --store "$disk/store" --metrics 127.0.0.1:0 >>"$work/server.log" 2>&1 &
  server_pid=$!
  wait_until 60 "the server listens" test -S "$work/server.sock"
}
on() { tessera "$1" --server "$socket" "${@:2}"; }
# probe PATH: prints the status code of the newest server's answer and saves its text.
probe() {
  python3 - "$(grep -o 'http://[^ ]*/metrics' "$work/server.log" | tail -n 1)" "$1" >"$work/probe.txt" <<'PROGRAM'
import sys, urllib.error, urllib.request
direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))
try:
    answer = direct.open(sys.argv[1].replace("/metrics", sys.argv[2]), timeout=20)
except urllib.error.HTTPError as error:
    answer = error
print(answer.status)
print(answer.read().decode())
PROGRAM
  head -n 1 "$work/probe.txt"
}
is_ready() { [ "$(probe /readyz)" -eq "$1" ]; }
is_paused() { on status "$job" --json | grep -q '"state": *"paused"'; }
start_full_server
start_worker one
job=$(on submit "$scene" "${long[@]}")
wait_until 60 "results are stored" test -s "$disk/store/segments/$job/0.seg"
[ -s "$disk/store/ballast" ] || fail "no space is kept back"
fill_disk
wait_until 120 "the job is paused" is_paused
say "the job pauses when the disk is full"
on status "$job" >"$work/status.txt"
grep -q "is full .*free space.*the job resumes when 256 MiB are free" "$work/status.txt" || fail "$(cat "$work/status.txt")"
wait_until 20 "the server is not ready" is_ready 503
grep -q "the disk of the store is full" "$work/probe.txt" || fail "$(cat "$work/probe.txt")"
equal "the server is alive" "$(probe /livez)" 200
probe /metrics >/dev/null
free=$(awk '$1 == "tessera_store_free_bytes" { printf "%d", $2 }' "$work/probe.txt")
[ "$free" -lt 1000000 ] || fail "tessera_store_free_bytes is $free"
exits 3 on submit "$scene" --size 64x64 --spp 16
says "the disk of $disk/store"
says "free space on it, or remove ended jobs"
say "the server refuses jobs and says that it is not ready, but alive"

kill_server
fill_disk
start_full_server
say "a server starts on a full disk"
fill_disk
exits 0 on cancel "$job"
exits 0 on remove "$job"
[ ! -e "$disk/store/segments/$job" ] || fail "the results of the removed job are still there"
[ -s "$disk/store/ballast" ] || [ "$(free_kib)" -gt 1000 ] || fail "remove freed nothing"
! on list --json | grep -q "$job" || fail "the job is still listed"
say "remove frees space on a full disk"
rm "$disk/filler"
job=$(on submit "$scene" --size 32x32 --spp 4 --tile-size 16)
on watch "$job" >/dev/null
say "the farm continues when there is room"
