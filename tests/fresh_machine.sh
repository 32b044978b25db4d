#!/usr/bin/env bash
# Shows that a clone is sufficient: creates a minimal Debian 12 in a directory, copies a clone of HEAD into
# it, and runs deploy/quickstart.sh and tests/run.sh there.
#
#   tests/fresh_machine.sh FOLDER [LOG]      as root, with debootstrap and git; FOLDER must not exist
#
# MIRROR: Debian mirror (default: that of this machine's apt). LOG: Markdown file for the output, without the
# progress lines of the build. CACHE: ccache directory to share with the new machine; it saves the compilation
# of unchanged files, so the times are not those of a first build.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
folder=${1:?where to make the machine}
log=${2:-/dev/null}
[ ! -e "$folder" ] || { echo "fresh_machine: $folder exists" >&2; exit 2; }
mirror=${MIRROR:-$(apt-get indextargets --format '$(REPO_URI)' 'Codename: bookworm' | head -n 1)}

debootstrap --variant=minbase bookworm "$folder" "$mirror" >/dev/null
cp /etc/resolv.conf "$folder/etc/"
echo "127.0.0.1 localhost" >"$folder/etc/hosts"  # an installer writes it, debootstrap does not
: >"$folder/etc/apt/sources.list"  # what debootstrap wrote; this machine's list follows
find /etc/apt/sources.list.d -name 'debian*.sources' -exec cp {} "$folder/etc/apt/sources.list.d/" \;
git clone -q "$root" "$folder$root"  # at the same path, which compiler caches look at
mount -t proc proc "$folder/proc"
trap 'umount --lazy "$folder/proc"' EXIT
if [ -n "${CACHE:-}" ]; then
  mkdir -p "$folder/root/.cache/ccache"
  mount --bind "$CACHE" "$folder/root/.cache/ccache"
  trap 'umount --lazy "$folder/proc" "$folder/root/.cache/ccache"' EXIT
fi

inside() {
  chroot "$folder" /usr/bin/env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 \
    bash -c "cd $root && $1" </dev/null 2>&1
}

{
  echo "# A fresh machine"
  echo
  echo "What \`tests/fresh_machine.sh\` printed: a minimal Debian 12 (debootstrap, $(
    inside 'dpkg-query -f . -W | wc -c') packages), $(nproc) cores, a clone of commit"
  echo "$(git -C "$root" rev-parse --short HEAD), nothing else installed${CACHE:+ (a compiler cache was lent)}. Build progress is left out."
  for command in deploy/quickstart.sh tests/run.sh; do  # the quick start installs fewer packages
    echo
    echo "## \`$command\`"
    echo
    echo '```'
    start=$SECONDS
    status=0
    inside "$command" >"$folder/root/log" || status=$?
    # Omits the progress of ninja and apt and the lines of passed tests, thousands of lines.
    grep -vE '^\[[0-9]+/[0-9]+\]|^ *[0-9]+/[0-9]+ Test|^ +Start +[0-9]+:|^debconf|invoke-rc.d|https?://' \
      "$folder/root/log" | sed "s/\r/\n/g; s#$root#~/tessera#g" | tail -n 60
    echo '```'
    echo
    echo "Exit code $status after $((SECONDS - start)) s."
    [ "$status" -eq 0 ] || { tail -n 80 "$folder/root/log" >&2; exit "$status"; }
  done
} | tee "$log"
