#!/usr/bin/env bash
# Installs the Debian 12 packages that Tessera needs and that are missing.
#
#   deploy/install-deps.sh           packages to build, test, lint and fuzz
#   deploy/install-deps.sh --build   only packages to build and run the programs
#   deploy/install-deps.sh --list    print the names of all packages and install nothing
set -euo pipefail

build_packages=(
  # Tools.
  g++ cmake ninja-build ccache pkg-config
  # RPC, digests, compression, journal.
  libgrpc++-dev libgrpc-dev protobuf-compiler protobuf-compiler-grpc libprotobuf-dev libabsl-dev
  libssl-dev libzstd-dev libsqlite3-dev
  # Scenes and images.
  libtinygltf-dev nlohmann-json3-dev libdraco-dev libmeshoptimizer-dev
  libopenexr-dev libpng-dev libjpeg62-turbo-dev libwebp-dev
  # Threads, command lines, logs, metrics, webhooks.
  libtbb-dev libcli11-dev libspdlog-dev prometheus-cpp-dev libcurl4-openssl-dev
  # The renderer's sandbox, the server's memory allocator.
  libseccomp-dev libjemalloc-dev
)
test_packages=(
  libgtest-dev libgmock-dev libembree-dev
  clang-14 libclang-rt-14-dev clang-format-14 clang-tidy-14
  libopenimageio-dev openimageio-tools  # images from another library, as an oracle
  git python3 python3-numpy prometheus
  # End-to-end tests: Slurm, containers, systemd units, packages.
  slurmctld slurmd slurm-client munge
  podman podman-compose runc catatonit iptables containernetworking-plugins
  golang-github-containernetworking-plugin-dnsname
  systemd procps
  mmdebstrap lintian dpkg-dev file
)

packages=("${build_packages[@]}" "${test_packages[@]}")
case "${1:-}" in
  "") ;;
  --build) packages=("${build_packages[@]}") ;;
  --list)
    printf '%s\n' "${packages[@]}"
    exit 0
    ;;
  *)
    echo "usage: $0 [--build | --list]" >&2
    exit 2
    ;;
esac

if ! command -v apt-get >/dev/null || ! command -v dpkg-query >/dev/null; then
  echo "install-deps: apt not found; install these Debian packages or their equivalents:" "${packages[@]}" >&2
  exit 1
fi

missing=()
for package in "${packages[@]}"; do
  state=$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null || true)
  [ "$state" = installed ] || missing+=("$package")
done
if [ "${#missing[@]}" -eq 0 ]; then
  echo "install-deps: all ${#packages[@]} packages are installed"
  exit 0
fi

as_root=()
if [ "$(id -u)" -ne 0 ]; then
  if ! command -v sudo >/dev/null; then
    echo "install-deps: run as root, or install sudo, to install:" "${missing[@]}" >&2
    exit 1
  fi
  as_root=(sudo)
fi

echo "install-deps: installing ${#missing[@]} packages and their dependencies:" "${missing[@]}"
"${as_root[@]}" apt-get update -qq
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
  apt-get install -y -qq --no-install-recommends -o Dpkg::Use-Pty=0 "${missing[@]}" </dev/null >/dev/null
echo "install-deps: done"
