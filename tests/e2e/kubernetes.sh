#!/usr/bin/env bash
# deploy/kubernetes: kustomize builds each overlay, its objects are valid and have no unknown fields under
# the schemas of current API versions, and the options in its manifests exist. With podman, the pods of
# the local overlay run a job, from an image of the packages of the build under test.
#
# Needs kubectl, node and npm, which fetches the schemas in a few seconds.
. "$(dirname "$0")/farm.sh"
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)

for program in kubectl node npm; do
  command -v $program >/dev/null || skip "$program is not installed"
done
mkdir "$work/check"
cp "$here/kubernetes/package.json" "$work/check"
(cd "$work/check" && HOME=$HOME timeout 120 npm install --prefer-offline --no-audit --no-fund --silent >"$work/npm.log" 2>&1) ||
  skip "npm cannot get the schemas"
check() { (cd "$work/check" && node "$here/kubernetes/check_manifests.mjs" "$@"); }

cp -r "$root/deploy/kubernetes" "$work/kubernetes"
certs=$work/kubernetes/local/certs
tessera-server init-certs "$certs" --host tessera-server 2>/dev/null
tessera-server issue-cert "$certs" --role worker --name pods >/dev/null
for overlay in local autoscaled; do
  kubectl kustomize "$work/kubernetes/$overlay" >"$work/$overlay.yaml"
  exits 0 check "$work/$overlay.yaml"
  say "$overlay: $(grep -c ': valid$' "$work/out") objects are valid"
  for kind in StatefulSet Deployment Service NetworkPolicy PodDisruptionBudget; do
    grep -q ": $kind .*valid" "$work/out" || fail "$overlay has no $kind"
  done
done
grep -q ": HorizontalPodAutoscaler .*valid" "$work/out" || fail "autoscaled has no valid HorizontalPodAutoscaler"

sed 's/terminationGracePeriodSeconds/terminationGraceSeconds/' "$work/local.yaml" >"$work/misspelt.yaml"
exits 1 check "$work/misspelt.yaml"
says "unknown: /spec/template/spec/terminationGraceSeconds"
sed 's/replicas: 3/replicas: three/' "$work/local.yaml" >"$work/mistyped.yaml"
exits 1 check "$work/mistyped.yaml"
say "a misspelt field and a wrong type are reported"

for program in server worker; do
  "$TESSERA_BIN/tessera-$program" --help >"$work/help"
  for option in $(grep -o -- "^ *- --[a-z-]*" "$root/deploy/kubernetes/base/$program.yaml" | grep -o -- '--[a-z-]*'); do
    grep -q -- "$option " "$work/help" || fail "tessera-$program has no $option"
  done
  say "tessera-$program has the options of its pods"
done

# A job on the pods of the local overlay.
[ -z "${TESSERA_E2E_SMALL:-}" ] || { echo "# no pod is run: builds with sanitizers are not packaged"; exit 0; }
for program in podman cpack dpkg-shlibdeps file; do
  command -v $program >/dev/null || skip "$program is not installed, so no pod was run"
done
. "$here/containers/engine.sh"
podman pod exists tessera-server && fail "a pod tessera-server exists already: podman pod rm -f tessera-server"
need_image
network=tessera-e2e-$$ secrets=$work/secrets
pods_of() {
  (cd "$work/check" &&
    node "$here/kubernetes/pods_for_podman.mjs" "$work/local.yaml" "$1" "$secrets" "$image") >"$work/pods-$1.yaml"
}
finish() {
  local status=$? part
  for part in worker server; do
    podman logs "$(podman ps -aq --filter "name=tessera-$part" | head -n 1)" >"$work/pod-$part.log" 2>&1 || true
    podman play kube --down "$work/pods-$part.yaml" >/dev/null 2>&1 || true
  done
  podman volume rm -f store-tessera-server-0 >/dev/null 2>&1 || true
  podman network rm -f "$network" >/dev/null 2>&1 || true
  if (exit "$status"); then cleanup; else cleanup; fi  # cleanup reads the status
}
trap finish EXIT

mkdir -p "$secrets"/tessera-{server-certs,worker-certs,join-token}
cp "$certs"/{ca.crt,tls.crt,tls.key} "$secrets/tessera-server-certs"
cp "$certs/worker-pods"/* "$secrets/tessera-worker-certs"
tessera-server issue-cert "$certs" --role client --name ann --out "$secrets/ann" >/dev/null
chown -R 10001 "$secrets"
podman network create "$network" >/dev/null
pods_of server
podman play kube --network "$network" "$work/pods-server.yaml" >"$work/play.log" 2>&1
token() { podman exec tessera-server-server tessera-server tokens create --store /var/lib/tessera/store >"$secrets/tessera-join-token/join.token" 2>/dev/null; }
wait_until 60 "the server's pod creates a token" token
chown 10001 "$secrets/tessera-join-token/join.token"
chmod 600 "$secrets/tessera-join-token/join.token"
pods_of worker
podman play kube --network "$network" "$work/pods-worker.yaml" >"$work/play.log" 2>&1
client() {
  podman run --rm --no-healthcheck --network "$network" -v "$secrets/ann:/certs:ro" -v "$scenes:/scenes:ro" \
    -e TESSERA_SERVER=tessera-server:7420 -e TESSERA_CERTS=/certs "$image" tessera "$@" 2>>"$work/client.log"
}
workers_joined() {
  client workers --json >"$work/workers.json" || return 1
  [ "$(json "$work/workers.json" 'sum(w["state"] in ("idle", "busy") for w in d["workers"])')" = 3 ]
}
wait_until 60 "three worker pods have joined" workers_joined
client submit /scenes/same_bits.gltf --size 64x48 --spp 8 --tile-size 16 --name pods --wait >/dev/null
client report pods --json >"$work/report.json"
tessera render "$scenes/same_bits.gltf" -o "$work/alone.exr" --report "$work/alone.json" --size 64x48 --spp 8 \
  --tile-size 16 >/dev/null 2>&1
equal "pods render the same pixels" "$(pixels "$work/report.json")" "$(pixels "$work/alone.json")"
