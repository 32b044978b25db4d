#!/usr/bin/env bash
# Runs the commands of README.md and docs/: each ```sh block under a line `<!-- run -->`, in a folder
# that looks like the root of the clone, the programs on the path. Blocks of a page run in order.
. "$(dirname "$0")/farm.sh"
root=$(cd "$(dirname "$0")/../.." && pwd)

mkdir "$work/clone"
ln -s "$root/tests" "$root/deploy" "$work/clone/"
cd "$work/clone"
for page in "$root"/README.md "$root"/docs/*.md; do
  python3 - "$page" >"$work/commands" <<'PY'
import re, sys
text = open(sys.argv[1]).read()
print("\n".join(re.findall(r"<!-- run -->\n+```sh\n(.*?)```", text, re.S)))
PY
  [ -s "$work/commands" ] && grep -q . "$work/commands" || continue
  (set -eu; . "$work/commands") >"$work/commands.log" 2>&1 </dev/null ||
    fail "a command of ${page#"$root"/} failed"
  say "commands of ${page#"$root"/}: $(grep -c . "$work/commands") lines"
done
[ "$checks" -gt 0 ] || fail "no page has commands to run"
