#!/usr/bin/env bash
# deploy/slurm/workers.sbatch under Slurm: controller, three nodes and munge on this host, in a private
# directory. Workers join as an array. During a job one is cancelled and drains, and one is killed with its
# node and queued again (Slurm starts it minutes later, which is not awaited). The pixels must equal those
# of a render without Slurm.
#
# Needs root (munged runs as its own user) and the packages slurm-wlm and munge; else it is skipped.
. "$(dirname "$0")/farm.sh"

for program in slurmctld slurmd munged sbatch; do
  command -v "$program" >/dev/null || skip "$program is not installed"
done
[ "$(id -u)" -eq 0 ] || skip "needs root, for munged's own user"

slurm=$(mktemp -d "${TMPDIR:-/tmp}/tessera-slurm.XXXXXX")  # not in $work: munge's user looks into it
sbatch_file=$(cd "$(dirname "$0")/../.." && pwd)/deploy/slurm/workers.sbatch
mkdir -p "$work/stub" "$work/certs/n1"
printf '#!/bin/sh\necho "$TESSERA_CERTS"\n' >"$work/stub/tessera-worker"
chmod +x "$work/stub/tessera-worker"
# certs_of NODE: prints the certificates with which the script starts a worker there.
certs_of() {
  PATH=$work/stub:$PATH TESSERA_SERVER=$socket TESSERA_CERTS=$work/certs SLURMD_NODENAME=$1 SLURM_ARRAY_JOB_ID=1 \
    SLURM_ARRAY_TASK_ID=1 bash "$sbatch_file"
}
equal "a node's worker has the node's certificate" "$(certs_of n1)" "$work/certs/n1"
equal "without one it has the common certificate" "$(certs_of n2)" "$work/certs"
chmod 755 "$slurm"
mkdir -m 755 "$slurm/run" "$slurm/state" "$slurm/log" "$slurm/spool" "$slurm/munge-run"
mkdir -m 700 "$slurm/munge"
head -c 1024 /dev/urandom >"$slurm/munge/key"
chmod 400 "$slurm/munge/key"
chown -R munge:munge "$slurm/munge" "$slurm/munge-run"
export SLURM_CONF=$slurm/slurm.conf
cat >"$SLURM_CONF" <<CONF
ClusterName=tessera
SlurmctldHost=localhost
AuthType=auth/munge
AuthInfo=socket=$slurm/munge-run/munge.socket
CryptoType=crypto/munge
SlurmUser=root
SlurmdUser=root
SlurmctldPort=26817
SlurmctldPidFile=$slurm/run/slurmctld.pid
SlurmdPidFile=$slurm/run/slurmd.%n.pid
SlurmdSpoolDir=$slurm/spool/%n
StateSaveLocation=$slurm/state
SlurmctldLogFile=$slurm/log/slurmctld.log
SlurmdLogFile=$slurm/log/slurmd.%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
ReturnToService=2
SchedulerParameters=sched_interval=2,bf_interval=2,requeue_setup_env_fail
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SlurmdTimeout=10
KillWait=15
SlurmdParameters=config_overrides
NodeName=n[1-3] NodeHostname=localhost NodeAddr=127.0.0.1 Port=[26821-26823] CPUs=2 RealMemory=1000 State=UNKNOWN
PartitionName=render Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF

# Stops all processes of this cluster, however the test ends: those with its configuration in their
# environment, and munged.
cluster_pids() {
  cat "$slurm/munged.pid" 2>/dev/null || true
  grep -lsz "^SLURM_CONF=$SLURM_CONF\$" /proc/[0-9]*/environ | cut -d/ -f3 | grep -vx "$$\|$BASHPID" || true
}
stop_cluster() {
  scancel --user=root --full 2>/dev/null || true
  local pid signal
  for signal in TERM KILL; do
    for pid in $(cluster_pids); do kill -"$signal" "$pid" 2>/dev/null || true; done
    sleep 1
  done
}
finish() {
  local status=$?
  tail -25 "$slurm/log/slurmctld.log" >"$work/slurmctld.log" 2>/dev/null || true
  stop_cluster
  rm -rf "$slurm"
  if (exit "$status"); then cleanup; else cleanup; fi  # which looks at the status
}
trap finish EXIT

runuser -u munge -- munged --key-file="$slurm/munge/key" --socket="$slurm/munge-run/munge.socket" \
  --pid-file="$slurm/munge-run/munged.pid" --log-file="$slurm/munge/munged.log" \
  --seed-file="$slurm/munge/seed" --force 2>/dev/null
cp "$slurm/munge-run/munged.pid" "$slurm/munged.pid"
slurmctld -f "$SLURM_CONF" -c
for node in 1 2 3; do slurmd -f "$SLURM_CONF" -N "n$node"; done
nodes_are_idle() { [ "$(sinfo --noheader --format='%D %t' | awk '/idle/ {print $1}')" = 3 ]; }
wait_until 30 "three nodes are there" nodes_are_idle

size=160x120 spp=64
tessera render "$scenes/same_bits.gltf" -o "$work/alone.exr" --report "$work/alone.json" --size $size \
  --spp $spp --tile-size 16 --workers 1 >"$work/alone.log"

start_server
export TESSERA_SERVER=$socket TESSERA_CACHE=$work/slurm-cache TESSERA_GRACE=5
array=$(cd "$work" && sbatch --parsable --array=0-2 --cpus-per-task=1 --export=ALL "$sbatch_file")
joined() { [ "$(farm workers --json | python3 -c 'import json,sys; print(sum(w["state"] in ("idle", "busy") for w in json.load(sys.stdin)["workers"]))')" = "$1" ]; }
wait_until 60 "three workers of the array joined" joined 3

id=$(farm submit "$scenes/same_bits.gltf" --size $size --spp $spp --tile-size 16)
wait_until 60 "some units are committed" committed_at_least "$id" 5
scancel "${array}_0"
wait_until 30 "the cancelled worker has drained" joined 2
cancelled=$work/tessera-worker-${array}_0.log
wait_until 20 "it got the signal" grep -q "draining: signal received" "$cancelled"
! grep -q "killed by SIGTERM" "$cancelled" || fail "the signal to all of the step ended the renderer"

# A node dies with its worker; Slurm queues the task again on the node that is free.
victim=$(squeue --noheader --format='%i %N' | awk -v task="${array}_1" '$1 == task {print $2}')
kill -KILL "$(cat "$slurm/run/slurmd.$victim.pid")"
worker=$(pgrep -f -- "--id slurm-${array}-1 " | head -1)
kill -KILL "$(awk '/^PPid/ {print $2}' "/proc/$worker/status")" "$worker"  # the step first: it tells nothing
wait_until 30 "it is lost" joined 1
queued_again() { squeue --noheader --array --states=all --format="%i %t %N" >"$work/squeue.log"; grep -q "^${array}_1 \(PD\|CF\|R\)" "$work/squeue.log"; }
wait_until 90 "the task is queued again" queued_again

farm watch "$id" >"$work/watch.log" 2>&1 || fail "watch: status $?"
farm report "$id" --json >"$work/report.json"
pixels='d["frames"][0]["pixels_sha256"]'
equal "pixels" "$(json "$work/report.json" "$pixels")" "$(json "$work/alone.json" "$pixels")"
equal "no unit twice" "$(json "$work/report.json" 'd["units"]["duplicated"]')" 0
