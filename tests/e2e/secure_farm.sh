#!/usr/bin/env bash
# A farm with certificates, from issuing them to revoking them.
. "$(dirname "$0")/farm.sh"
certs=$work/certs

as() { tessera "$2" --server "$address" --certs "$certs/$1" "${@:3}"; }
is_connected() { as client-ann workers --json | grep -q '"name": *"one"'; }

exits 2 tessera-server --listen 0.0.0.0:0 --store "$work/none"
says "tessera-server init-certs certs --host"
say "an address of other machines is refused, with the command that mends it"

tessera-server init-certs "$certs" --host 127.0.0.1 2>"$work/err"
for who in client:ann client:bob worker:rack; do
  tessera-server issue-cert "$certs" --role "${who%:*}" --name "${who#*:}" >>"$work/issued"
done
equal "issue-cert prints the folders" "$(wc -l <"$work/issued")" 3
equal "keys are private" "$(find "$certs" -name '*.key' ! -perm 0600 | wc -l)" 0

start_secure_server 127.0.0.1:0
exits 3 tessera list --server "$address" --token "$work/issued"
exits 2 tessera list --server farm.example:7420
says "issue-cert"
exits 0 as client-ann list
say "clients without a certificate are refused"

worker_token=$work/join.token
tessera-server tokens create --store "$work/store" --max-joins 1 --out "$worker_token"
equal "a token's file is private" "$(stat -c %a "$worker_token")" 600
secret=$(cut -c10- "$worker_token")
[ "${#secret}" -eq 64 ] || fail "no secret to look for"
! grep -rF -- "$secret" "$work/store" || fail "the token's secret is in the store"
worker=(tessera-worker --server "$address" --certs "$certs/worker-rack" --threads 1)
# Sanitizers map more memory than any limit allows.
[ -n "${TESSERA_E2E_SMALL:-}" ] || worker+=(--memory-mb 4000)
exits 3 "${worker[@]}" --cache "$work/cache-none"
says "join token"
"${worker[@]}" --name one --cache "$work/cache-one" --token "$worker_token" --log-level debug \
  >>"$work/worker-one.log" 2>&1 &
worker_pid[one]=$!
wait_until 60 "the worker is connected" is_connected
exits 3 "${worker[@]}" --cache "$work/cache-two" --token "$worker_token"
says "used up"
renderer=$(children_of "${worker_pid[one]}")
equal "its renderer is confined" "$(awk '/^Seccomp:/ {print $2}' "/proc/$renderer/status")" 2
equal "it gains no privileges" "$(awk '/^NoNewPrivs:/ {print $2}' "/proc/$renderer/status")" 1
equal "its files are limited" "$(awk '/^Max file size/ {print $4, $5}' "/proc/$renderer/limits")" \
  "68719476736 68719476736"
if [ -z "${TESSERA_E2E_SMALL:-}" ]; then
  equal "its memory is limited" "$(awk '/^Max data size/ {print $4, $5}' "/proc/$renderer/limits")" \
    "4000000000 4000000000"
fi
say "a token lets in as many workers as it says"

scene=$scenes/lit_square.gltf
job=$(as client-ann submit "$scene" --size 48x32 --spp 8 --tile-size 16 --name shot)
as client-ann watch "$job" >/dev/null
as client-ann report "$job" --json >"$work/secure.json"
tessera render "$scene" --size 48x32 --spp 8 --tile-size 16 -o "$work/alone.exr" \
  --report "$work/alone.json" 2>/dev/null
equal "the same pixels as without certificates" "$(pixels "$work/secure.json")" \
  "$(pixels "$work/alone.json")"
exits 2 as client-bob status "$job"
exits 2 as client-bob status last
exits 2 as client-bob remove "$job"
exits 0 as client-ann status "$job"
say "another client's job is not found"

token_id=$(cut -c1-8 "$worker_token")
tessera-server tokens list --store "$work/store" | grep -q "^$token_id .* 1 of 1$" ||
  fail "tokens list does not say that one worker has joined"
tessera-server tokens revoke --store "$work/store" "$token_id"
kill_server
start_secure_server "$address"
wait_until 60 "the worker has come back with its key" is_connected
say "a worker comes back to a restarted server after its token was revoked"

tessera-server issue-cert "$certs" --role admin --name root >/dev/null
tessera-server tokens create --store "$work/store" --out "$work/second.token"
"${worker[@]}" --name two --id w-two --cache "$work/cache-two" --token "$work/second.token" >>"$work/worker-two.log" 2>&1 &
worker_pid[two]=$!
share() { [ "$(as admin-root workers --json | grep -c '"certificate": *"rack"')" -eq 2 ]; }
wait_until 60 "two workers share a certificate" share
exits 0 as admin-root workers
says "warning: 2 workers share the certificate rack"
exits 0 as admin-root workers ban one
says "2 connected workers have the certificate rack; the ban is for all: "
says "w-two is banned"
equal "workers that the ban names" "$(grep -c "is banned" "$work/out")" 2
as admin-root workers allow one
kill_worker two

python3 - "${address##*:}" <<'PROGRAM'
import socket, ssl, sys
context = ssl.create_default_context()
context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
for _ in range(60):
    try:
        with socket.create_connection(("127.0.0.1", int(sys.argv[1])), timeout=20) as raw:
            with context.wrap_socket(raw) as peer:  # without a certificate
                peer.recv(1)
    except OSError:
        pass
PROGRAM
handshake_lines() { grep -c "gRPC: .*andshake" "$work/server.log"; }
[ "$(handshake_lines)" -ge 1 ] || fail "failed handshakes are not logged"
[ "$(handshake_lines)" -le 30 ] || fail "60 failed handshakes wrote $(handshake_lines) lines"
[ "$(grep -c andshake "$work/server.log")" -le 30 ] || fail "gRPC writes to the log directly"
say "failed handshakes write few lines"

tessera-server revoke "$certs" --role worker --name rack
wait_until 30 "the revoked worker has ended" gone "${worker_pid[one]}"
grep -q "revoked" "$work/worker-one.log" || fail "the worker does not say why"
say "a revoked worker is sent away"
tessera-server revoke "$certs" --role client --name ann
sleep 1.2
exits 3 as client-ann list
says "revoked"

for text in "$secret" "PRIVATE KEY" "$(sed -n 2p "$certs/tls.key")" \
  "$(sed -n 2p "$certs/client-ann/tls.key")" "$(sed -n 2p "$certs/worker-rack/tls.key")"; do
  ! grep -F -- "$text" "$work/server.log" "$work/worker-one.log" || fail "a secret is in a log"
done
! grep -rF -- "$secret" "$work/store" || fail "the token's secret is in the store"
grep -q "connected: one" "$work/server.log" || fail "the log was not written"
say "secrets are in no log"
