// SPDX-License-Identifier: BSD-3-Clause
#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include "solvers/linear/blas.h"

int main(int argc, char** argv) {
  // More threads help the factorization only, and make all times depend on what else runs.
  variform::set_blas_threads(1);
  const variform::BlasInfo blas = variform::probe_blas();
  benchmark::AddCustomContext("BLAS", fmt::format("{}, kernels {}, {} thread, {:.1f} GFLOP/s", blas.implementation,
                                                  blas.core, blas.threads, blas.gflops));
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
  return 0;
}
