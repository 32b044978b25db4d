# Sourced by tests of containers: podman with settings of its own, and the image.
# shellcheck shell=bash
image=localhost/tessera:latest

# runc and cgroupfs work without systemd; the limits are below any host's.
cat >"$work/containers.conf" <<'CONF'
[containers]
default_ulimits = ["nofile=1000:1000", "nproc=2000:2000"]
[engine]
runtime = "runc"
cgroup_manager = "cgroupfs"
events_logger = "file"
CONF
export CONTAINERS_CONF=$work/containers.conf

# has_image: there is one, of programs of this version.
has_image() {
  podman image exists "$image" &&
    [ "$(podman run --rm --no-healthcheck --network none "$image" tessera --version | head -n 1)" = \
      "$(tessera --version | head -n 1)" ]
}

# build_image: $image of deploy/Containerfile, with this host's compiler cache if it has one.
build_image() {
  local base=${TESSERA_BASE_IMAGE:-docker.io/library/debian:bookworm-slim} cache=()
  [ ! -d "$HOME/.cache/ccache" ] || cache=(--volume "$HOME/.cache/ccache:/root/.cache/ccache")
  podman build --isolation chroot --format docker --layers --build-arg "BASE=$base" "${cache[@]}" \
    -t "$image" -f "$root/deploy/Containerfile" "$root"
}
