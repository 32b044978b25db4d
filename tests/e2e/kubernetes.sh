#!/usr/bin/env bash
# deploy/kubernetes: each overlay is put together by kustomize, holds nothing that current schemas do not
# know, names options that the programs have and secrets that it has or the documents tell to make. With
# podman and the image of tests/e2e/containers.sh, the pods of the local overlay run a job.
#
# Needs kubectl, node and npm, which gets the schemas (a few seconds); else it is skipped.
. "$(dirname "$0")/farm.sh"
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)

for program in kubectl node npm; do
  command -v $program >/dev/null || { echo "SKIPPED: $program is not installed"; exit 0; }
done
mkdir "$work/check"
cp "$here/kubernetes/package.json" "$work/check"
(cd "$work/check" && HOME=$HOME timeout 120 npm install --prefer-offline --no-audit --no-fund --silent >"$work/npm.log" 2>&1) ||
  { echo "SKIPPED: npm cannot get the schemas"; exit 0; }
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
grep -q ": HorizontalPodAutoscaler .*valid" "$work/out" || fail "nothing scales the workers"

sed 's/terminationGracePeriodSeconds/terminationGraceSeconds/' "$work/local.yaml" >"$work/misspelt.yaml"
exits 1 check "$work/misspelt.yaml"
says "unknown: /spec/template/spec/terminationGraceSeconds"
sed 's/replicas: 3/replicas: three/' "$work/local.yaml" >"$work/mistyped.yaml"
exits 1 check "$work/mistyped.yaml"
say "a misspelt field and a wrong type are found"

for program in server worker; do
  "$TESSERA_BIN/tessera-$program" --help >"$work/help"
  for option in $(grep -o -- "^ *- --[a-z-]*" "$root/deploy/kubernetes/base/$program.yaml" | grep -o -- '--[a-z-]*'); do
    grep -q -- "$option " "$work/help" || fail "tessera-$program has no $option"
  done
  say "tessera-$program has the options of its pods"
done

# The pods of the local overlay, where there is podman and the image: a job runs on them.
command -v podman >/dev/null || { echo "# podman is not installed: no pod was run"; exit 0; }
. "$here/containers/engine.sh"
has_image || { echo "# no image $image of this version: no pod was run"; exit 0; }
network=tessera-e2e-$$ secrets=$work/secrets
pods_of() { (cd "$work/check" && node "$here/kubernetes/pods_for_podman.mjs" "$work/local.yaml" "$1" "$secrets") >"$work/pods-$1.yaml"; }
finish() {
  local status=$? part
  for part in worker server; do
    podman logs "$(podman ps -aq --filter "name=tessera-$part" | head -n 1)" >"$work/pod-$part.log" 2>&1 || true
    podman play kube --down "$work/pods-$part.yaml" >/dev/null 2>&1 || true
  done
  podman volume rm -f store-tessera-server-0 >/dev/null 2>&1 || true
  podman network rm -f "$network" >/dev/null 2>&1 || true
  if (exit "$status"); then cleanup; else cleanup; fi  # which looks at the status
}
podman pod exists tessera-server && { echo "# pods of these names run here already: none was run"; exit 0; }
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
wait_until 60 "the server's pod runs" token
chown 10001 "$secrets/tessera-join-token/join.token"
chmod 600 "$secrets/tessera-join-token/join.token"
pods_of worker
podman play kube --network "$network" "$work/pods-worker.yaml" >"$work/play.log" 2>&1
client() {
  podman run --rm --no-healthcheck --network "$network" -v "$secrets/ann:/certs:ro" -v "$scenes:/scenes:ro" \
    -e TESSERA_SERVER=tessera-server:7420 -e TESSERA_CERTS=/certs "$image" tessera "$@" 2>>"$work/client.log"
}
there() {
  client workers --json >"$work/workers.json" || return 1
  [ "$(json "$work/workers.json" 'sum(w["state"] in ("idle", "busy") for w in d["workers"])')" = 3 ]
}
wait_until 60 "three workers' pods have joined" there
client submit /scenes/same_bits.gltf --size 64x48 --spp 8 --tile-size 16 --name pods --wait >/dev/null
client report pods --json >"$work/report.json"
tessera render "$scenes/same_bits.gltf" -o "$work/alone.exr" --report "$work/alone.json" --size 64x48 --spp 8 \
  --tile-size 16 >/dev/null 2>&1
equal "pods render the same pixels" "$(pixels "$work/report.json")" "$(pixels "$work/alone.json")"
