#!/usr/bin/env bash
# Commands for operators: events, logs, webhooks, drain, ban.
. "$(dirname "$0")/farm.sh"
scene=$scenes/lit_square.gltf
job=(--size 64x48 --spp 8 --tile-size 16)

# worker_state ID: prints the worker's state as listed by `tessera workers`.
worker_state() {
  farm workers --json >"$work/workers.json"
  json "$work/workers.json" "[w['state'] for w in d['workers'] if w['id'] == '$1']"
}
both_idle() { is_state w-one idle && is_state w-two idle; }
is_state() { [ "$(worker_state "$1")" = "$2" ]; }

start_server
start_interruptible events tessera events --server "$socket" --follow --json
follower=$started
echo hush >"$work/secret"
python3 "$(dirname "$0")/operators/receiver.py" "$work/secret" "$work/posts" >"$work/receiver.port" 2>"$work/receiver.log" &
worker_pid[receiver]=$! # so that it is stopped at the end
wait_until 30 "the receiver listens" test -s "$work/receiver.port"
export TESSERA_WEBHOOK_URL=http://127.0.0.1:$(cat "$work/receiver.port")/hook no_proxy=127.0.0.1
start_webhook() {
  tessera-webhook --server "$socket" --secret-file "$work/secret" --state-file "$work/webhook.state" 2>>"$work/webhook.log" &
  worker_pid[webhook]=$!
}
start_webhook
wait_until 30 "the webhook has begun" test -s "$work/webhook.state"
# posted: checks that the receiver has the events of `events --follow`, in order and each once.
sequences() { sed -n 's/.*"sequence":\([0-9]*\),.*/\1/p' "$1"; }
posted() { cmp -s <(sequences "$work/events.out") <(sequences "$work/posts"); }
at_newest() { [ "$(cat "$work/webhook.state")" = "$(sequences "$work/events.out" | tail -n 1)" ]; }
start_worker one --id w-one --log-level debug
start_worker two --id w-two
wait_until 60 "both workers are connected" both_idle
id=$(farm submit "$scene" "${job[@]}" --name shot)
exits 0 farm logs shot --follow
says "job $id job submitted: shot"
says "job $id job done"
says "frame 0: scene loaded in"
exits 0 farm logs shot
grep -q "worker w-one: unit $id 0 [0-9]* [0-9]* rendered in" "$work/out" ||
  fail "a worker at --log-level debug logged nothing about its units"
! grep -q "worker w-two: unit .* rendered in" "$work/out" ||
  fail "a worker at --log-level info logged its units"
say "logs: a job's life, and what its workers' log levels let through"

exits 0 farm report shot --trace "$work/trace.json"
farm report shot --json >"$work/report.json"
equal "the timeline has every unit once" \
  "$(json "$work/trace.json" 'len({(e["args"]["frame"], e["args"]["tile"], e["args"]["pass"]) for e in d["traceEvents"] if e["ph"] == "X" and e["cat"] == "unit"})')" \
  "$(json "$work/report.json" 'd["units"]["committed"]')"
equal "a row for each thread that rendered some" \
  "$(json "$work/trace.json" 'len({(e["pid"], e["tid"]) for e in d["traceEvents"] if e["ph"] == "X" and e["cat"] == "unit"})')" \
  "$(json "$work/report.json" 'len(d["workers"])')"
equal "and what happened to the job" \
  "$(json "$work/trace.json" 'sum(e["name"] in ("job submitted", "frame finished", "job done") for e in d["traceEvents"])')" 3

exits 0 farm workers drain w-two
wait_until 30 "the drained worker has gone" gone "${worker_pid[two]}"
wait "${worker_pid[two]}" || fail "a drained worker ended with $?"
unset "worker_pid[two]"
say "drain: the worker ends with 0"

wait_until 60 "no post is on its way, which might come twice" at_newest
kill "${worker_pid[webhook]}"
wait "${worker_pid[webhook]}" || fail "tessera-webhook ended with $? on SIGTERM"

exits 0 farm workers ban one # by its name
equal "a banned worker is quarantined" "$(worker_state w-one)" "quarantined"
start_webhook
wait_until 60 "what the webhook missed is posted" posted
id=$(farm submit "$scene" "${job[@]}" --seed 2 --name waits)
kill_server # whether anybody has seen the event or not
start_server
wait_until 60 "the banned worker is back" is_state w-one "quarantined"
sleep 1
equal "a ban outlives the server" "$(committed "$id")" 0
exits 0 farm workers allow w-one
exits 0 farm watch waits
say "allow: it works again"
exits 2 farm workers drain nobody

exits 0 tessera logs "$id" --server "$socket" --json
while read -r line; do
  check_schema <<<"$line" || fail "does not match its schema: $line"
done <"$work/out"
for kind in "job submitted" "frame finished" "job done" "worker drained" "worker banned" "worker allowed"; do
  wait_until 60 "event '$kind' comes, over the restart" grep -q "\"kind\":\"$kind\"" "$work/events.out"
done
wait_until 60 "all events are posted" posted
equal "the submission before the kill is told once" \
  "$(grep "\"job\":\"$id\"" "$work/posts" | grep -c "job submitted")" 1
grep -q "http://127.0.0.1:[0-9]* responded 503; retrying in 1s" "$work/webhook.log" ||
  fail "the receiver was not busy at first"
kill "${worker_pid[webhook]}"
wait "${worker_pid[webhook]}" || fail "tessera-webhook ended with $? on SIGTERM"
# A state file with a later sequence than the store has: it belongs to another store.
echo $((1 << 60)) >"$work/webhook.state"
start_webhook
wait_until 30 "the webhook continues from the newest event" at_newest
grep -q "continuing with new events only" "$work/webhook.log" ||
  fail "the webhook does not log that events are missing: $(tail -n 2 "$work/webhook.log")"
kill "${worker_pid[webhook]}"
wait "${worker_pid[webhook]}" || fail "tessera-webhook ended with $? on SIGTERM"
kill "${worker_pid[receiver]}"
wait "${worker_pid[receiver]}" || true
unset "worker_pid[webhook]" "worker_pid[receiver]"
say "webhook: signed, in order, through a busy receiver, over restarts of itself and of the server"
interrupted events "$follower"
say "events: one stream, over a restart of the server"

kill_server
start_server --job-retention-days 0.00001 # a second
no_jobs() { farm list --json >"$work/jobs.json" && [ "$(json "$work/jobs.json" 'len(d["jobs"])')" -eq 0 ]; }
wait_until 30 "jobs that ended are removed" no_jobs
kill_worker one
kill "$server_pid"
wait "$server_pid" || fail "the server ended with $? on SIGTERM"
server_pid=
equal "their images went with them" "$(find "$work/store/outputs" "$work/store/segments" -type f | wc -l)" 0
exits 0 tessera-server check "$work/store"
say "--job-retention-days: jobs that ended go by themselves, and the store is whole"
echo "$checks checks"
