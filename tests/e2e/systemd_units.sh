#!/usr/bin/env bash
# systemd accepts the units of deploy/systemd, and the programs have the options in them.
. "$(dirname "$0")/farm.sh"

command -v systemd-analyze >/dev/null || skip "systemd-analyze is not installed"
units=$(cd "$(dirname "$0")/../../deploy/systemd" && pwd)
mkdir "$work/units"
for unit in "$units"/*.service.in; do
  # The man pages are not installed here.
  sed -e "s#@bindir@#$TESSERA_BIN#" -e '/^Documentation=/d' "$unit" >"$work/units/$(basename "$unit" .in)"
done
# An unknown setting in another unit must be found; otherwise systemd-analyze has read nothing.
printf '[Service]\nExecStart=/bin/true\nNoSuchSetting=1\n' >"$work/units/faulty.service"
systemd-analyze verify "$work/units"/*.service >"$work/verify.log" 2>&1 || true
grep -q "faulty.service.*NoSuchSetting" "$work/verify.log" || fail "systemd-analyze verifies no units: $(cat "$work/verify.log")"
sed -i '/faulty\.service/d' "$work/verify.log"
grep "$work/units\|^tessera" "$work/verify.log" >"$work/faults.log" || true
[ ! -s "$work/faults.log" ] || fail "$(cat "$work/faults.log")"
say "systemd finds no fault"

# The server accepts a directory with the mode of the unit's runtime directory.
mkdir "$work/runtime"
chmod "$(sed -n 's/^RuntimeDirectoryMode=//p' "$units/tessera-server.service.in")" "$work/runtime"
tessera-server --listen "unix:$work/runtime/tessera.sock" --store "$work/store" >"$work/server.log" 2>&1 &
server_pid=$!
wait_until 60 "the server listens" test -S "$work/runtime/tessera.sock"
kill_server
say "the server listens in a runtime directory of the unit's mode"

for program in server worker webhook; do
  "$TESSERA_BIN/tessera-$program" --help >"$work/help"
  options=$(grep -h '^ExecStart=' "$units"/tessera-$program*.service.in | grep -o -- '--[a-z-]*')
  for option in $options; do
    grep -q -- "$option " "$work/help" || fail "tessera-$program has no $option"
  done
  say "tessera-$program has the $(wc -w <<<"$options") options of its unit"
done
