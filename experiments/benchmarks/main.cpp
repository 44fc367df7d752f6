// SPDX-License-Identifier: BSD-3-Clause
#include <benchmark/benchmark.h>
#include <dlfcn.h>
#include <fmt/format.h>

#include "solvers/linear/blas.h"

namespace {

// CHOLMOD asks OpenMP for four threads whatever the machine has; where cores are fewer or busy they wait for each
// other. The library is not linked here, but comes with CHOLMOD.
void make_openmp_serial() {
  using SetLevels = void (*)(int);
  if (const auto set = reinterpret_cast<SetLevels>(dlsym(RTLD_DEFAULT, "omp_set_max_active_levels"))) set(0);
}

}  // namespace

int main(int argc, char** argv) {
  // More threads help the factorization only, and make all times depend on what else runs.
  variform::set_blas_threads(1);
  make_openmp_serial();
  const variform::BlasInfo blas = variform::probe_blas();
  benchmark::AddCustomContext("BLAS", fmt::format("{}, kernels {}, {} thread, {:.1f} GFLOP/s", blas.implementation,
                                                  blas.core, blas.threads, blas.gflops));
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
  return 0;
}
