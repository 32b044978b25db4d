#!/usr/bin/env bash
# Compares the metrics of a farm during a job with the job's report, and checks that alerts and dashboard
# use existing metrics only.
. "$(dirname "$0")/farm.sh"
deploy=$(cd "$(dirname "$0")/../../deploy" && pwd)

# scrape LOG FILE: saves the metrics of the program that writes LOG, once its log has the address.
scrape() {
  wait_until 60 "$1 says where" grep -q "metrics: http" "$work/$1"
  python3 -c '
import sys, urllib.request
direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))
sys.stdout.write(direct.open(sys.argv[1], timeout=20).read().decode())' \
    "$(grep -o 'http://[^ ]*/metrics' "$work/$1" | tail -n 1)" >"$work/$2"
}

# metric FILE NAME{LABELS}: prints its value, integers without a fraction.
metric() {
  awk -v name="$2" 'substr($0, 1, length(name) + 1) == name " " { print $NF + 0; found = 1 }
    END { exit !found }' "$work/$1" || fail "$1 has no $2"
}

exits 2 tessera-server --listen "$socket" --store "$work/store" --metrics 0.0.0.0:0
says "127.0.0.1:PORT"
say "metrics are not offered to other machines"

start_server --metrics 127.0.0.1:0
start_worker one --metrics 127.0.0.1:0
exits 0 farm limits set licence 2
exits 0 farm budgets set --owner local --cpu-hours 1000
job=$(farm submit "$scenes/lit_square.gltf" --size 256x256 --spp 160 --tile-size 8 --name shot)
wait_until 60 "units are committed" committed_at_least "$job" 3
# While the worker is stopped, only results that it has delivered are still committed.
kill -STOP "${worker_pid[one]}"
scrape_at_rest() {
  local before
  before=$(committed "$job")
  scrape server.log server.txt
  farm report "$job" --json >"$work/report.json"
  [ "$(committed "$job")" -eq "$before" ]
}
wait_until 60 "what was delivered is committed" scrape_at_rest
kill -CONT "${worker_pid[one]}"
done=$(json "$work/report.json" 'd["units"]["committed"]')
total=$(json "$work/report.json" 'd["units"]["total"]')
[ "$done" -lt "$total" ] || fail "the job was done before its metrics were read"
equal "in mid-job: units committed" "$(metric server.txt tessera_units_committed_total)" "$done"
equal "in mid-job: the part of the budget, to a millisecond" \
  "$(metric server.txt 'tessera_budget_used_fraction{account="client local"}' | awk '{ printf "%.3f", $1 * 3.6e6 }')" \
  "$(json "$work/report.json" 'd["cpu_seconds"]' | xargs printf %.3f)"
equal "in mid-job: a limit" "$(metric server.txt 'tessera_limit_units{limit="licence"}')" 2
waiting=$(metric server.txt 'tessera_units{state="waiting"}')
leased=$(metric server.txt 'tessera_units{state="leased"}')
equal "in mid-job: units that wait ($waiting) or are leased ($leased)" \
  $((waiting + leased)) $((total - done))
equal "in mid-job: the job" "$(metric server.txt 'tessera_jobs{state="running"}')" 1
equal "in mid-job: CPU seconds, to a millisecond" \
  "$(metric server.txt tessera_cpu_seconds_total | xargs printf %.3f)" \
  "$(json "$work/report.json" 'd["cpu_seconds"]' | xargs printf %.3f)"
equal "in mid-job: each unit's lease was timed" \
  "$(metric server.txt tessera_unit_turnaround_seconds_count)" "$done"
cp "$work/server.txt" "$work/mid-job.txt"  # has the gauges of pools, which disappear with their work
commits=$(metric server.txt tessera_commit_seconds_count)
[ "$(metric server.txt tessera_fsync_duration_seconds_count)" -ge "$commits" ] ||
  fail "fewer fdatasyncs than the $commits commits"

# A crash of the renderer costs only time.
kill -KILL "$(children_of "${worker_pid[one]}")"
died() {
  scrape worker-one.log worker.txt
  [ "$(metric worker.txt 'tessera_worker_errors_total{kind="renderer_died"}')" -eq 1 ]
}
wait_until 60 "the renderer's death is counted" died
farm watch "$job" --json </dev/null >"$work/watch.log"
scrape server.log server.txt
equal "at the end: samples" "$(metric server.txt tessera_samples_total)" $((256 * 256 * 160))
equal "at the end: the job" "$(metric server.txt 'tessera_jobs{state="done"}')" 1
equal "at the end: no unit is left" "$(metric server.txt 'tessera_units{state="waiting"}')" 0
scrape worker-one.log worker.txt
equal "the worker counts the same" \
  "$(metric worker.txt 'tessera_worker_acknowledgements_total{status="committed"}')" "$total"
equal "the worker's scene came from the server" \
  "$(metric worker.txt 'tessera_worker_assets_total{source="server"}')" 1
equal "the worker sees its server" "$(metric worker.txt tessera_worker_connected)" 1
before=$(metric server.txt 'tessera_errors_total{kind="worker_lost"}')
kill_worker one
lost() {
  scrape server.log server.txt
  [ "$(metric server.txt 'tessera_workers{state="lost"}')" -eq 1 ]
}
wait_until 60 "the killed worker counts as lost" lost
equal "a lost worker is an error" \
  "$(metric server.txt 'tessera_errors_total{kind="worker_lost"}')" $((before + 1))

# A second job on a warm cache.
mv "$work/cache-one" "$work/cache-two"
start_worker two --metrics localhost:0
farm submit "$scenes/lit_square.gltf" --size 16x16 --spp 8 --wait >/dev/null
scrape worker-two.log worker.txt
[ "$(metric worker.txt 'tessera_worker_assets_total{source="cache"}')" -ge 1 ] || fail "no cache hit"
equal "a worker with a warm cache fetches nothing" \
  "$(metric worker.txt 'tessera_worker_assets_total{source="server"}')" 0

# Only a server with certificates says when its own expires.
tessera-server init-certs "$work/certs" --host 127.0.0.1 --days 9 2>/dev/null
: >"$work/secure.log"
tessera-server --listen 127.0.0.1:0 --store "$work/secure" --certs "$work/certs" --metrics 127.0.0.1:0 \
  >"$work/address" 2>>"$work/secure.log" &
worker_pid[secure]=$! # so that it is stopped at the end
expires() { scrape secure.log secure.txt && grep -q '^tessera_certificate_expiry_timestamp_seconds ' "$work/secure.txt"; }
wait_until 60 "the server has read its certificate" expires
equal "end of the server's certificate" \
  "$(awk '$1 == "tessera_certificate_expiry_timestamp_seconds" { printf "%d", $2 }' "$work/secure.txt")" \
  "$(date +%s -d "$(openssl x509 -in "$work/certs/tls.crt" -noout -enddate | cut -d= -f2)")"

cat "$work/mid-job.txt" "$work/secure.txt" "$work/server.txt" "$work/worker.txt" | awk '$1 != "#" { sub("[{ ].*", ""); print }' |
  sort -u >"$work/names"
grep -ohE 'tessera_[a-z_]+' "$deploy/grafana/tessera.json" "$deploy/prometheus/alerts.yml" | sort -u |
  comm -23 - "$work/names" >"$work/unknown"
equal "dashboard and alerts use existing metrics only" "$(cat "$work/unknown")" ""

command -v promtool >/dev/null || fail "promtool is not installed (package prometheus)"
for text in server.txt secure.txt worker.txt; do
  promtool check metrics <"$work/$text" >"$work/out" 2>&1 || fail "$text: $(cat "$work/out")"
  equal "promtool has no remarks on $text" "$(cat "$work/out")" ""
done
exits 0 promtool test rules "$deploy/prometheus/alerts_test.yml"
say "the alerts fire when they should, and only then"
