// SPDX-License-Identifier: BSD-3-Clause
#ifdef VARIFORM_WITH_PETSC

#include "solvers/linear/petsc_session.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <functional>
#include <sstream>

#include "framework/base/error.h"

// There in programs that LeakSanitizer watches.
extern "C" {
void __lsan_disable() __attribute__((weak));  // NOLINT(bugprone-reserved-identifier): the sanitizer's name
void __lsan_enable() __attribute__((weak));   // NOLINT(bugprone-reserved-identifier): the sanitizer's name
}

namespace variform::petsc {

namespace {

// MPI leaves memory behind when it starts and ends, partly in plugins that are unloaded by the time leaks are looked
// for, so that no suppression can name them. What is allocated while this lives is not looked at.
class LeaksOfMpi {
 public:
  LeaksOfMpi() {
    if (__lsan_disable != nullptr) __lsan_disable();
  }
  ~LeaksOfMpi() {
    if (__lsan_enable != nullptr) __lsan_enable();
  }
  LeaksOfMpi(const LeaksOfMpi&) = delete;
  LeaksOfMpi& operator=(const LeaksOfMpi&) = delete;
};

pid_t initialized_by = 0;

PetscErrorCode collect(MPI_Comm /*communicator*/, int /*line*/, const char* function, const char* /*file*/,
                       PetscErrorCode code, PetscErrorType type, const char* message, void* context) {
  auto& text = *static_cast<std::string*>(context);
  if (type == PETSC_ERROR_INITIAL && text.empty()) {
    text = fmt::format("{} ({})", message != nullptr ? message : "", function != nullptr ? function : "");
  }
  return code;
}

// MPI belongs to the process that started it: a fork would wait for ever.
void finalize() {
  const LeaksOfMpi leaks;
  if (getpid() == initialized_by && PetscFinalizeCalled == PETSC_FALSE) PetscFinalize();
}

// Open MPI looks for daemons and networks, which takes most of the time that PETSc needs to start. Not where a launcher
// has started this process, and never against what the user has set.
void expect_one_process() {
  if (std::getenv("OMPI_COMM_WORLD_SIZE") != nullptr || std::getenv("PMIX_RANK") != nullptr) return;
  constexpr int kKeep = 0;
  setenv("OMPI_MCA_ess_singleton_isolated", "1", kKeep);
  setenv("OMPI_MCA_pml", "ob1", kKeep);
  setenv("OMPI_MCA_btl", "self", kKeep);
}

}  // namespace

void initialize() {
  if (initialized_by != 0 || PetscInitializeCalled == PETSC_TRUE) return;
  expect_one_process();
  std::vector<std::string> words = {"variform", "-skip_petscrc", "-no_signal_handler", "-options_left", "no"};
  std::vector<char*> pointers;
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  int count = static_cast<int>(words.size());
  char** arguments = pointers.data();
  const LeaksOfMpi leaks;
  if (const PetscErrorCode code = PetscInitialize(&count, &arguments, nullptr, nullptr); code != 0) {
    throw SolverError(fmt::format("PETSc does not start: error {}", static_cast<int>(code)));
  }
  initialized_by = getpid();
  std::atexit(finalize);
}

ErrorScope::ErrorScope() { PetscPushErrorHandler(collect, &message_); }
ErrorScope::~ErrorScope() { PetscPopErrorHandler(); }

void ErrorScope::check(PetscErrorCode code, const std::string& what) const {
  if (code == 0) return;
  const char* general = nullptr;
  PetscErrorMessage(code, &general, nullptr);
  throw SolverError(fmt::format("{}: {}{}{}", what,
                                general != nullptr ? general : fmt::format("PETSc error {}", static_cast<int>(code)),
                                message_.empty() ? "" : ": ", message_));
}

void Matrix::analyze(const SparseMatrix& A, MatrixKind kind, Index block_size) {
  if (A.rows() % block_size != 0) {
    throw UsageError(fmt::format("block_size = {} does not divide the {} unknowns", block_size, A.rows()));
  }
  symmetric_ = kind != MatrixKind::general;
  const int* starts = nullptr;
  const int* columns = nullptr;
  const double* values = nullptr;
  const auto take = [&](const auto& matrix) {
    starts = matrix.outerIndexPtr();
    columns = matrix.innerIndexPtr();
    values = matrix.valuePtr();
  };
  mat_.reset();
  rows_ = Rows();
  if (symmetric_) {
    full_.analyze(A, kind);
    take(full_.update(A));
  } else {
    rows_ = A;
    take(rows_);
  }
  run("PETSc matrix", [&] {
    // PETSc reads these only.
    PetscCall(MatCreateSeqAIJWithArrays(communicator(), static_cast<PetscInt>(A.rows()),
                                        static_cast<PetscInt>(A.cols()), const_cast<int*>(starts),
                                        const_cast<int*>(columns), const_cast<double*>(values), mat_.create()));
    PetscCall(MatSetBlockSize(mat_, block_size));
    if (symmetric_) PetscCall(MatSetOption(mat_, MAT_SYMMETRIC, PETSC_TRUE));
    if (kind == MatrixKind::spd) PetscCall(MatSetOption(mat_, MAT_SPD, PETSC_TRUE));
    return PetscErrorCode(0);
  });
}

void Matrix::update(const SparseMatrix& A) {
  if (symmetric_) {
    full_.update(A);
  } else {
    const Rows rows = A;
    std::copy(rows.valuePtr(), rows.valuePtr() + rows.nonZeros(), rows_.valuePtr());
  }
  // Asking for the values and giving them back says that they changed.
  run("PETSc matrix", [&] {
    PetscScalar* values = nullptr;
    PetscCall(MatSeqAIJGetArray(mat_, &values));
    PetscCall(MatSeqAIJRestoreArray(mat_, &values));
    PetscCall(MatAssemblyBegin(mat_, MAT_FINAL_ASSEMBLY));
    return MatAssemblyEnd(mat_, MAT_FINAL_ASSEMBLY);
  });
}

double Matrix::bytes() const {
  MatInfo info{};
  run("PETSc matrix", [&] { return MatGetInfo(mat_, MAT_LOCAL, &info); });
  return info.nz_used * (sizeof(double) + sizeof(PetscInt));
}

void VectorPair::resize(Index rows, Index columns) {
  run("PETSc vectors", [&] {
    PetscCall(VecCreateSeqWithArray(communicator(), 1, rows, nullptr, b_.create()));
    PetscCall(VecCreateSeqWithArray(communicator(), 1, columns, nullptr, x_.create()));
    return PetscErrorCode(0);
  });
}

std::string set_options(const std::string& options) {
  std::istringstream words(options);
  std::string first;
  words >> first;
  if (!first.empty() &&
      (first.size() < 2 || first[0] != '-' || std::isalpha(static_cast<unsigned char>(first[1])) == 0)) {
    throw UsageError(fmt::format("options = \"{}\": expected PETSc's syntax, for instance \"-pc_type gamg\"", options));
  }
  std::string prefix = fmt::format("variform_{:x}_", std::hash<std::string>()(options));
  run("PETSc options", [&] {
    PetscCall(PetscOptionsPrefixPush(nullptr, prefix.c_str()));
    const PetscErrorCode code = PetscOptionsInsertString(nullptr, options.c_str());
    PetscCall(PetscOptionsPrefixPop(nullptr));
    return code;
  });
  return prefix;
}

void check_options_used(const std::string& prefix) {
  std::string unused;
  run("PETSc options", [&] {
    PetscInt count = 0;
    char** names = nullptr;
    char** values = nullptr;
    PetscCall(PetscOptionsLeftGet(nullptr, &count, &names, &values));
    for (PetscInt i = 0; i < count; ++i) {
      const std::string name = names[i];
      if (name.compare(0, prefix.size(), prefix) == 0) unused += " -" + name.substr(prefix.size());
    }
    return PetscOptionsLeftRestore(nullptr, &count, &names, &values);
  });
  if (!unused.empty()) throw UsageError(fmt::format("options that nothing in PETSc asked for:{}", unused));
}

double multigrid_bytes(PC pc) {
  double bytes = -1.0;
  run("PETSc multigrid", [&] {
    PetscBool is_mg = PETSC_FALSE;
    PetscCall(PetscObjectTypeCompareAny(reinterpret_cast<PetscObject>(pc), &is_mg, PCMG, PCGAMG, ""));
    if (is_mg == PETSC_FALSE) return PetscErrorCode(0);
    bytes = 0.0;
    PetscInt levels = 0;
    PetscCall(PCMGGetLevels(pc, &levels));
    for (PetscInt level = 0; level < levels; ++level) {
      MatInfo info{};
      if (level > 0) {
        Mat interpolation = nullptr;
        PetscCall(PCMGGetInterpolation(pc, level, &interpolation));
        PetscCall(MatGetInfo(interpolation, MAT_LOCAL, &info));
        bytes += info.nz_used * (sizeof(double) + sizeof(PetscInt));
      }
      if (level + 1 < levels) {
        KSP smoother = nullptr;
        Mat A = nullptr;
        PetscCall(PCMGGetSmoother(pc, level, &smoother));
        PetscCall(KSPGetOperators(smoother, nullptr, &A));
        PetscCall(MatGetInfo(A, MAT_LOCAL, &info));
        bytes += info.nz_used * (sizeof(double) + sizeof(PetscInt));
      }
    }
    return PetscErrorCode(0);
  });
  return bytes;
}

}  // namespace variform::petsc

#endif
