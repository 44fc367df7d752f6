// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/selection.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "framework/base/error.h"
#include "framework/experiment/config_keys.h"

namespace variform {
namespace {

// The space that points are given in: that of the mesh, unless their count of numbers is that of a point of the state.
const CoordinateFrame& frame_of(const ConfigNode& node, const CoordinateFrame& place, const CoordinateFrame& image,
                                int points, int extra) {
  const auto numbers = static_cast<int>(node.numbers().size());
  const bool in_image = numbers == points * image.dimension() + extra && place.dimension() != image.dimension();
  return in_image ? image : place;
}

// A point that is farther from the mesh, by its diameter, is a mistake.
constexpr double kFarAway = 0.5;

Index nearest_vertex(const CoordinateFrame& frame, const Eigen::RowVectorXd& point) {
  Index best = 0;
  (frame.points().rowwise() - point).rowwise().squaredNorm().minCoeff(&best);
  return best;
}

std::vector<Index> selected(const ConfigNode& node, const Domain& domain, const CoordinateFrame& place,
                            const CoordinateFrame& image) {
  const std::vector<std::string> ways = config_section("[[constraint]] select").names();
  node.accept_keys(ways);
  if (node.children().size() != 1) node.fail(fmt::format("expected exactly one of {}", fmt::join(ways, ", ")));
  const ConfigNode how = node.children().front();
  std::vector<Index> vertices;
  const auto keep_if = [&](const auto& inside) {
    for (Index v = 0; v < domain.vertex_count(); ++v) {
      if (inside(v)) vertices.push_back(v);
    }
  };
  const auto nearest = [&](const ConfigNode& node_of_point) {
    const CoordinateFrame& frame = frame_of(node_of_point, place, image, 1, 0);
    const Eigen::RowVectorXd point = frame.point(node_of_point);
    const Index v = nearest_vertex(frame, point);
    const double distance = (frame.points().row(v) - point).norm();
    if (distance > kFarAway * frame.diameter()) {
      data_error(node_of_point,
                 fmt::format("the nearest vertex, {}, is {:.3g} away, and the {} only {:.3g} across", v, distance,
                             &frame == &image && &frame != &place ? "map is" : "mesh is", frame.diameter()));
    }
    vertices.push_back(v);
  };
  if (how.name() == "near") {
    nearest(how);
  } else if (how.name() == "points") {
    for (const ConfigNode& point : how.elements()) nearest(point);
  } else if (how.name() == "boundary") {
    if (!how.boolean()) how.fail("expected true");
    keep_if([&](Index v) { return domain.boundary_vertices()[v]; });
  } else {
    const bool box = how.name() == "box";
    const CoordinateFrame& frame = frame_of(how, place, image, box ? 2 : 1, box ? 0 : 1);
    const int d = frame.dimension();
    const std::vector<double> numbers = finite_numbers(how);
    const std::size_t wanted = box ? 2 * d : d + 1;
    if (numbers.size() != wanted) how.fail(fmt::format("expected {} numbers, got {}", wanted, numbers.size()));
    const Eigen::RowVectorXd first = frame.placed(Eigen::Map<const Eigen::RowVectorXd>(numbers.data(), d));
    if (box) {
      const Eigen::RowVectorXd second = frame.placed(Eigen::Map<const Eigen::RowVectorXd>(numbers.data() + d, d));
      const double slack = 1e-9 * frame.diameter();
      keep_if([&](Index v) {
        return ((frame.points().row(v) - first).array() >= -slack).all() &&
               ((frame.points().row(v) - second).array() <= slack).all();
      });
    } else {
      const double radius = frame.length(numbers.back());
      keep_if([&](Index v) { return (frame.points().row(v) - first).norm() <= radius; });
    }
  }
  if (vertices.empty()) data_error(how, "no vertex is selected");
  return vertices;
}

}  // namespace

void data_error(const ConfigNode& node, const std::string& what) {
  node.located([&]() -> int { throw DataError(what); });
  std::abort();  // not reached
}

std::vector<double> finite_numbers(const ConfigNode& node) {
  std::vector<double> numbers = node.numbers();
  if (!std::all_of(numbers.begin(), numbers.end(), [](double x) { return std::isfinite(x); })) {
    node.fail("expected finite numbers");
  }
  return numbers;
}

Eigen::Vector3d axis_of(const ConfigNode& node) {
  if (!node.has("axis"))
    (node.has("rotate") ? node.at("rotate") : node).fail("a rotation in space needs an axis = [x, y, z]");
  const std::vector<double> numbers = finite_numbers(node.at("axis"));
  if (numbers.size() != 3) node.at("axis").fail("expected 3 numbers");
  const Eigen::Vector3d axis(numbers[0], numbers[1], numbers[2]);
  if (!(axis.norm() > 0.0)) node.at("axis").fail("expected a direction");
  return axis.normalized();
}

CoordinateFrame::CoordinateFrame(const Matrix& points, bool relative)
    : points_(points), dimension_(static_cast<int>(points.cols())), relative_(relative) {
  low_ = points.colwise().minCoeff();
  extent_ = points.colwise().maxCoeff() - low_;
}

Eigen::RowVectorXd CoordinateFrame::coordinates(const ConfigNode& node) const {
  const std::vector<double> numbers = finite_numbers(node);
  if (static_cast<int>(numbers.size()) != dimension_) {
    node.fail(fmt::format("expected {} coordinates, got {}", dimension_, numbers.size()));
  }
  return Eigen::Map<const Eigen::RowVectorXd>(numbers.data(), dimension_);
}

void check_selection(const ConfigNode& node) {
  if (node.has("vertices") == node.has("select")) node.fail("expected either 'vertices' or 'select'");
  if (node.has("vertices") && node.at("vertices").integers().empty()) {
    node.at("vertices").fail("expected at least one vertex");
  }
}

std::vector<Index> selected_vertices(const ConfigNode& node, const LoadedDomain& source, const CoordinateFrame& place,
                                     const CoordinateFrame& image) {
  if (node.has("select")) return selected(node.at("select"), source.domain, place, image);
  std::vector<Index> vertices;
  for (const ConfigNode& entry : node.at("vertices").elements()) {
    const Index v = entry.located([&] { return source.domain_vertex(entry.integer()); });
    if (v < 0) data_error(entry, fmt::format("vertex {} belongs to no cell", entry.integer()));
    vertices.push_back(v);
  }
  return vertices;
}

}  // namespace variform
