#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs what is missing, builds, runs the main job and says where its report is. Arguments go to `variform run`.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/install.sh
cmake --preset release
cmake --build build/release --target variform_cli

build/release/bin/variform run experiments/smoothed_energies/demo.toml --out runs/demo "$@"
