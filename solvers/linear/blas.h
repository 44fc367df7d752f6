// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace variform {

/// The BLAS that the process runs with: what dense blocks of the supernodal backends are as fast as.
struct BlasInfo {
  std::string implementation;  ///< version and build of OpenBLAS; for any other BLAS the path of the library
  std::string core;            ///< which kernels OpenBLAS chose for this CPU; "unknown" for any other BLAS
  int threads = -1;            ///< -1: unknown
  double gflops = 0.0;         ///< measured rate of a product of 512 x 512 matrices, best of a few
};

BlasInfo probe_blas();

/// Sets the number of threads that BLAS calls use from now on; does nothing for a BLAS other than OpenBLAS. With 1,
/// CHOLMOD's own loops stay on one thread, too: it asks OpenMP for four whatever the machine has, and where cores are
/// fewer or busy these wait for each other (1.4 to 2 times the time of a factorization on two busy cores).
void set_blas_threads(int threads);

/// Empty, or what is wrong with the kernels that OpenBLAS chose and what to do. Old versions choose kernels without
/// AVX2 for CPUs that they do not know (newer ones, virtual machines); that costs a factor of about 1.7 in dense
/// kernels.
std::string blas_core_advice(const BlasInfo& info);

/// The same for a CPU given by the text of /proc/cpuinfo.
std::string blas_core_advice(const std::string& core, const std::string& cpuinfo);

}  // namespace variform
