// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/constraint_source.h"

#include <Eigen/Geometry>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>

#include "framework/base/error.h"
#include "framework/experiment/config_keys.h"

namespace variform {
namespace {

// For what makes sense in a config, but not on this mesh.
[[noreturn]] void data_error(const ConfigNode& node, const std::string& what) {
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

// Reads points and lengths of one constraint, in units of the points given or relative to their bounding box.
class Frame {
 public:
  Frame(const Matrix& points, bool relative)
      : points_(points), dimension_(static_cast<int>(points.cols())), relative_(relative) {
    low_ = points.colwise().minCoeff();
    extent_ = points.colwise().maxCoeff() - low_;
  }

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

  Eigen::RowVectorXd coordinates(const ConfigNode& node) const {
    const std::vector<double> numbers = finite_numbers(node);
    if (static_cast<int>(numbers.size()) != dimension_) {
      node.fail(fmt::format("expected {} coordinates, got {}", dimension_, numbers.size()));
    }
    return Eigen::Map<const Eigen::RowVectorXd>(numbers.data(), dimension_);
  }

  const Matrix& points_;
  int dimension_;
  bool relative_;
  Eigen::RowVectorXd low_;
  Eigen::RowVectorXd extent_;
};

// The space that points are given in: that of the mesh, unless their count of numbers is that of a point of the state.
const Frame& frame_of(const ConfigNode& node, const Frame& place, const Frame& image, int points, int extra) {
  const auto numbers = static_cast<int>(node.numbers().size());
  const bool in_image = numbers == points * image.dimension() + extra && place.dimension() != image.dimension();
  return in_image ? image : place;
}

// A point that is farther from the mesh, by its diameter, is a mistake.
constexpr double kFarAway = 0.5;

Index nearest_vertex(const Frame& frame, const Eigen::RowVectorXd& point) {
  Index best = 0;
  (frame.points().rowwise() - point).rowwise().squaredNorm().minCoeff(&best);
  return best;
}

std::vector<Index> selected(const ConfigNode& node, const Domain& domain, const Frame& place, const Frame& image) {
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
    const Frame& frame = frame_of(node_of_point, place, image, 1, 0);
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
    const Frame& frame = frame_of(how, place, image, box ? 2 : 1, box ? 0 : 1);
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

double angle_of(const ConfigNode& node) { return node.number_or("rotate", 0.0) * std::numbers::pi / 180.0; }

// Unit axis of a rotation in space.
Eigen::Vector3d axis_of(const ConfigNode& node) {
  if (!node.has("axis")) node.at("rotate").fail("a rotation in space needs an axis = [x, y, z]");
  const std::vector<double> numbers = finite_numbers(node.at("axis"));
  if (numbers.size() != 3) node.at("axis").fail("expected 3 numbers");
  const Eigen::Vector3d axis(numbers[0], numbers[1], numbers[2]);
  if (!(axis.norm() > 0.0)) node.at("axis").fail("expected a direction");
  return axis.normalized();
}

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
Matrix targets(const ConfigNode& node, const Frame& image, const std::vector<Index>& vertices) {
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
Matrix velocities(const ConfigNode& node, const Frame& place, const std::vector<Index>& vertices) {
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
    if (node.has("vertices") == node.has("select")) node.fail("expected either 'vertices' or 'select'");
    if (node.has("vertices") && node.at("vertices").integers().empty())
      node.at("vertices").fail("expected at least one vertex");
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
    const Frame place(domain.positions(), relative);
    const Frame image(state, relative);
    std::vector<Index> vertices;
    if (node.has("vertices")) {
      for (const ConfigNode& entry : node.at("vertices").elements()) {
        const Index v = entry.located([&] { return source.domain_vertex(entry.integer()); });
        if (v < 0) data_error(entry, fmt::format("vertex {} belongs to no cell", entry.integer()));
        vertices.push_back(v);
      }
    } else {
      vertices = selected(node.at("select"), domain, place, image);
    }
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
