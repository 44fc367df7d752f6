// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <stdexcept>
#include <string>

namespace variform {

/// What the process answers. Documented in docs/running.md; scripts depend on it.
enum class ExitCode : int {
  done = 0,
  claim_failed = 1,  ///< a claim did not hold under `reproduce`
  usage = 2,         ///< bad command line or bad config
  data = 3,          ///< bad input data (mesh files, constraints that do not fit the mesh)
  solver = 4,        ///< a solver failed
};

/// Base of every error the library throws on purpose. The message is complete: it names the file, line, element or
/// config key and what was expected.
class Error : public std::runtime_error {
 public:
  Error(ExitCode code, const std::string& message) : std::runtime_error(message), code_(code) {}
  ExitCode exit_code() const { return code_; }

 private:
  ExitCode code_;
};

/// A call or config that cannot be meant: unknown name, value out of range, incompatible choice.
class UsageError : public Error {
 public:
  explicit UsageError(const std::string& message) : Error(ExitCode::usage, message) {}
};

/// Input data that is broken or does not fit: truncated files, degenerate cells, contradictory constraints.
class DataError : public Error {
 public:
  explicit DataError(const std::string& message) : Error(ExitCode::data, message) {}
};

/// A solver could not deliver: matrix not positive definite, no convergence, residual too large.
class SolverError : public Error {
 public:
  explicit SolverError(const std::string& message) : Error(ExitCode::solver, message) {}
};

}  // namespace variform
