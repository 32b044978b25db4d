#!/usr/bin/env bash
# Runs the commands of README.md and docs/: each ```sh block under a line `<!-- run -->`, in a folder
# that looks like the root of the clone, the programs on the path. Blocks of a page run in order. A
# block that is not run says why, in a line `<!-- not run: WHY -->` above it.
. "$(dirname "$0")/farm.sh"
root=$(cd "$(dirname "$0")/../.." && pwd)

mkdir "$work/clone"
ln -s "$root/tests" "$root/deploy" "$work/clone/"
cd "$work/clone"
for page in "$root"/README.md "$root"/docs/*.md; do
  python3 - "$page" >"$work/commands" <<'PY'
import re, sys
text = open(sys.argv[1]).read()
blocks = re.findall(r"(?:<!-- (run|not run: [^\n]+) -->\n+)?```sh\n(.*?)```", text, re.S)
for mark, block in blocks:
    if not mark:
        sys.exit(f"{sys.argv[1]}: neither run nor said why not:\n{block}")
print("\n".join(block for mark, block in blocks if mark == "run"))
PY
  [ -s "$work/commands" ] && grep -q . "$work/commands" || continue
  # A shell of its own: beside `||` the subshell would go on after a command that fails.
  set +e
  (set -eu; . "$work/commands") >"$work/commands.log" 2>&1 </dev/null
  status=$?
  set -e
  [ "$status" -eq 0 ] || fail "a command of ${page#"$root"/} failed"
  say "commands of ${page#"$root"/}: $(grep -c . "$work/commands") lines"
done
[ "$checks" -gt 0 ] || fail "no page has commands to run"
