// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/constraint_source.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>

#include "framework/base/error.h"

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

// Reads points and lengths of one constraint, in mesh units or relative to the bounding box.
class Frame {
 public:
  Frame(const Domain& domain, bool relative) : dimension_(domain.ambient_dimension()), relative_(relative) {
    low_ = domain.positions().colwise().minCoeff();
    extent_ = domain.positions().colwise().maxCoeff() - low_;
  }

  Eigen::RowVectorXd vector(const ConfigNode& node) const { return length_unit() * coordinates(node); }
  Eigen::RowVectorXd point(const ConfigNode& node) const { return placed(coordinates(node)); }
  double length(double value) const { return length_unit() * value; }

  Eigen::RowVectorXd placed(const Eigen::RowVectorXd& x) const {
    return relative_ ? Eigen::RowVectorXd(low_ + x.cwiseProduct(extent_)) : x;
  }
  int dimension() const { return dimension_; }

 private:
  double length_unit() const { return relative_ ? extent_.maxCoeff() : 1.0; }

  Eigen::RowVectorXd coordinates(const ConfigNode& node) const {
    const std::vector<double> numbers = finite_numbers(node);
    if (static_cast<int>(numbers.size()) != dimension_) {
      node.fail(fmt::format("expected {} coordinates, got {}", dimension_, numbers.size()));
    }
    return Eigen::Map<const Eigen::RowVectorXd>(numbers.data(), dimension_);
  }

  int dimension_;
  bool relative_;
  Eigen::RowVectorXd low_;
  Eigen::RowVectorXd extent_;
};

Index nearest_vertex(const Domain& domain, const Eigen::RowVectorXd& point) {
  Index best = 0;
  (domain.positions().rowwise() - point).rowwise().squaredNorm().minCoeff(&best);
  return best;
}

std::vector<Index> selected(const ConfigNode& node, const Domain& domain, const Frame& frame) {
  node.accept_keys({"box", "near", "points", "circle", "boundary"});
  if (node.children().size() != 1) node.fail("expected exactly one of box, near, points, circle, boundary");
  const ConfigNode how = node.children().front();
  std::vector<Index> vertices;
  const auto keep_if = [&](const auto& inside) {
    for (Index v = 0; v < domain.vertex_count(); ++v) {
      if (inside(v)) vertices.push_back(v);
    }
  };
  const int d = frame.dimension();
  if (how.name() == "near") {
    vertices.push_back(nearest_vertex(domain, frame.point(how)));
  } else if (how.name() == "points") {
    for (const ConfigNode& point : how.elements()) vertices.push_back(nearest_vertex(domain, frame.point(point)));
  } else if (how.name() == "boundary") {
    if (!how.boolean()) how.fail("expected true");
    keep_if([&](Index v) { return domain.boundary_vertices()[v]; });
  } else {
    const std::vector<double> numbers = finite_numbers(how);
    const std::size_t wanted = how.name() == "box" ? 2 * d : d + 1;
    if (numbers.size() != wanted) how.fail(fmt::format("expected {} numbers, got {}", wanted, numbers.size()));
    const Eigen::RowVectorXd first = frame.placed(Eigen::Map<const Eigen::RowVectorXd>(numbers.data(), d));
    if (how.name() == "box") {
      const Eigen::RowVectorXd second = frame.placed(Eigen::Map<const Eigen::RowVectorXd>(numbers.data() + d, d));
      const double slack = 1e-9 * domain.diameter();
      keep_if([&](Index v) {
        return ((domain.positions().row(v) - first).array() >= -slack).all() &&
               ((domain.positions().row(v) - second).array() <= slack).all();
      });
    } else {
      const double radius = frame.length(numbers.back());
      keep_if([&](Index v) { return (domain.positions().row(v) - first).norm() <= radius; });
    }
  }
  if (vertices.empty()) data_error(how, "no vertex is selected");
  return vertices;
}

Eigen::MatrixXd rotation(const ConfigNode& node, int dimension) {
  Eigen::MatrixXd Q = Eigen::MatrixXd::Identity(dimension, dimension);
  if (!node.has("rotate")) return Q;
  if (dimension != 2) node.at("rotate").fail("rotations are for planar domains");
  const double angle = node.at("rotate").number() * std::numbers::pi / 180.0;
  Q << std::cos(angle), -std::sin(angle), std::sin(angle), std::cos(angle);
  return Q;
}

// Where each vertex goes.
Matrix targets(const ConfigNode& node, const Domain& domain, const Frame& frame, const std::vector<Index>& vertices) {
  const int d = frame.dimension();
  Matrix result(static_cast<Eigen::Index>(vertices.size()), d);
  for (std::size_t i = 0; i < vertices.size(); ++i)
    result.row(static_cast<Index>(i)) = domain.positions().row(vertices[i]);
  if (node.has("positions")) {
    const std::vector<ConfigNode> points = node.at("positions").elements();
    if (points.size() != vertices.size()) {
      node.at("positions").fail(fmt::format("{} positions for {} vertices", points.size(), vertices.size()));
    }
    for (std::size_t i = 0; i < points.size(); ++i) result.row(static_cast<Index>(i)) = frame.point(points[i]);
  } else if (node.has("move")) {
    const ConfigNode move = node.at("move");
    if (!move.value().is_table()) {
      result.rowwise() += frame.vector(move);
    } else {
      move.accept_keys({"translate", "rotate", "about", "scale"});
      const Eigen::RowVectorXd about =
          move.has("about") ? frame.point(move.at("about")) : Eigen::RowVectorXd(result.colwise().mean());
      const Eigen::MatrixXd Q = move.number_or("scale", 1.0) * rotation(move, d);
      result = ((result.rowwise() - about) * Q.transpose()).rowwise() + about;
      if (move.has("translate")) result.rowwise() += frame.vector(move.at("translate"));
    }
  }
  return result;
}

}  // namespace

void check_constraints(const std::vector<ConfigNode>& nodes) {
  for (const ConfigNode& node : nodes) {
    node.accept_keys({"kind", "vertices", "select", "relative", "positions", "move", "weight", "weights", "value"});
    const std::string kind = node.at("kind").string();
    if (kind != "hard" && kind != "soft" && kind != "identify" && kind != "linear") {
      node.at("kind").fail("expected hard, soft, identify or linear");
    }
    if (node.has("weight") && kind != "soft") node.at("weight").fail("only soft constraints have a weight");
    if ((node.has("weights") || node.has("value")) && kind != "linear")
      node.fail("'weights' and 'value' are for kind = \"linear\"");
    if ((node.has("positions") || node.has("move")) && kind != "hard" && kind != "soft")
      node.fail("'positions' and 'move' are for kind = \"hard\" and \"soft\"");
    if (node.has("positions") && node.has("move")) node.fail("expected either 'positions' or 'move'");
    if (node.has("vertices") == node.has("select")) node.fail("expected either 'vertices' or 'select'");
    if (node.has("vertices") && node.at("vertices").integers().empty())
      node.at("vertices").fail("expected at least one vertex");
    node.boolean_or("relative", false);
  }
}

LoadedConstraints load_constraints(const std::vector<ConfigNode>& nodes, const LoadedDomain& source) {
  const Domain& domain = source.domain;
  check_constraints(nodes);
  LoadedConstraints loaded{Constraints(domain.vertex_count(), domain.ambient_dimension()), {}, {}, {}};
  for (const ConfigNode& node : nodes) {
    const std::string kind = node.at("kind").string();
    const Frame frame(domain, node.boolean_or("relative", false));
    std::vector<Index> vertices;
    if (node.has("vertices")) {
      for (const ConfigNode& entry : node.at("vertices").elements()) {
        const Index v = entry.located([&] { return source.domain_vertex(entry.integer()); });
        if (v < 0) data_error(entry, fmt::format("vertex {} belongs to no cell", entry.integer()));
        vertices.push_back(v);
      }
    } else {
      vertices = selected(node.at("select"), domain, frame);
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
        loaded.constraints.combine(vertices, weights, frame.point(node.at("value")));
      } else {
        const Matrix to = targets(node, domain, frame, vertices);
        for (std::size_t i = 0; i < vertices.size(); ++i) {
          const Index v = vertices[i];
          const auto target = to.row(static_cast<Index>(i));
          if (kind == "soft") {
            loaded.constraints.attract(v, target, node.number_or("weight", 0.0));
            loaded.soft.push_back(v);
          } else {
            loaded.constraints.fix(v, target);
            const bool moves = (target - domain.positions().row(v)).norm() > 1e-12 * domain.diameter();
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
