#!/usr/bin/env bash
# The autoscaler of deploy/kubernetes/autoscaled: a HorizontalPodAutoscaler adds worker pods while many units wait, and
# removes them afterwards. No unit fails, and the pixels are those of a render without a farm.
#
# API server and controllers are real, but there are no nodes: for each pod this test runs a worker process, which gets
# SIGTERM when the pod is deleted. An adapter of 50 lines stands for Prometheus and prometheus-adapter. All runs in a
# network namespace of its own. The wait before pods are removed is shortened from 300 s to 10 s.
#
# Needs root, kubectl, node, openssl, etcd, kube-apiserver and kube-controller-manager.
[ -n "${TESSERA_NAMESPACE:-}" ] || [ "$(id -u)" -ne 0 ] || exec unshare --net env TESSERA_NAMESPACE=1 "$0" "$@"
. "$(dirname "$0")/farm.sh"
here=$(cd "$(dirname "$0")" && pwd)
deploy=$here/../../deploy/kubernetes

[ "$(id -u)" -eq 0 ] || skip "needs root"
for program in kubectl node openssl etcd kube-apiserver kube-controller-manager; do
  command -v $program >/dev/null || skip "$program is not installed"
done
# An endpoint of a service cannot have an address of 127.0.0.0/8.
machine=192.0.2.2
ip link set lo up
ip address add "$machine/32" dev lo
unset http_proxy https_proxy HTTP_PROXY HTTPS_PROXY

# run NAME COMMAND…: starts a part of the control plane.
run() {
  local name=$1
  shift
  "$@" >"$work/$name.log" 2>&1 &
  worker_pid[$name]=$!
}

openssl req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=adapter -keyout "$work/adapter.key" -out "$work/adapter.crt" 2>/dev/null
openssl genrsa -out "$work/accounts.key" 2048 2>/dev/null
openssl rsa -in "$work/accounts.key" -pubout -out "$work/accounts.pub" 2>/dev/null
echo 'secret,admin,1,"system:masters"' >"$work/tokens.csv"
cat >"$work/kubeconfig" <<YAML
apiVersion: v1
kind: Config
clusters: [{name: farm, cluster: {server: "https://127.0.0.1:16443", insecure-skip-tls-verify: true}}]
users: [{name: admin, user: {token: secret}}]
contexts: [{name: farm, context: {cluster: farm, user: admin, namespace: tessera}}]
current-context: farm
YAML
export KUBECONFIG=$work/kubeconfig

run etcd etcd --data-dir "$work/etcd" --listen-client-urls http://127.0.0.1:23790 \
  --advertise-client-urls http://127.0.0.1:23790 --listen-peer-urls http://127.0.0.1:23800
run apiserver kube-apiserver --etcd-servers=http://127.0.0.1:23790 --secure-port=16443 --bind-address=127.0.0.1 \
  --cert-dir="$work/apiserver" --service-cluster-ip-range=10.96.0.0/16 --token-auth-file="$work/tokens.csv" \
  --authorization-mode=RBAC --service-account-key-file="$work/accounts.pub" \
  --service-account-signing-key-file="$work/accounts.key" --service-account-issuer=https://farm.local \
  --disable-admission-plugins=ServiceAccount --enable-aggregator-routing=true --advertise-address="$machine"
is_ready() { kubectl get --raw /readyz >/dev/null 2>&1; }
wait_until 120 "the API server is ready" is_ready
run controllers kube-controller-manager --kubeconfig="$KUBECONFIG" --leader-elect=false \
  --controllers=deployment,replicaset,horizontalpodautoscaling --horizontal-pod-autoscaler-sync-period=2s
say "the control plane runs: $(kubectl version -o json 2>/dev/null | python3 -c 'import json, sys; print(json.load(sys.stdin)["serverVersion"]["gitVersion"])')"

start_server --metrics 127.0.0.1:0
wait_until 60 "the server says where its metrics are" grep -q "metrics: http" "$work/server.log"
run adapter node "$here/kubernetes/external_metrics.mjs" 26443 "$work/adapter.key" "$work/adapter.crt" \
  "$(grep -o 'http://[^ ]*/metrics' "$work/server.log" | tail -n 1)"

kubectl create namespace tessera >/dev/null
kubectl create namespace metrics >/dev/null
cat >"$work/adapter.yaml" <<YAML
apiVersion: v1
kind: Service
metadata: {name: adapter, namespace: metrics}
spec: {ports: [{port: 443, targetPort: 26443}]}
---
apiVersion: v1
kind: Endpoints
metadata: {name: adapter, namespace: metrics}
subsets: [{addresses: [{ip: $machine}], ports: [{port: 26443}]}]
---
apiVersion: apiregistration.k8s.io/v1
kind: APIService
metadata: {name: v1beta1.external.metrics.k8s.io}
spec:
  service: {name: adapter, namespace: metrics}
  group: external.metrics.k8s.io
  version: v1beta1
  insecureSkipTLSVerify: true
  groupPriorityMinimum: 100
  versionPriority: 100
YAML
kubectl apply -f "$work/adapter.yaml" >/dev/null
metric=/apis/external.metrics.k8s.io/v1beta1/namespaces/tessera/tessera_pool_units_for_new_workers
has_metric() { kubectl get --raw "$metric?labelSelector=namespace%3Dtessera%2Cpool%3Ddefault" >"$work/metric.json" 2>/dev/null; }
wait_until 60 "the API server asks the adapter" has_metric
equal "nothing waits yet" "$(json "$work/metric.json" 'd["items"][0]["value"]')" 0

# The Deployment and the autoscaler of the overlay.
kubectl kustomize "$deploy/autoscaled" >"$work/overlay.yaml"
python3 - "$work/overlay.yaml" "$work/workers.yaml" <<'PY'
import re, sys
objects = open(sys.argv[1]).read().split("\n---\n")
chosen = [o for o in objects if re.search(r"^kind: (Deployment|HorizontalPodAutoscaler)$", o, re.M)]
assert len(chosen) == 2, f"{len(chosen)} objects"
text, count = re.subn("stabilizationWindowSeconds: 300", "stabilizationWindowSeconds: 10", "\n---\n".join(chosen))
assert count == 1
text, count = re.subn("periodSeconds: 60$", "periodSeconds: 2", text, flags=re.M)
assert count == 1
open(sys.argv[2], "w").write(text)
PY
# Before 1.23 the version of this API was v2beta2.
kubectl api-versions | grep -qx autoscaling/v2 || sed -i 's,autoscaling/v2$,autoscaling/v2beta2,' "$work/workers.yaml"
kubectl apply -f "$work/workers.yaml" >/dev/null

# sync_workers: starts a worker for each new pod and ends those of deleted pods. Sets $pods, and notes the most.
pods=0 most=0
declare -A is_pod=()
sync_workers() {
  local name alive
  alive=$(kubectl get pods -o name | cut -d/ -f2) || return 0
  for name in $alive; do
    [ -z "${is_pod[$name]:-}" ] || continue
    start_worker "$name" --id "$name"
    is_pod[$name]=1
  done
  for name in "${!is_pod[@]}"; do
    grep -qx "$name" <<<"$alive" && continue
    kill -TERM "${worker_pid[$name]}"
    wait "${worker_pid[$name]}" || fail "worker $name ended with $?"
    unset "worker_pid[$name]" "is_pod[$name]"
  done
  pods=${#is_pod[@]}
  [ "$pods" -le "$most" ] || most=$pods
}
has_pods() { sync_workers && [ "$pods" -eq "$1" ]; }
wait_until 60 "there is one worker" has_pods 1
say "one worker while nothing waits"

# Units that no further worker could take start no pods: of another pool, with a tag, of a job with all its workers.
small=("$scenes/lit_square.gltf" --size 256x256 --spp 2000 --tile-size 16)
night=$(farm submit "${small[@]}" --pool night)
gpu=$(farm submit "${small[@]}" --require-tag gpu)
alone=$(farm submit "${small[@]}" --max-workers 1)
wait_until 60 "the worker renders" committed_at_least "$alone" 1
for _ in 1 2 3 4 5 6 7 8; do sync_workers && sleep 1; done
equal "workers while no other could take what waits" "$most" 1
for other in "$night" "$gpu" "$alone"; do farm cancel "$other" >/dev/null; done

job=$(farm submit "$scenes/lit_square.gltf" --size 256x256 --spp "${SPP:-2000}" --tile-size 16 --name many)
has_at_least() { sync_workers && [ "$pods" -ge "$1" ]; }
wait_until 120 "the autoscaler adds workers" has_at_least 4
say "$pods workers while $(has_metric && json "$work/metric.json" 'd["items"][0]["value"]') units wait"
is_done() { sync_workers && [ "$(farm status "$job" --json | python3 -c 'import json, sys; print(json.load(sys.stdin)["state"])')" = done ]; }
wait_until 400 "the job is done" is_done
say "the job is done; at most $most workers"
wait_until 180 "the autoscaler removes workers" has_pods 1
say "one worker again; the others have drained"

farm status "$job" --json >"$work/status.json"
equal "no attempt failed" "$(json "$work/status.json" 'len(d["failed_attempts"])')" 0
farm report "$job" --json >"$work/report.json"
tessera render "$scenes/lit_square.gltf" --size 256x256 --spp "${SPP:-2000}" --tile-size 16 \
  --output "$work/alone.exr" --report "$work/alone.json" >"$work/alone.log" 2>&1
equal "the pixels are those of a render without a farm" "$(pixels "$work/report.json")" "$(pixels "$work/alone.json")"
kubectl get events --sort-by=.lastTimestamp -o custom-columns=M:.message | grep "New size" || true
