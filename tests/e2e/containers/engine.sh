# Sourced by tests that run containers: podman with a separate configuration, and the image. Debian
# packages: podman runc iptables catatonit podman-compose golang-github-containernetworking-plugin-dnsname
# mmdebstrap dpkg-dev file
# shellcheck shell=bash
image=localhost/tessera:latest
bare_image=localhost/tessera-debian:12

ischroot && skip "a chroot cannot start containers"

# runc and cgroupfs work without systemd; the limits are below those of any host.
cat >"$work/containers.conf" <<'CONF'
[containers]
default_ulimits = ["nofile=1000:1000", "nproc=2000:2000"]
[engine]
runtime = "runc"
cgroup_manager = "cgroupfs"
events_logger = "file"
CONF
export CONTAINERS_CONF=$work/containers.conf

# base_image: prints the name of a bare Debian 12: TESSERA_BASE_IMAGE, else one made by mmdebstrap and
# kept, else that of Docker Hub.
base_image() {
  if [ -n "${TESSERA_BASE_IMAGE:-}" ]; then
    echo "$TESSERA_BASE_IMAGE"
  elif ! command -v mmdebstrap >/dev/null; then
    echo docker.io/library/debian:bookworm-slim
  else
    if ! podman image exists "$bare_image"; then
      mmdebstrap --variant=minbase bookworm "$work/debian.tar" >"$work/mmdebstrap.log" 2>&1 || return 1
      podman import "$work/debian.tar" "$bare_image" >"$work/import.log" 2>&1 || return 1
      rm "$work/debian.tar"
    fi
    echo "$bare_image"
  fi
}

# build_image [OPTION...]: $image by deploy/containers/Containerfile, with the compiler cache of this host
# if it has one.
build_image() {
  local base cache=()
  base=$(base_image) || fail "no base image"
  [ ! -d "$HOME/.cache/ccache" ] || cache=(--volume "$HOME/.cache/ccache:/root/.cache/ccache")
  podman build --isolation chroot --format docker --layers --build-arg "BASE=$base" "${cache[@]}" "$@" \
    -t "$image" -f "$root/deploy/containers/Containerfile" "$root"
}

# need_image: sets $image to an image with the packages of the build under test. Building it takes about a
# minute; it is kept until the programs change.
need_image() {
  local build digest old
  build=$(cd "$TESSERA_BIN/.." && pwd)
  digest=$(cat "$TESSERA_BIN"/tessera{,-server,-worker,-webhook} "$root"/deploy/containers/* | sha256sum)
  image=localhost/tessera-test:${digest:0:12}
  exec {image_lock}>"$build/image.lock"
  flock "$image_lock"  # tests run side by side
  if ! podman image exists "$image"; then
    (cd "$build" && cpack -G DEB -B "$work/packages") >"$work/cpack.log" 2>&1 || fail "cpack"
    build_image --build-context "packages=$work/packages" \
      >"$work/image.log" 2>&1 || fail "podman build"
    for old in $(podman image ls --format '{{.Repository}}:{{.Tag}}' localhost/tessera-test); do
      [ "$old" = "$image" ] || podman image rm "$old" >/dev/null 2>&1 || true
    done
  fi
  exec {image_lock}>&-
}
