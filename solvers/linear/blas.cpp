// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/linear/blas.h"

#include <Eigen/Core>
#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <fstream>
#include <iterator>
#include <limits>
#include <string_view>

#include "framework/base/stopwatch.h"

// NOLINTNEXTLINE(readability-identifier-naming): the name that Fortran gives it
extern "C" void dgemm_(const char* transpose_a, const char* transpose_b, const int* m, const int* n, const int* k,
                       const double* alpha, const double* a, const int* lda, const double* b, const int* ldb,
                       const double* beta, double* c, const int* ldc);

namespace variform {

namespace {

/// A function that only OpenBLAS or OpenMP has, looked up at run time so that any BLAS can be linked; null if it is not
/// there.
template <class Function>
Function* runtime_function(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_DEFAULT, name));
}

std::string path_of_dgemm() {
  Dl_info info{};
  const bool found = dladdr(reinterpret_cast<void*>(&dgemm_), &info) != 0 && info.dli_fname != nullptr;
  return found ? info.dli_fname : "unknown";
}

double measure_gflops() {
  constexpr int kSize = 512;
  constexpr int kRepetitions = 5;
  const Eigen::MatrixXd a = Eigen::MatrixXd::Constant(kSize, kSize, 0.5);
  const Eigen::MatrixXd b = Eigen::MatrixXd::Constant(kSize, kSize, 0.25);
  Eigen::MatrixXd c = Eigen::MatrixXd::Zero(kSize, kSize);
  const double one = 1.0;
  const double zero = 0.0;
  double best = std::numeric_limits<double>::infinity();
  for (int i = 0; i < kRepetitions; ++i) {
    const Stopwatch watch;
    dgemm_("N", "N", &kSize, &kSize, &kSize, &one, a.data(), &kSize, b.data(), &kSize, &zero, c.data(), &kSize);
    best = std::min(best, watch.seconds());
  }
  return 2.0 * kSize * kSize * kSize / best * 1e-9;
}

bool contains_word(const std::string& text, std::string_view word) {
  const auto boundary = [&](std::size_t at) {
    return at >= text.size() || std::isspace(static_cast<unsigned char>(text[at])) != 0;
  };
  for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) {
    if ((at == 0 || boundary(at - 1)) && boundary(at + word.size())) return true;
  }
  return false;
}

}  // namespace

BlasInfo probe_blas() {
  BlasInfo info;
  auto* config = runtime_function<char*()>("openblas_get_config");
  auto* core = runtime_function<char*()>("openblas_get_corename");
  auto* threads = runtime_function<int()>("openblas_get_num_threads");
  info.implementation = config != nullptr ? config() : path_of_dgemm();
  info.core = core != nullptr ? core() : "unknown";
  if (threads != nullptr) info.threads = threads();
  info.gflops = measure_gflops();
  return info;
}

void set_blas_threads(int threads) {
  if (auto* set = runtime_function<void(int)>("openblas_set_num_threads")) set(std::max(threads, 1));
  // OpenMP is not linked here, but comes with CHOLMOD; without active levels every region has one thread.
  constexpr int kAnyLevels = 1 << 20;
  if (auto* set = runtime_function<void(int)>("omp_set_max_active_levels")) set(threads <= 1 ? 0 : kAnyLevels);
}

std::string blas_core_advice(const BlasInfo& info) {
  std::ifstream file("/proc/cpuinfo");
  return blas_core_advice(info.core, std::string(std::istreambuf_iterator<char>(file), {}));
}

std::string blas_core_advice(const std::string& core, const std::string& cpuinfo) {
  constexpr std::array kCoresWithoutAvx2 = std::to_array<std::string_view>(
      {"generic",       "katmai",    "coppermine", "northwood", "prescott",    "banias",     "core2",   "penryn",
       "atom",          "nano",      "dunnington", "nehalem",   "sandybridge", "athlon",     "opteron", "opteron_sse3",
       "opteron(sse3)", "barcelona", "bobcat",     "bulldozer", "piledriver",  "steamroller"});
  std::string lower = core;
  std::transform(lower.begin(), lower.end(), lower.begin(), [](unsigned char c) { return std::tolower(c); });
  const bool old_kernels =
      std::find(kCoresWithoutAvx2.begin(), kCoresWithoutAvx2.end(), lower) != kCoresWithoutAvx2.end();
  if (!old_kernels || !contains_word(cpuinfo, "avx2")) return {};
  const bool avx512 = contains_word(cpuinfo, "avx512f") && contains_word(cpuinfo, "avx512dq") &&
                      contains_word(cpuinfo, "avx512bw") && contains_word(cpuinfo, "avx512vl");
  const char* better = avx512 ? "SkylakeX" : contains_word(cpuinfo, "AuthenticAMD") ? "Zen" : "Haswell";
  return fmt::format(
      "OpenBLAS uses its {} kernels, but this CPU has {}: dense kernels lose a factor of 1.7 or more; set "
      "OPENBLAS_CORETYPE={} in the environment",
      core, avx512 ? "AVX-512" : "AVX2", better);
}

}  // namespace variform
