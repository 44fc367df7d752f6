// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <string>
#include <vector>

#include "framework/experiment/config.h"
#include "framework/experiment/domain_source.h"

/// What tables that name vertices and places ([[constraint]], [[handle]]) share.
namespace variform {

/// Throws DataError at the node: for what makes sense in a config, but not on this mesh.
[[noreturn]] void data_error(const ConfigNode& node, const std::string& what);

/// Throws UsageError unless the value is a list of finite numbers.
std::vector<double> finite_numbers(const ConfigNode& node);

/// Unit axis of the rotation in space that a table describes by `axis`. Throws UsageError when there is none.
Eigen::Vector3d axis_of(const ConfigNode& node);

/// Reads points, vectors and lengths, as they are or relative to the bounding box of some points: a point (a, b) then
/// is its lower left corner plus (a width, b height), and vectors and lengths are in units of its longest side.
class CoordinateFrame {
 public:
  /// Keeps a reference to the points (n x dimension).
  CoordinateFrame(const Matrix& points, bool relative);

  Eigen::RowVectorXd vector(const ConfigNode& node) const { return length_unit() * coordinates(node); }
  Eigen::RowVectorXd point(const ConfigNode& node) const { return placed(coordinates(node)); }
  double length(double value) const { return length_unit() * value; }

  Eigen::RowVectorXd placed(const Eigen::RowVectorXd& x) const {
    return relative_ ? Eigen::RowVectorXd(low_ + x.cwiseProduct(extent_)) : x;
  }
  int dimension() const { return dimension_; }
  const Matrix& points() const { return points_; }
  double diameter() const { return extent_.norm(); }

 private:
  double length_unit() const { return relative_ ? extent_.maxCoeff() : 1.0; }
  Eigen::RowVectorXd coordinates(const ConfigNode& node) const;

  const Matrix& points_;
  int dimension_;
  bool relative_;
  Eigen::RowVectorXd low_;
  Eigen::RowVectorXd extent_;
};

/// Throws UsageError unless the table has either `vertices`, not empty, or `select`.
void check_selection(const ConfigNode& node);

/// The vertices of the domain that a table names by `vertices` (numbers of the input) or `select`, in this order.
/// place: of the mesh; image: of the states, which may have another dimension, in which points of `select` may then be.
/// Throws UsageError for selections that make no sense, DataError for those that select nothing.
std::vector<Index> selected_vertices(const ConfigNode& node, const LoadedDomain& source, const CoordinateFrame& place,
                                     const CoordinateFrame& image);

}  // namespace variform
