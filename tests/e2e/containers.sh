#!/usr/bin/env bash
# The farm of deploy/compose.yaml, of one image: a server and three workers, one of them killed in
# mid-job. And that the image is what deploy/Containerfile says: not root, nothing written but volumes,
# healthy when it is, gone with 0 on SIGTERM.
#
#   containers.sh            with the image localhost/tessera; skipped where there is none
#   containers.sh --build    makes it first, of TESSERA_BASE_IMAGE (Debian's), for minutes
#
# The named target `containers` does the latter. Needs podman and podman-compose.
. "$(dirname "$0")/farm.sh"
root=$(cd "$(dirname "$0")/../.." && pwd)

for program in podman podman-compose; do
  command -v $program >/dev/null || { echo "SKIPPED: $program is not installed"; exit 0; }
done
. "$(dirname "$0")/containers/engine.sh"
if [ "${1:-}" = --build ]; then
  build_image
else
  has_image || { echo "SKIPPED: no image $image of this version; the target containers makes it"; exit 0; }
fi

project=tessera-e2e-$$
export TESSERA_PORT=127.0.0.1:
compose() { podman-compose -p "$project" -f "$root/deploy/compose.yaml" "$@" >>"$work/compose.log" 2>&1; }
finish() {
  local status=$?
  if [ "$status" -ne 0 ]; then
    for name in setup server worker; do
      podman logs "${project}_${name}_1" >"$work/container-$name.log" 2>&1 || true
    done
  fi
  compose down -v || true
  podman network rm -f "${project}_default" >/dev/null 2>&1 || true
  if (exit "$status"); then cleanup; else cleanup; fi  # which looks at the status
}
trap finish EXIT

# client COMMAND…: a client in a container of the farm's network.
client() {
  podman run --rm --no-healthcheck --network "${project}_default" --read-only --tmpfs /tmp --cap-drop all \
    -v "${project}_client-certs:/etc/tessera/client:ro" -v "$scenes:/scenes:ro" \
    -e TESSERA_SERVER=server:7420 -e TESSERA_CERTS=/etc/tessera/client "$image" tessera "$@" 2>>"$work/client.log"
}
# there N: N workers are idle or busy.
there() {
  client workers --json >"$work/workers.json" || return 1
  [ "$(json "$work/workers.json" 'sum(w["state"] in ("idle", "busy") for w in d["workers"])')" = "$1" ]
}
in_container() { podman exec "${project}_$1_1" "${@:2}"; }

size=160x120 spp=256
tessera render "$scenes/same_bits.gltf" -o "$work/alone.exr" --report "$work/alone.json" --size $size \
  --spp $spp --tile-size 16 --workers 1 >/dev/null 2>&1

compose up -d
wait_until 120 "three workers of the image have joined" there 3
say "compose up: three workers have joined, with certificates and token"

for service in server worker; do
  equal "$service is not root" "$(in_container $service id -u)" 10001
  ! in_container $service touch /usr/local/bin/x 2>/dev/null || fail "$service can write its root"
  podman healthcheck run "${project}_${service}_1" >/dev/null || fail "$service is not healthy"
  say "$service is healthy, on a read-only root"
done
in_container worker healthy tessera_worker_connected || fail "the worker does not say it is connected"
! in_container worker healthy tessera_worker_no_such_metric 2>/dev/null || fail "healthy sees what is not"
! in_container worker test -e /etc/tessera/authority/ca.key || fail "a worker sees the authority's key"

job=$(client submit /scenes/same_bits.gltf --size $size --spp $spp --tile-size 16)
some_committed() {
  client status "$job" --json >"$work/status.json" || return 1
  [ "$(json "$work/status.json" 'd["progress"]["units_committed"]')" -ge 5 ]
}
wait_until 120 "some units are committed" some_committed
client workers --json >"$work/before.json"
victim=${project}_worker_2
kill -KILL "$(podman inspect -f '{{.State.Pid}}' "$victim")"
client status "$job" --json >"$work/status.json"
[ "$(json "$work/status.json" 'd["state"]')" != done ] || fail "the job was over before the kill"
killed() { [ "$(podman inspect -f '{{.RestartCount}}' "$victim")" -ge 1 ]; }
wait_until 60 "the killed container is started again" killed
say "a worker's container is killed in mid-job and started again"
client watch "$job" --json >"$work/watch.log" || fail "watch: status $?"
client report "$job" --json >"$work/report.json"
equal "the pixels of a render without containers" "$(pixels "$work/report.json")" \
  "$(pixels "$work/alone.json")"
[ "$(json "$work/report.json" 'len([w for w in d["workers"] if w["units"] > 0])')" -ge 3 ] ||
  fail "not all of the workers rendered"

for service in worker server; do
  podman stop -t 60 "${project}_${service}_1" >/dev/null 2>&1
  equal "$service ends well on SIGTERM" \
    "$(podman inspect -f '{{.State.ExitCode}}' "${project}_${service}_1")" 0
done
echo "# image: $(podman image inspect -f '{{.Size}}' "$image" | awk '{printf "%.0f MB", $1 / 1e6}')"
