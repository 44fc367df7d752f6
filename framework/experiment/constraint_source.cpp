// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/constraint_source.h"

#include <Eigen/Geometry>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "framework/base/error.h"
#include "framework/experiment/config_keys.h"
#include "framework/experiment/selection.h"

namespace variform {
namespace {

double angle_of(const ConfigNode& node) { return node.number_or("rotate", 0.0) * std::numbers::pi / 180.0; }

Eigen::MatrixXd rotation(const ConfigNode& node, int dimension) {
  Eigen::MatrixXd Q = Eigen::MatrixXd::Identity(dimension, dimension);
  if (node.has("axis") && dimension != 3) node.at("axis").fail("an axis is for rotations in space");
  if (!node.has("rotate")) return Q;
  const double angle = angle_of(node);
  if (dimension == 2) {
    Q << std::cos(angle), -std::sin(angle), std::sin(angle), std::cos(angle);
  } else {
    Q = Eigen::AngleAxisd(angle, axis_of(node)).toRotationMatrix();
  }
  return Q;
}

// Angular velocity as a skew matrix.
Eigen::MatrixXd spin(const ConfigNode& node, int dimension) {
  Eigen::MatrixXd omega = Eigen::MatrixXd::Zero(dimension, dimension);
  if (node.has("axis") && dimension != 3) node.at("axis").fail("an axis is for rotations in space");
  if (!node.has("rotate")) return omega;
  const double angle = angle_of(node);
  if (dimension == 2) {
    omega << 0.0, -angle, angle, 0.0;
  } else {
    const Eigen::Vector3d w = angle * axis_of(node);
    omega << 0.0, -w[2], w[1], w[2], 0.0, -w[0], -w[1], w[0], 0.0;
  }
  return omega;
}

Matrix rows_of(const Matrix& values, const std::vector<Index>& rows) {
  Matrix result(static_cast<Eigen::Index>(rows.size()), values.cols());
  for (std::size_t i = 0; i < rows.size(); ++i) result.row(static_cast<Index>(i)) = values.row(rows[i]);
  return result;
}

// Where each vertex goes.
Matrix targets(const ConfigNode& node, const CoordinateFrame& image, const std::vector<Index>& vertices) {
  Matrix result = rows_of(image.points(), vertices);
  if (node.has("positions")) {
    const std::vector<ConfigNode> points = node.at("positions").elements();
    if (points.size() != vertices.size()) {
      node.at("positions")
          .fail(fmt::format("{} positions for {} vertices; expected [[x, y], ...], one for each", points.size(),
                            vertices.size()));
    }
    for (std::size_t i = 0; i < points.size(); ++i) result.row(static_cast<Index>(i)) = image.point(points[i]);
  } else if (node.has("move")) {
    const ConfigNode move = node.at("move");
    if (!move.value().is_table()) {
      result.rowwise() += image.vector(move);
    } else {
      move.accept_keys(config_section("[[constraint]] move, velocity").names());
      const Eigen::RowVectorXd about =
          move.has("about") ? image.point(move.at("about")) : Eigen::RowVectorXd(result.colwise().mean());
      const Eigen::MatrixXd Q = move.number_or("scale", 1.0) * rotation(move, image.dimension());
      result = ((result.rowwise() - about) * Q.transpose()).rowwise() + about;
      if (move.has("translate")) result.rowwise() += image.vector(move.at("translate"));
    }
  }
  return result;
}

// The velocity of each vertex.
Matrix velocities(const ConfigNode& node, const CoordinateFrame& place, const std::vector<Index>& vertices) {
  const Matrix x = rows_of(place.points(), vertices);
  Matrix result = Matrix::Zero(x.rows(), x.cols());
  if (!node.has("velocity")) return result;
  const ConfigNode velocity = node.at("velocity");
  if (!velocity.value().is_table()) {
    result.rowwise() += place.vector(velocity);
    return result;
  }
  velocity.accept_keys(config_section("[[constraint]] move, velocity").names());
  const int d = place.dimension();
  const Eigen::RowVectorXd about =
      velocity.has("about") ? place.point(velocity.at("about")) : Eigen::RowVectorXd(x.colwise().mean());
  const Eigen::MatrixXd rate = spin(velocity, d) + velocity.number_or("scale", 0.0) * Eigen::MatrixXd::Identity(d, d);
  result = (x.rowwise() - about) * rate.transpose();
  if (velocity.has("translate")) result.rowwise() += place.vector(velocity.at("translate"));
  return result;
}

}  // namespace

void check_constraints(const std::vector<ConfigNode>& nodes, bool velocities) {
  for (const ConfigNode& node : nodes) {
    std::vector<std::string> values = {"velocity"};
    std::vector<std::string> others = {"positions", "move"};
    if (!velocities) std::swap(values, others);
    std::vector<std::string> keys = config_section("[[constraint]]").names();
    for (const std::string& other : others) std::erase(keys, other);
    node.accept_keys(keys);
    const std::string kind = node.at("kind").string();
    if (kind != "hard" && kind != "soft" && kind != "identify" && kind != "linear") {
      node.at("kind").fail("expected hard, soft, identify or linear");
    }
    if (node.has("weight") && kind != "soft") node.at("weight").fail("only soft constraints have a weight");
    if ((node.has("weights") || node.has("value")) && kind != "linear")
      node.fail("'weights' and 'value' are for kind = \"linear\"");
    for (const std::string& key : values) {
      if (node.has(key) && kind != "hard" && kind != "soft")
        node.fail(fmt::format("'{}' is for kind = \"hard\" and \"soft\"", fmt::join(values, "' and '")));
    }
    if (node.has("positions") && node.has("move")) node.fail("expected either 'positions' or 'move'");
    check_selection(node);
    node.boolean_or("relative", false);
  }
}

LoadedConstraints load_constraints(const std::vector<ConfigNode>& nodes, const LoadedDomain& source,
                                   const ConstraintSpace& space) {
  const Domain& domain = source.domain;
  check_constraints(nodes, space.velocities);
  const Matrix& state = space.state.size() > 0 ? space.state : domain.positions();
  const Matrix stay = space.velocities ? Matrix::Zero(state.rows(), state.cols()) : state;
  LoadedConstraints loaded{Constraints(domain.vertex_count(), static_cast<int>(state.cols())), {}, {}, {}};
  for (const ConfigNode& node : nodes) {
    const std::string kind = node.at("kind").string();
    const bool relative = node.boolean_or("relative", false);
    const CoordinateFrame place(domain.positions(), relative);
    const CoordinateFrame image(state, relative);
    const std::vector<Index> vertices = selected_vertices(node, source, place, image);
    node.located([&] {
      if (kind == "identify") {
        if (vertices.size() < 2) throw UsageError("expected at least two vertices to identify");
        for (std::size_t i = 1; i < vertices.size(); ++i) loaded.constraints.identify(vertices[0], vertices[i]);
      } else if (kind == "linear") {
        const std::vector<double> weights = finite_numbers(node.at("weights"));
        if (std::all_of(weights.begin(), weights.end(), [](double w) { return w == 0.0; })) {
          node.at("weights").fail("expected a weight that is not 0");
        }
        const ConfigNode value = node.at("value");
        loaded.constraints.combine(vertices, weights, space.velocities ? place.vector(value) : image.point(value));
      } else {
        const Matrix to = space.velocities ? velocities(node, place, vertices) : targets(node, image, vertices);
        for (std::size_t i = 0; i < vertices.size(); ++i) {
          const Index v = vertices[i];
          const auto target = to.row(static_cast<Index>(i));
          if (kind == "soft") {
            loaded.constraints.attract(v, target, node.number_or("weight", 0.0));
            loaded.soft.push_back(v);
          } else {
            loaded.constraints.fix(v, target);
            const bool moves = (target - stay.row(v)).norm() > 1e-12 * image.diameter();
            (moves ? loaded.moved : loaded.fixed).push_back(v);
          }
        }
      }
      return 0;
    });
  }
  return loaded;
}

}  // namespace variform
