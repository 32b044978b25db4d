#!/usr/bin/env bash
# Certificates that live for seconds renew themselves, and the farm goes on with the new ones.
. "$(dirname "$0")/farm.sh"
certs=$work/certs
mine=$certs/worker-rack

as() { tessera "$2" --server "$address" --certs "$certs/$1" "${@:3}"; }
is_new() { [ "$(openssl x509 -in "$1" -noout -serial)" != "$2" ]; }
serial() { openssl x509 -in "$1" -noout -serial; }

tessera-server init-certs "$certs" --host 127.0.0.1 --days 0.0003 2>"$work/err" # 25 s
tessera-server issue-cert "$certs" --role client --name ann >/dev/null
tessera-server issue-cert "$certs" --role client --name eve --days 0.00025 >/dev/null # 21 s
tessera-server issue-cert "$certs" --role client --name tom --days 0.0001 >/dev/null # 9 s
eve_serial=$(serial "$certs/client-eve/tls.crt")
tessera-server issue-cert "$certs" --role worker --name rack --days 0.00025 >/dev/null # 21 s
server_serial=$(serial "$certs/tls.crt")
worker_serial=$(serial "$mine/tls.crt")
worker_key=$(sha256sum <"$mine/tls.key")
end=$((SECONDS + 27))

start_secure_server 127.0.0.1:0
tessera-server tokens create --store "$work/store" --out "$work/join.token"
tessera-worker --server "$address" --certs "$mine" --threads 1 --name one --cache "$work/cache" \
  --token "$work/join.token" --log-level debug >>"$work/worker-one.log" 2>&1 &
worker_pid[one]=$!
wait_until 20 "the worker is connected" grep -q "connected: one" "$work/server.log"

held=$(as client-eve submit "$scenes/lit_square.gltf" --size 48x32 --spp 8 --name held --require-tag nobody)
as client-eve watch "$held" >"$work/eve" 2>&1 &
worker_pid[watch]=$!
# The worker renders small units of it from now on until it is cancelled.
busy=$(as client-ann submit "$scenes/lit_square.gltf" --size 640x480 --spp 8192 --tile-size 16 --name busy)

wait_until 30 "the worker's certificate is new" is_new "$mine/tls.crt" "$worker_serial"
[ "$(sha256sum <"$mine/tls.key")" != "$worker_key" ] || fail "the worker kept its key"
equal "the new key is private" "$(stat -c %a "$mine/tls.key")" 600
wait_until 30 "the server's certificate is new" is_new "$certs/tls.crt" "$server_serial"
say "worker and server have renewed their certificates"

while [ "$SECONDS" -le "$end" ]; do sleep 0.5; done
kill -0 "${worker_pid[one]}" || fail "the worker has ended"

# The worker's streams began with its first certificate, too.
committed() {
  as client-ann status "$busy" --json >"$work/busy.json"
  json "$work/busy.json" 'd["progress"]["units_committed"]'
}
before=$(committed)
[ "$before" -gt 0 ] || fail "the worker has delivered nothing"
has_more() { [ "$(committed)" -gt "$before" ]; }
wait_until 30 "results arrive after the worker's first certificate has expired" has_more
as client-ann cancel "$busy" >/dev/null
rendered() { sed -nE "s/.*unit (.*) rendered in .*/\\1/p" "$work/worker-one.log"; }
[ "$(rendered | wc -l)" -ge "$before" ] || fail "$before units are committed, but only $(rendered | wc -l) rendered"
[ -z "$(rendered | sort | uniq -d)" ] || fail "rendered twice: $(rendered | sort | uniq -d | head)"
say "a busy worker loses no unit when it connects with its new certificate"

scene=$scenes/lit_square.gltf
job=$(as client-ann submit "$scene" --size 48x32 --spp 8 --tile-size 16 --name shot)
as client-ann watch "$job" >"$work/watched"
as client-ann status "$job" --json | grep -qi "\"state\": *\"done\"" || fail "the job is not done"
grep -q "the certificate has been renewed" "$work/worker-one.log" || fail "the worker does not say so"
grep -q "the server's certificate has been renewed" "$work/server.log" || fail "nor does the server"
say "a job is rendered after the first certificates have expired"

# The watch of eve began with the first certificate, which has expired.
kill -0 "${worker_pid[watch]}" || fail "the watch has ended: $(cat "$work/eve")"
is_new "$certs/client-eve/tls.crt" "$eve_serial" || fail "the client's certificate is the old one"
equal "the client's key is private" "$(stat -c %a "$certs/client-eve/tls.key")" 600
as client-eve cancel "$held" >/dev/null
wait_until 10 "the watch sees the end" gone "${worker_pid[watch]}"
grep -qi cancelled "$work/eve" || fail "the watch does not say so: $(cat "$work/eve")"
exits 3 as client-tom list
says "client-tom/tls.crt: the certificate expired at"
says "tessera-server issue-cert CERTS --role client --name tom"
say "a watch survives the certificate it began with; an expired one is named"

as client-ann quotas --json >"$work/quotas.json"
grep -q '"quota": *"stored-gb"' "$work/quotas.json" || fail "no quotas"
exits 2 tessera-server --listen unix:"$work/none" --store "$work/none" --client-quota ann:streems=3
grep -q '"quota": *"connections"' "$work/quotas.json" || fail "no quota of connections"
says "unknown quota \"streems\"; expected one of jobs, gigasamples"
printf 'client-streems = 3\n' >"$work/bad.toml"
exits 2 tessera-server --listen unix:"$work/none" --store "$work/none" --config "$work/bad.toml"
says "client-streams"
say "quotas are shown, and unknown ones refused"
