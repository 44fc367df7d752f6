// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "framework/base/error.h"
#include "framework/base/types.h"

namespace variform::testing {

/// The symmetric matrix whose lower triangle is stored, dense.
inline Eigen::MatrixXd dense_symmetric(const SparseMatrix& lower) {
  const SparseMatrix full = lower.selfadjointView<Eigen::Lower>();
  return full;
}

/// What an error says; one with this code is expected.
template <class Call>
std::string message_of(const Call& call, ExitCode code) {
  try {
    call();
  } catch (const Error& error) {
    EXPECT_EQ(error.exit_code(), code) << error.what();
    return error.what();
  }
  ADD_FAILURE() << "no error";
  return {};
}

/// Names of parametrized tests by names of backends.
inline std::string test_name(const ::testing::TestParamInfo<std::string>& info) {
  std::string name = info.param;
  std::replace(name.begin(), name.end(), '.', '_');
  return name;
}

}  // namespace variform::testing
