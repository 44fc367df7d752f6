// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <initializer_list>
#include <string>

#include "framework/base/error.h"
#include "integrators/shape/curve.h"

namespace variform::testing {

/// Points as the rows of a matrix.
inline Matrix rows(std::initializer_list<std::initializer_list<double>> points) {
  Matrix m(static_cast<Eigen::Index>(points.size()), static_cast<Eigen::Index>(points.begin()->size()));
  Eigen::Index i = 0;
  for (const auto& point : points) {
    Eigen::Index j = 0;
    for (const double x : point) m(i, j++) = x;
    ++i;
  }
  return m;
}

inline SpacePoint point(std::initializer_list<double> x) { return rows({x}).row(0).transpose(); }

/// What an action says when it throws an Error.
inline std::string message_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

}  // namespace variform::testing
