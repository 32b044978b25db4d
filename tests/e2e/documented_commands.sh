#!/usr/bin/env bash
# Runs the commands of README.md and of every page of docs/, as tests/documents/check.py prints them:
# each ```sh block under a line `<!-- run -->`. A block that is not run says why, in a line
# `<!-- not run: WHY -->` above it. The blocks of a page run in order, in a directory of their own
# that looks like the root of the clone, with the programs on the path. Lines of blocks marked
# `<!-- output -->` must be among the output of the page's commands.
. "$(dirname "$0")/farm.sh"
root=$(cd "$(dirname "$0")/../.." && pwd)

mapfile -t pages < <(cd "$root" && echo README.md && find docs -name '*.md' | LC_ALL=C sort)
clones=0
for page in "${pages[@]}"; do
  python3 "$root/tests/documents/check.py" --commands "$root/$page" >"$work/commands" ||
    fail "$page: see above"
  grep -q '[^[:space:]]' "$work/commands" || continue
  clone=$work/clone$((++clones))  # a short path, as sockets need
  mkdir "$clone"
  ln -s "$root/tests" "$root/deploy" "$clone/"
  # Runs in a subshell without `||`, which would switch off its `set -e`.
  set +e
  (set -eu; cd "$clone"; . "$work/commands") >"$work/commands.log" 2>&1 </dev/null
  status=$?
  set -e
  [ "$status" -eq 0 ] || fail "a command of $page failed"
  python3 "$root/tests/documents/check.py" --output "$root/$page" "$work/commands.log" ||
    fail "$page shows other output than its commands print"
  say "commands of $page: $(grep -c . "$work/commands") lines"
done
[ "$checks" -gt 0 ] || fail "no page has commands to run"
