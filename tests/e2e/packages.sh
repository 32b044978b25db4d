#!/usr/bin/env bash
# The Debian packages and the tarball of a build: contents, lintian, and a farm in a bare Debian 12.
#
#   packages.sh BUILD_DIR [ROOT.tar]
#
# Packs BUILD_DIR with CPack, installs the packages in a bare root (made with mmdebstrap, or ROOT.tar),
# runs the commands of the systemd units as their user, renders on that farm, upgrades with the farm's
# data in place, removes and purges. Then renders the same image with the tarball in a second root. Needs
# root, mmdebstrap, lintian and Debian's packages. Writes only to a scratch directory.
set -euo pipefail
build=$(cd "$1" && pwd)
source=$(cd "$(dirname "$0")/../.." && pwd)
work=$(mktemp -d /var/tmp/tessera-packages.XXXXXX)
pids=()
finish() {
  local status=$?
  for pid in "${pids[@]}"; do kill "$pid" 2>/dev/null || true; done
  wait 2>/dev/null || true
  [ "$status" -eq 0 ] || { tail -n 30 "$work"/*.log >&2 2>/dev/null || true; }
  for root in "$work"/root "$work"/tar-root; do
    for point in proc dev; do umount --recursive --lazy "$root/$point" 2>/dev/null || true; done
  done
  rm -rf --one-file-system "$work"
}
trap finish EXIT
say() { echo "packages: $*"; }
fail() { echo "packages: FAILED: $*" >&2; exit 1; }

for tool in mmdebstrap lintian cpack; do
  command -v $tool >/dev/null || { echo "SKIPPED: $tool is not installed"; exit 77; }
done

# pack VERSION: makes packages of that version in $work/VERSION.
pack() {
  (cd "$build" && cpack -G DEB -D CPACK_PACKAGE_VERSION="$1" -B "$work/$1" >"$work/cpack-$1.log" 2>&1)
  rm -rf "$work/$1/_CPack_Packages"
}
version=$(sed -n 's/^CMAKE_PROJECT_VERSION:STATIC=//p' "$build/CMakeCache.txt")
pack "$version"
for package in cli server worker; do
  [ -f "$work/$version/tessera-${package}_$version-1_amd64.deb" ] || fail "no package tessera-$package"
done
say "cpack made $(ls "$work/$version" | tr '\n' ' ')"

lintian --fail-on error --tag-display-limit 0 "$work/$version"/*.deb >"$work/lintian.log" 2>&1 ||
  fail "lintian: $(grep '^E:' "$work/lintian.log")"
say "lintian finds no error, $(grep -c '^W:' "$work/lintian.log" || true) warnings"

# bare_root DIR: creates a bare Debian 12 with /proc and /dev.
bare_root() {
  mkdir -p "$1"
  tar -C "$1" -xf "$base"
  mount -t proc proc "$1/proc"
  mount --rbind /dev "$1/dev" && mount --make-rslave "$1/dev"
  cp /etc/resolv.conf "$1/etc/resolv.conf"
}
base=${2:-$work/base.tar}
[ -f "$base" ] || mmdebstrap --variant=apt --mode=root bookworm "$base" >"$work/mmdebstrap.log" 2>&1
root=$work/root
bare_root "$root"
inside() { chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive "$@"; }
install_packages() {
  cp "$work/$1"/*.deb "$root/tmp/"
  inside apt-get update -qq >>"$work/apt.log" 2>&1
  inside sh -c "apt-get install -y -qq --no-install-recommends /tmp/*_$1-1_amd64.deb" >>"$work/apt.log" 2>&1 ||
    fail "apt-get install of $1"
}
install_packages "$version"
inside sh -c 'tessera --version && tessera-server --version && tessera-worker --version && tessera-webhook --version' \
  >"$work/versions.log" || fail "a program does not start"
grep -q "^tessera $version" "$work/versions.log" || fail "tessera does not say version $version"
for file in /etc/tessera/server.toml /etc/tessera/worker.env /usr/share/man/man1/tessera-render.1.gz \
  /usr/share/bash-completion/completions/tessera /usr/share/doc/tessera-server/copyright \
  /lib/systemd/system/tessera-server.service; do
  [ -e "$root$file" ] || fail "$file is not installed"
done
[ "$(stat -c '%U %a' --dereference "$root/var/lib/tessera" | cut -d' ' -f2)" = 700 ] || fail "/var/lib/tessera is not mode 700"
say "installed in a bare Debian 12; all four programs start"

# start UNIT INSTANCE: runs the unit's ExecStart as its user, with its directories and environment, like
# systemd, which a chroot does not have.
start() {
  local unit=$root/lib/systemd/system/$1
  inside sh -c 'install -d -o tessera -g tessera -m 0700 /run/tessera /var/lib/tessera /var/cache/tessera'
  sed -n 's/^Environment=//p' "$unit" | tr ' ' '\n' >"$root/tmp/$3.env"
  local command
  command=$(sed -n 's/^ExecStart=//p' "$unit" | sed "s/%i/$2/g; s/%H/host/g")
  printf '#!/bin/sh\nset -a\n. /tmp/%s.env\nfor f in /etc/tessera/%s.env; do [ ! -e $f ] || . $f; done\nexec %s\n' \
    "$3" "$3" "$command" >"$root/tmp/start-$3"
  chmod 755 "$root/tmp/start-$3"
  chroot "$root" env -i PATH=/usr/bin:/bin LC_ALL=C.UTF-8 setpriv --reuid tessera --regid tessera --clear-groups \
    --no-new-privs --inh-caps=-all /tmp/start-"$3" >"$work/$3.log" 2>&1 &
  pids+=($!)
}
socket=unix:/run/tessera/server.sock
as_user() { inside setpriv --reuid tessera --regid tessera --clear-groups env TESSERA_SERVER=$socket HOME=/tmp "$@"; }
await_farm() {
  for _ in $(seq 100); do
    kill -0 "${pids[@]}" 2>/dev/null || break
    as_user tessera workers 2>/dev/null | grep -q idle && return
    sleep 0.2
  done
  fail "no worker connects: $(tail -n 3 "$work/server.log" "$work/worker.log")"
}
cp "$source/tests/scenes/same_bits.gltf" "$root/tmp/scene.gltf"
# picture NAME: renders a frame on the farm and fetches it to /tmp/NAME/scene.exr.
picture() {
  as_user tessera submit /tmp/scene.gltf --size 96x64 --spp 16 --wait >>"$work/submit.log" 2>&1 &&
    as_user tessera fetch last -o "/tmp/$1" >>"$work/submit.log" 2>&1 || fail "the farm does not render"
}
# same PROGRAM IMAGE: checks that the image equals the first one bit for bit.
same() { inside "$1" compare "$2" /tmp/first/scene.exr --fail-above largest=0 >>"$work/submit.log" 2>&1; }
start tessera-server.service "" server
start tessera-worker@.service 1 worker
await_farm
picture first
say "the units' commands start, a worker connects, a frame is rendered"

# Upgrade with a farm's data in place: its job is kept.
for pid in "${pids[@]}"; do kill "$pid"; wait "$pid" 2>/dev/null || true; done
pids=()
echo '# changed by the administrator' >>"$root/etc/tessera/server.toml"
next=${version%.*}.$((${version##*.} + 1))
pack "$next"
install_packages "$next"
inside dpkg-query -W -f '${Version}\n' tessera-server | grep -q "^$next" || fail "not upgraded"
grep -q 'changed by the administrator' "$root/etc/tessera/server.toml" || fail "the upgrade overwrote server.toml"
start tessera-server.service "" server
start tessera-worker@.service 1 worker
await_farm
as_user tessera list | grep -q done || fail "the upgrade lost the finished job"
picture second
same tessera /tmp/second/scene.exr || fail "the image differs after the upgrade"
say "upgraded to $next: configuration and jobs kept, same picture"

for pid in "${pids[@]}"; do kill "$pid"; wait "$pid" 2>/dev/null || true; done
pids=()
inside apt-get remove -y -qq tessera-cli tessera-server tessera-worker >>"$work/apt.log" 2>&1
[ -d "$root/var/lib/tessera/store" ] || fail "removing deleted the store"
[ -e "$root/etc/tessera/server.toml" ] || fail "removing deleted the configuration"
# The other packages have no configuration files, so removing them left nothing to purge.
inside apt-get purge -y -qq tessera-server tessera-worker >>"$work/apt.log" 2>&1
left=$(inside sh -c 'ls -d /etc/tessera /var/lib/tessera /var/cache/tessera /usr/lib/tessera /usr/bin/tessera* 2>/dev/null' || true)
[ -z "$left" ] || fail "purging left $left"
say "removed with its data kept, purged without a trace"

# The tarball in a second bare root with only the runtime libraries.
(cd "$build" && cpack -G TZST -B "$work/tarball" >"$work/cpack-tar.log" 2>&1)
tarball=$work/tarball/tessera-$version-linux-x86_64.tar.zst
[ -f "$tarball" ] || fail "no $tarball"
libraries=$(for deb in "$work/$version"/*.deb; do dpkg-deb -f "$deb" Depends; done | tr ',' '\n' |
  sed 's/(.*//; s/|.*//; s/ //g' | sort -u | grep -v '^adduser$\|^tessera-')
inside apt-get install -y -qq --no-install-recommends $libraries >>"$work/apt.log" 2>&1
zstd -dc "$tarball" | tar -C "$root/opt" -x
inside sh -c "cd /tmp && /opt/tessera-$version-linux-x86_64/bin/tessera render scene.gltf --size 96x64 --spp 16 -o third.exr --force" \
  >>"$work/submit.log" 2>&1 || fail "the tarball's tessera does not render"
same "/opt/tessera-$version-linux-x86_64/bin/tessera" /tmp/third.exr ||
  fail "the image of the tarball's programs differs"
say "the tarball renders the same picture from /opt"
