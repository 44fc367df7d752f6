// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/eigen/eigen_backends.h"

#ifdef VARIFORM_WITH_ARPACK
#include <fmt/format.h>

#include <array>
#include <utility>
#include <vector>

// The C interface of ARPACK-NG, whose headers are not there in every installation.
extern "C" {
void dsaupd_c(int* ido, const char* bmat, int n, const char* which, int nev, double tol, double* resid, int ncv,
              double* v, int ldv, int* iparam, int* ipntr, double* workd, double* workl, int lworkl, int* info);
void dseupd_c(int rvec, const char* howmny, const int* select, double* d, double* z, int ldz, double sigma,
              const char* bmat, int n, const char* which, int nev, double tol, double* resid, int ncv, double* v,
              int ldv, int* iparam, int* ipntr, double* workd, double* workl, int lworkl, int* info);
}
#endif

namespace variform {

#ifdef VARIFORM_WITH_ARPACK

namespace {

/// ARPACK keeps its state in static variables: one thread at a time may use it.
class Arpack final : public EigenBackend {
 public:
  Arpack(std::string name, std::unique_ptr<LinearBackend> inner) : EigenBackend(std::move(name), std::move(inner)) {}

 private:
  Eigen::MatrixXd iterate(Index count, Index subspace, const Vector& start) override {
    const Index n = rows();
    Vector residual = start;
    Eigen::MatrixXd basis(n, subspace);
    Vector work = Vector::Zero(3 * static_cast<Eigen::Index>(n));
    const Index small_size = subspace * (subspace + 8);
    Vector small_work = Vector::Zero(small_size);
    std::array<int, 11> parameters{};
    std::array<int, 11> places{};
    parameters[0] = 1;  // exact shifts
    parameters[2] = options.max_iterations;
    parameters[3] = 1;
    parameters[6] = 3;  // shift and invert
    int task = 0;
    int info = 1;  // starts from residual
    while (true) {
      dsaupd_c(&task, "G", n, "LM", count, options.tolerance, residual.data(), subspace, basis.data(), n,
               parameters.data(), places.data(), work.data(), small_work.data(), small_size, &info);
      const auto x = [&](int which) { return work.segment(places[which] - 1, n); };
      if (task == -1) {
        x(1) = apply_inverse(apply_mass(x(0)));
      } else if (task == 1) {
        x(1) = apply_inverse(x(2));  // M x is there already
      } else if (task == 2) {
        x(1) = apply_mass(x(0));
      } else {
        break;
      }
    }
    mutable_report().iterations = parameters[2];
    if (info == 1 || parameters[4] < count) {
      fail(fmt::format("{} of {} eigenvalues converged to {:.3g} in {} iterations with {} vectors", parameters[4],
                       count, options.tolerance, parameters[2], subspace));
    }
    if (info != 0) fail(fmt::format("dsaupd answers {}", info));
    std::vector<int> select(static_cast<std::size_t>(subspace), 1);
    Vector values(count);
    Eigen::MatrixXd vectors(n, count);
    dseupd_c(1, "A", select.data(), values.data(), vectors.data(), n, report().shift, "G", n, "LM", count,
             options.tolerance, residual.data(), subspace, basis.data(), n, parameters.data(), places.data(),
             work.data(), small_work.data(), small_size, &info);
    if (info != 0) fail(fmt::format("dseupd answers {}", info));
    return vectors;
  }
};

}  // namespace

#endif

EigenBackendEntry describe_arpack() {
  EigenBackendEntry entry;
  entry.name = "arpack";
  entry.doc = "implicitly restarted Lanczos of ARPACK, the classic";
  entry.package = "libarpack2-dev";
  entry.option = "VARIFORM_ARPACK";
  entry.licence = "BSD-3-Clause";
#ifdef VARIFORM_WITH_ARPACK
  entry.make = [name = entry.name](std::unique_ptr<LinearBackend> inner) {
    return std::make_unique<Arpack>(name, std::move(inner));
  };
#endif
  return entry;
}

}  // namespace variform
