// SPDX-License-Identifier: BSD-3-Clause
#include "experiments/continuous_deformations/handle_source.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "framework/base/error.h"
#include "framework/experiment/config_keys.h"
#include "framework/experiment/selection.h"

namespace variform {
namespace {

const std::vector<std::string> kMotions = {"path", "velocity", "rotate", "bend", "linear"};
const std::vector<std::string> kCurves = {"line", "circle", "parabola", "polynomial", "spline"};

std::string name_of(const ConfigNode& node, std::size_t k) {
  return node.has("name") ? fmt::format("handle {} ({})", k, node.at("name").string()) : fmt::format("handle {}", k);
}

/// Runs an action on a table and puts the handle's name behind any error from it.
template <class Action>
void named(const ConfigNode& node, std::size_t k, const Action& action) {
  try {
    node.located([&] {
      action();
      return 0;
    });
  } catch (const Error& error) {
    const std::string name = node.value().is_table() && node.has("name") && !node.at("name").value().is_table()
                                 ? fmt::format(" (in handle {}, {})", k, node.at("name").value().text())
                                 : fmt::format(" (in handle {})", k);
    throw_error(error.exit_code(), error.what() + name);
  }
}

/// The one key of several that a table has. Throws UsageError where there is none or more than one.
std::string only_key(const ConfigNode& node, const std::vector<std::string>& keys) {
  std::vector<std::string> found;
  std::ranges::copy_if(keys, std::back_inserter(found), [&](const std::string& key) { return node.has(key); });
  if (found.size() != 1) {
    node.fail(fmt::format("expected exactly one of {}{}", fmt::join(keys, ", "),
                          found.empty() ? "" : fmt::format("; got {}", fmt::join(found, ", "))));
  }
  return found.front();
}

void require_true(const ConfigNode& node) {
  if (!node.boolean()) node.fail("expected true");
}

TimeInterval time_of(const ConfigNode& node) {
  const std::vector<double> ends = finite_numbers(node);
  if (ends.size() != 2) node.fail("expected [start, end]");
  const TimeInterval time{ends[0], ends[1]};
  node.located([&] {
    require_interval(time);
    return 0;
  });
  return time;
}

std::vector<WeightKnot> weight_of(const ConfigNode& node) {
  std::vector<WeightKnot> knots;
  for (const ConfigNode& entry : node.elements()) {
    const std::vector<double> numbers = finite_numbers(entry);
    if (numbers.size() != 2) entry.fail("expected [time, weight]");
    knots.push_back({numbers[0], numbers[1]});
  }
  return knots;
}

std::array<bool, 3> held_of(const ConfigNode& node) {
  std::array<bool, 3> held = {false, false, false};
  for (const ConfigNode& entry : node.elements()) {
    const std::string component = entry.string();
    if (component != "x" && component != "y" && component != "z") entry.fail("expected \"x\", \"y\" or \"z\"");
    bool& flag = held[static_cast<std::size_t>(component[0] - 'x')];
    if (flag) entry.fail("this component is there already");
    flag = true;
  }
  if (std::none_of(held.begin(), held.end(), [](bool h) { return h; })) node.fail("expected at least one component");
  return held;
}

double radians(const ConfigNode& node) { return node.at("degrees").number() * std::numbers::pi / 180.0; }

/// Rows of a list of points, each read by `read`.
template <class Read>
Matrix rows_of(const ConfigNode& node, const Read& read) {
  const std::vector<ConfigNode> entries = node.elements();
  Matrix rows;
  for (std::size_t k = 0; k < entries.size(); ++k) {
    const Eigen::RowVectorXd row = read(entries[k], k);
    if (k == 0) rows.resize(static_cast<Eigen::Index>(entries.size()), row.size());
    if (row.size() != rows.cols()) {
      entries[k].fail(fmt::format("expected {} coordinates as before, got {}", rows.cols(), row.size()));
    }
    rows.row(static_cast<Eigen::Index>(k)) = row;
  }
  return rows;
}

/// A curve that points alone give: all but circles.
std::unique_ptr<GuidanceCurve> curve_through(const std::string& kind, const ConfigNode& node, const Matrix& points,
                                             const TimeInterval& time) {
  return node.located([&] {
    if (kind == "line") return make_line(points, time);
    if (kind == "parabola") return make_parabola(points, time);
    if (kind == "polynomial") return make_polynomial(points, time);
    return make_spline(points, time);
  });
}

void accept_section(const ConfigNode& node, const std::string& section) {
  node.accept_keys(config_section(section).names());
}

/// Whether a list is nested at least this deep.
bool nested(const ConfigNode& node, int depth) {
  if (depth == 0) return true;
  if (!node.value().is_array()) return false;
  const std::vector<ConfigNode> entries = node.elements();
  return !entries.empty() && nested(entries.front(), depth - 1);
}

/// The matrices, or vectors, of a polynomial in time: one, or a list of them.
std::vector<ConfigNode> coefficients(const ConfigNode& node, int depth) {
  return nested(node, depth + 1) ? node.elements() : std::vector<ConfigNode>{node};
}

Eigen::RowVectorXd plain_point(const ConfigNode& node) {
  const std::vector<double> numbers = finite_numbers(node);
  if (numbers.size() != 2 && numbers.size() != 3) {
    node.fail(fmt::format("expected 2 or 3 coordinates, got {}", numbers.size()));
  }
  return Eigen::Map<const Eigen::RowVectorXd>(numbers.data(), static_cast<Eigen::Index>(numbers.size()));
}

/// What can be said of a motion without a mesh.
void check_motion(const ConfigNode& node, const std::string& kind) {
  const ConfigNode how = node.at(kind);
  const auto check_points = [&](const std::vector<std::string>& keys) {
    for (const std::string& key : keys) {
      if (how.has(key)) plain_point(how.at(key));
    }
  };
  if (kind == "velocity") {
    plain_point(how);
  } else if (kind == "path") {
    accept_section(how, "[[handle]] path");
    how.boolean_or("orient", false);
    const std::string curve = only_key(how, kCurves);
    const ConfigNode shape = how.at(curve);
    if (curve == "circle") {
      accept_section(shape, "[[handle]] circle");
      finite_numbers(shape.at("centre"));
      if (shape.has("from")) plain_point(shape.at("from"));
      if (!std::isfinite(radians(shape)) || radians(shape) == 0.0) shape.at("degrees").fail("expected an angle");
    } else {
      curve_through(curve, shape, rows_of(shape, [](const ConfigNode& n, std::size_t) { return plain_point(n); }), {});
    }
  } else if (kind == "rotate" || kind == "bend") {
    accept_section(how, kind == "rotate" ? "[[handle]] rotate" : "[[handle]] bend");
    if (!std::isfinite(radians(how))) how.at("degrees").fail("expected a finite number");
    check_points({"about", "from", "to"});
    if (kind == "bend") how.at("from");
  } else {
    accept_section(how, "[[handle]] linear");
    if (!how.has("A") && !how.has("b")) how.fail("expected 'A', 'b' or both");
    check_points({"about"});
    if (how.has("A") && !nested(how.at("A"), 2)) how.at("A").fail("expected a matrix as a list of rows");
    if (how.has("b") && !nested(how.at("b"), 1)) how.at("b").fail("expected a vector");
  }
}

void check_table(const ConfigNode& node) {
  accept_section(node, "[[handle]]");
  if (node.has("name")) node.at("name").string();
  check_selection(node);
  node.boolean_or("relative", false);
  if (node.has("held")) held_of(node.at("held"));
  std::vector<std::string> ways = kMotions;
  ways.insert(ways.begin(), "fixed");
  ways.push_back("segments");
  const std::string way = only_key(node, ways);
  if (way == "fixed") {
    require_true(node.at("fixed"));
    for (const char* key : {"time", "weight"}) {
      if (node.has(key)) node.at(key).fail("a fixed handle has none");
    }
    return;
  }
  if (node.has("time")) {
    if (way == "segments") node.at("time").fail("each segment has its own");
    time_of(node.at("time"));
  }
  if (node.has("weight")) {
    node.at("weight").located(
        [&] { return weighted(translate(SpacePoint::Zero(2), {}), weight_of(node.at("weight"))); });
  }
  if (way != "segments") return check_motion(node, way);
  const std::vector<ConfigNode> segments = node.at("segments").elements();
  if (segments.empty()) node.at("segments").fail("expected at least one segment");
  std::vector<MotionPointer> order;
  for (const ConfigNode& segment : segments) {
    accept_section(segment, "[[handle]] segments");
    std::vector<std::string> keys = kMotions;
    keys.push_back("back");
    const std::string kind = only_key(segment, keys);
    order.push_back(translate(SpacePoint::Zero(2), time_of(segment.at("time"))));
    if (kind == "back") {
      require_true(segment.at("back"));
      if (order.size() == 1) segment.at("back").fail("there is no segment before");
    } else {
      check_motion(segment, kind);
    }
  }
  node.at("segments").located([&] { return in_sequence(order); });
}

/// Reads the motions of one region.
class MotionReader {
 public:
  MotionReader(const CoordinateFrame& frame, const std::vector<Index>& vertices)
      : frame_(frame), mean_(SpacePoint::Zero(frame.dimension())) {
    for (const Index v : vertices) mean_ += frame.points().row(v).transpose();
    mean_ /= static_cast<double>(vertices.size());
  }

  MotionPointer read(const ConfigNode& node, const std::string& kind, const TimeInterval& time) const {
    const ConfigNode how = node.at(kind);
    return how.located([&] {
      if (kind == "path") return path(how, time);
      if (kind == "velocity") return translate(frame_.vector(how).transpose(), time);
      if (kind == "rotate") return rotate(point_or(how, "about", mean_), axis(how), radians(how) / time.length(), time);
      if (kind == "bend") {
        return bend(point(how.at("from")), point_or(how, "to", mean_), axis(how), radians(how), time);
      }
      return linear(how, time);
    });
  }

 private:
  int dimension() const { return frame_.dimension(); }
  SpacePoint point(const ConfigNode& node) const { return frame_.point(node).transpose(); }
  SpacePoint point_or(const ConfigNode& node, const std::string& key, const SpacePoint& otherwise) const {
    return node.has(key) ? point(node.at(key)) : otherwise;
  }

  /// Empty in the plane.
  SpacePoint axis(const ConfigNode& node) const {
    if (dimension() == 3) return axis_of(node);
    if (node.has("axis")) node.at("axis").fail("an axis is for rotations in space");
    return {};
  }

  MotionPointer path(const ConfigNode& node, const TimeInterval& time) const {
    const std::string kind = only_key(node, kCurves);
    const ConfigNode how = node.at(kind);
    std::shared_ptr<const GuidanceCurve> curve;
    if (kind == "circle") {
      curve = how.located([&] {
        return make_arc(point_or(how, "from", mean_), point(how.at("centre")), radians(how), axis(how), time);
      });
    } else {
      const Matrix points = rows_of(how, [&](const ConfigNode& entry, std::size_t k) {
        return kind == "polynomial" && k > 0 ? frame_.vector(entry) : frame_.point(entry);
      });
      curve = curve_through(kind, how, points, time);
    }
    return node.boolean_or("orient", false) ? follow_oriented(curve) : follow(curve);
  }

  /// v = A (x - about) + b.
  MotionPointer linear(const ConfigNode& node, const TimeInterval& time) const {
    const SpacePoint about = node.has("about") ? point(node.at("about")) : SpacePoint(SpacePoint::Zero(dimension()));
    std::vector<Eigen::MatrixXd> A;
    std::vector<SpacePoint> b;
    if (node.has("A")) {
      for (const ConfigNode& matrix : coefficients(node.at("A"), 2)) {
        const Matrix rows = rows_of(matrix, [&](const ConfigNode& row, std::size_t) {
          const std::vector<double> numbers = finite_numbers(row);
          return Eigen::RowVectorXd(
              Eigen::Map<const Eigen::RowVectorXd>(numbers.data(), static_cast<Eigen::Index>(numbers.size())));
        });
        if (rows.rows() != dimension() || rows.cols() != dimension()) {
          matrix.fail(fmt::format("expected a {0} x {0} matrix, got {1} x {2}", dimension(), rows.rows(), rows.cols()));
        }
        A.emplace_back(rows);
        b.emplace_back(-A.back() * about);
      }
    }
    if (node.has("b")) {
      const std::vector<ConfigNode> vectors = coefficients(node.at("b"), 1);
      b.resize(std::max(b.size(), vectors.size()), SpacePoint::Zero(dimension()));
      for (std::size_t k = 0; k < vectors.size(); ++k) b[k] += frame_.vector(vectors[k]).transpose();
    }
    return polynomial_field(A, b, time);
  }

  const CoordinateFrame& frame_;
  SpacePoint mean_;
};

MotionPointer motion_of(const ConfigNode& node, const MotionReader& reader, const TimeInterval& all_time) {
  if (node.has("fixed")) return nullptr;
  MotionPointer motion;
  if (node.has("segments")) {
    std::vector<MotionPointer> motions;
    for (const ConfigNode& segment : node.at("segments").elements()) {
      const TimeInterval time = time_of(segment.at("time"));
      motions.push_back(segment.has("back") ? reversed(motions.back(), time)
                                            : reader.read(segment, only_key(segment, kMotions), time));
    }
    motion = in_sequence(std::move(motions));
  } else {
    const TimeInterval time = node.has("time") ? time_of(node.at("time")) : all_time;
    motion = reader.read(node, only_key(node, kMotions), time);
  }
  return node.has("weight") ? weighted(motion, weight_of(node.at("weight"))) : motion;
}

}  // namespace

void check_handle_tables(const std::vector<ConfigNode>& nodes) {
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    named(nodes[k], k, [&] { check_table(nodes[k]); });
  }
}

std::vector<Handle> load_handles(const std::vector<ConfigNode>& nodes, const LoadedDomain& source,
                                 const TimeInterval& time) {
  check_handle_tables(nodes);
  std::vector<Handle> handles;
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    const ConfigNode& node = nodes[k];
    named(node, k, [&] {
      const CoordinateFrame frame(source.domain.positions(), node.boolean_or("relative", false));
      Handle handle{.name = name_of(node, k), .vertices = selected_vertices(node, source, frame, frame)};
      std::ranges::sort(handle.vertices);
      handle.vertices.erase(std::unique(handle.vertices.begin(), handle.vertices.end()), handle.vertices.end());
      if (node.has("held")) {
        handle.held = held_of(node.at("held"));
        if (frame.dimension() == 2 && handle.held[2]) node.at("held").fail("the mesh is planar and has no z");
      }
      handle.motion = motion_of(node, MotionReader(frame, handle.vertices), time);
      handles.push_back(std::move(handle));
      // One more at a time, so that a conflict is told where the second of the two stands.
      check_handles(handles, source.domain);
    });
  }
  return handles;
}

}  // namespace variform
