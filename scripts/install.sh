#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs every Debian package that variform builds and runs with (Debian 12; as root or with sudo). Quick when all are
# there. VARIFORM_EIGEN_ONLY=1 leaves out what the preset eigen-only does without.
set -euo pipefail

packages=(
  g++ cmake ninja-build ccache pkg-config
  libeigen3-dev libopenblas-dev libtbb-dev libboost-dev libboost-graph-dev libfmt-dev
  libtomlplusplus-dev libcli11-dev nlohmann-json3-dev libpugixml-dev zlib1g-dev
  libcairo2-dev fonts-dejavu-core gnuplot-nox libjs-three
  libgtest-dev libgmock-dev libbenchmark-dev
)
[ "${VARIFORM_EIGEN_ONLY:-0}" = 1 ] || packages+=(
  libsuitesparse-dev libceres-dev libnlopt-dev libpetsc-real-dev libslepc-real-dev libspectra-dev libarpack2-dev
  libsundials-dev
)

missing=()
for package in "${packages[@]}"; do
  dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null | grep -qx installed || missing+=("$package")
done
[ ${#missing[@]} -eq 0 ] && exit 0

sudo=()
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null || { echo "install.sh: needs root or sudo to install: ${missing[*]}" >&2; exit 1; }
  sudo=(sudo)
fi
echo "installing: ${missing[*]}"
export DEBIAN_FRONTEND=noninteractive
"${sudo[@]}" apt-get update -qq
"${sudo[@]}" apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
