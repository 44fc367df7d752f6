#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs what is missing, builds and passes the tests. PRESET: a configure preset (default release; ci, ci-sanitize,
# eigen-only, debug). With a folder of real meshes in VARIFORM_DATA (or ../shared/data beside the checkout) the tests
# that need them run too.
set -euo pipefail
cd "$(dirname "$0")/.."

preset="${PRESET:-release}"
scripts/install.sh
if [ -z "${VARIFORM_DATA:-}" ] && [ -d ../shared/data ]; then
  VARIFORM_DATA="$(cd ../shared/data && pwd)"
  export VARIFORM_DATA
fi
cmake --preset "$preset" -DVARIFORM_BUILD_TESTS=ON
cmake --build "build/$preset"
# One BLAS thread: repeatable numbers, and no fight for the cores with the parallel tests.
OPENBLAS_NUM_THREADS=1 ctest --test-dir "build/$preset" --output-on-failure -j "$(nproc)"
