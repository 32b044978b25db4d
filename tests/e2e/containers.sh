#!/usr/bin/env bash
# The farm of deploy/containers/compose.yaml: a server and three workers, one of which is killed during a
# job. Containers must not run as root, must be read-only except for their volumes, must be healthy, and
# must exit with 0 on SIGTERM.
#
#   containers.sh            uses an image of the packages of the build under test
#   containers.sh --build    compiles the image localhost/tessera first (many minutes)
#
# The target `containers` runs the second command. Needs podman, podman-compose, cpack, dpkg-dev and file.
. "$(dirname "$0")/farm.sh"
root=$(cd "$(dirname "$0")/../.." && pwd)

for program in podman podman-compose cpack dpkg-shlibdeps file; do
  command -v $program >/dev/null || skip "$program is not installed"
done
. "$(dirname "$0")/containers/engine.sh"
if [ "${1:-}" = --build ]; then
  build_image
else
  need_image
fi
export TESSERA_IMAGE=$image

project=tessera-e2e-$$
export TESSERA_PORT=127.0.0.1:
compose() {
  podman-compose -p "$project" -f "$root/deploy/containers/compose.yaml" "$@" >>"$work/compose.log" 2>&1
}
finish() {
  local status=$?
  if [ "$status" -ne 0 ]; then
    for name in setup server worker; do
      podman logs "${project}_${name}_1" >"$work/container-$name.log" 2>&1 || true
    done
  fi
  # -v also removes the anonymous volumes of the caches, which podman-compose keeps.
  podman rm -fv -t 0 $(podman ps -aq --filter "name=${project}_") >"$work/rm.log" 2>&1 || true
  compose down -v || true
  podman network rm -f "${project}_default" >/dev/null 2>&1 || true
  if (exit "$status"); then cleanup; else cleanup; fi  # cleanup reads the status
}
trap finish EXIT

# client COMMAND…: a client in a container of the farm's network.
client() {
  podman run --rm --no-healthcheck --network "${project}_default" --read-only --tmpfs /tmp --cap-drop all \
    -v "${project}_client-certs:/etc/tessera/client:ro" -v "$scenes:/scenes:ro" -v "$work/maps:/maps:ro" \
    -e TESSERA_SERVER=server:7420 -e TESSERA_CERTS=/etc/tessera/client "$image" tessera "$@" 2>>"$work/client.log"
}
# workers_joined N: N workers are idle or busy.
workers_joined() {
  client workers --json >"$work/workers.json" || return 1
  [ "$(json "$work/workers.json" 'sum(w["state"] in ("idle", "busy") for w in d["workers"])')" = "$1" ]
}
in_container() { podman exec "${project}_$1_1" "${@:2}"; }

size=160x120 spp=256
tessera render "$scenes/same_bits.gltf" -o "$work/alone.exr" --report "$work/alone.json" --size $size \
  --spp $spp --tile-size 16 --workers 1 >/dev/null 2>&1
mkdir "$work/maps"
printf '#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n\200\200\200\200\200\200\200\200' >"$work/maps/grey.hdr"

compose up -d
wait_until 120 "three workers have joined" workers_joined 3
say "compose up: three workers have joined, with certificates and token"

for service in server worker; do
  equal "$service is not root" "$(in_container $service id -u)" 10001
  ! in_container $service touch /usr/local/bin/x 2>/dev/null || fail "$service can write its root"
  podman healthcheck run "${project}_${service}_1" >/dev/null || fail "$service is not healthy"
  say "$service is healthy, on a read-only root"
done
in_container worker healthcheck tessera_worker_connected || fail "the worker is not reported as connected"
! in_container worker healthcheck tessera_worker_no_such_metric 2>/dev/null ||
  fail "healthcheck accepts a metric that does not exist"
! in_container worker test -e /etc/tessera/authority/ca.key || fail "a worker sees the authority's key"

client submit /scenes/lit_square.gltf --environment /maps/grey.hdr --size 16x16 --spp 1 --wait >/dev/null ||
  fail "a Radiance environment map is not rendered"

job=$(client submit /scenes/same_bits.gltf --size $size --spp $spp --tile-size 16)
some_committed() {
  client status "$job" --json >"$work/status.json" || return 1
  [ "$(json "$work/status.json" 'd["progress"]["units_committed"]')" -ge 5 ]
}
wait_until 120 "some units are committed" some_committed
victim=${project}_worker_2
kill -KILL "$(podman inspect -f '{{.State.Pid}}' "$victim")"
client status "$job" --json >"$work/status.json"
[ "$(json "$work/status.json" 'd["state"]')" != done ] || fail "the job was done before the kill"
restarted() { [ "$(podman inspect -f '{{.RestartCount}}' "$victim")" -ge 1 ]; }
wait_until 60 "the killed container is started again" restarted
say "a worker's container is killed during the job and started again"
client watch "$job" --json >"$work/watch.log" || fail "watch: status $?"
client report "$job" --json >"$work/report.json"
equal "pixels equal those of a render without containers" "$(pixels "$work/report.json")" \
  "$(pixels "$work/alone.json")"
[ "$(json "$work/report.json" 'len([w for w in d["workers"] if w["units"] > 0])')" -ge 3 ] ||
  fail "not all workers rendered"

for service in worker server; do
  podman stop -t 60 "${project}_${service}_1" >/dev/null 2>&1
  equal "$service exits with 0 on SIGTERM" \
    "$(podman inspect -f '{{.State.ExitCode}}' "${project}_${service}_1")" 0
done
echo "# image: $(podman image inspect -f '{{.Size}}' "$image" | awk '{printf "%.0f MB", $1 / 1e6}')"
