// SPDX-License-Identifier: BSD-3-Clause
#include "experiments/continuous_deformations/measurements.h"

#include <Eigen/Dense>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <tuple>

#include "experiments/smoothed_energies/study.h"
#include "framework/base/error.h"
#include "framework/operators/distortion.h"
#include "framework/operators/rotation.h"

namespace variform {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;
// Coordinates that differ by less, relative to the diameter, are the same.
constexpr double kSame = 1e-9;

const std::vector<std::string> kCoordinates = {"", "x", "y", "z"};

int coordinate(const std::string& name) { return name == "x" ? 0 : name == "y" ? 1 : 2; }

// Row vectors of space: planar positions get z = 0.
Eigen::Vector3d in_space(const Eigen::Ref<const Eigen::RowVectorXd>& point) {
  Eigen::Vector3d result = Eigen::Vector3d::Zero();
  result.head(point.size()) = point.transpose();
  return result;
}

Eigen::Vector3d in_space(const std::vector<double>& numbers, std::size_t first, int d) {
  Eigen::Vector3d result = Eigen::Vector3d::Zero();
  for (int c = 0; c < d; ++c) result[c] = numbers[first + static_cast<std::size_t>(c)];
  return result;
}

bool in_box(const Eigen::RowVectorXd& point, const std::vector<double>& box) {
  const auto d = static_cast<std::size_t>(point.size());
  for (std::size_t c = 0; c < d; ++c) {
    const double x = point[static_cast<Eigen::Index>(c)];
    if (!(x >= box[c] && x <= box[d + c])) return false;
  }
  return true;
}

// Cells whose centroid is in a box.
std::vector<Index> cells_in(const Domain& domain, const std::vector<double>& box) {
  std::vector<Index> cells;
  for (Index t = 0; t < domain.cell_count(); ++t) {
    Eigen::RowVectorXd centroid = Eigen::RowVectorXd::Zero(domain.ambient_dimension());
    for (int i = 0; i < domain.cell_size(); ++i) {
      centroid += domain.positions().row(domain.cells()(t, i)) / domain.cell_size();
    }
    if (in_box(centroid, box)) cells.push_back(t);
  }
  return cells;
}

// Weighted by rest measure over the cells of a region, and the largest value.
void measure_region(const Domain& domain, const CellDistortion& cells, const std::vector<double>& box, Row& row) {
  double rest = 0.0;
  double now = 0.0;
  std::map<std::string, double> sums = {{"isom", 0.0}, {"conf", 0.0}, {"auth", 0.0}, {"metr", 0.0}};
  double largest = 0.0;
  for (const Index t : cells_in(domain, box)) {
    const double weight = domain.cell_measures()[t];
    rest += weight;
    now += weight * cells.determinant[t];
    sums["isom"] += weight * cells.isometric[t];
    sums["conf"] += weight * cells.conformal[t];
    sums["auth"] += weight * cells.authalic[t];
    sums["metr"] += weight * cells.metric[t];
    largest = std::max(largest, cells.metric[t]);
  }
  row.set("region_area_ratio", now / rest);
  row.set("region_area_change", std::abs(now / rest - 1.0));
  for (const auto& [name, sum] : sums) row.set("region_E_" + name, sum / rest);
  row.set("region_E_metr_max", largest);
}

std::vector<Index> vertices_on(const Domain& domain, const std::vector<double>& line) {
  const int d = domain.ambient_dimension();
  const Eigen::Vector3d from = in_space(line, 0, d);
  const Eigen::Vector3d along = in_space(line, static_cast<std::size_t>(d), d) - from;
  const double close = kSame * domain.diameter();
  std::vector<std::pair<double, Index>> found;
  if (!(along.norm() > close)) return {};
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    const Eigen::Vector3d x = in_space(domain.positions().row(v)) - from;
    const double s = x.dot(along) / along.squaredNorm();
    if (!(s >= -kSame && s <= 1.0 + kSame) || (x - s * along).norm() > close) continue;
    found.emplace_back(s, v);
  }
  std::sort(found.begin(), found.end());
  std::vector<Index> vertices;
  for (const auto& [s, v] : found) vertices.push_back(v);
  return vertices;
}

double length_of(const Matrix& X, const std::vector<Index>& path) {
  double length = 0.0;
  for (std::size_t i = 1; i < path.size(); ++i) length += (X.row(path[i]) - X.row(path[i - 1])).norm();
  return length;
}

// Angle that a path turns about an axis from its first to its last vertex, in degrees.
double turn_of(const Matrix& X, const std::vector<Index>& path, const Eigen::Vector3d& axis,
               const Eigen::Vector3d& about) {
  const Eigen::Vector3d z = axis.normalized();
  double angle = 0.0;
  Eigen::Vector3d before = Eigen::Vector3d::Zero();
  for (const Index v : path) {
    Eigen::Vector3d arm = in_space(X.row(v)) - about;
    arm -= arm.dot(z) * z;
    if (v != path.front()) angle += std::atan2(z.dot(before.cross(arm)), before.dot(arm));
    before = arm;
  }
  return angle * kDegrees;
}

// Largest distance of a state from its mirror image; rest shapes without the symmetry have none.
double asymmetry(const Domain& domain, const Matrix& X, int axis) {
  const Matrix& rest = domain.positions();
  const double grid = 1e-6 * domain.diameter();
  const double middle = 0.5 * (rest.col(axis).minCoeff() + rest.col(axis).maxCoeff());
  using Key = std::tuple<std::int64_t, std::int64_t, std::int64_t>;
  const auto key = [grid](const Eigen::Vector3d& p) {
    return Key{std::llround(p[0] / grid), std::llround(p[1] / grid), std::llround(p[2] / grid)};
  };
  std::map<Key, Index> places;
  for (Index v = 0; v < domain.vertex_count(); ++v) places.emplace(key(in_space(rest.row(v))), v);
  double largest = 0.0;
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    Eigen::Vector3d mirrored = in_space(rest.row(v));
    mirrored[axis] = 2.0 * middle - mirrored[axis];
    // Rounding may put the partner into a neighbouring place.
    Index partner = -1;
    for (int shift = 0; shift < 27 && partner < 0; ++shift) {
      const Eigen::Vector3d offset(shift % 3 - 1, shift / 3 % 3 - 1, shift / 9 - 1);
      const auto found = places.find(key(mirrored + grid * offset));
      if (found != places.end()) partner = found->second;
    }
    if (partner < 0) return std::nan("");
    Eigen::RowVectorXd image = X.row(partner);
    image[axis] = 2.0 * middle - image[axis];
    largest = std::max(largest, (X.row(v) - image).norm());
  }
  return largest;
}

// Root mean square of the jump of unit normals across edges, weighted alike.
double roughness(const Domain& domain, const Matrix& X) {
  std::vector<Eigen::Vector3d> normals(static_cast<std::size_t>(domain.cell_count()));
  for (Index t = 0; t < domain.cell_count(); ++t) {
    const Eigen::Vector3d a = X.row(domain.cells()(t, 0)).transpose();
    const Eigen::Vector3d b = X.row(domain.cells()(t, 1)).transpose();
    const Eigen::Vector3d c = X.row(domain.cells()(t, 2)).transpose();
    normals[static_cast<std::size_t>(t)] = (b - a).cross(c - a).normalized();
  }
  double sum = 0.0;
  for (Index f = 0; f < domain.facet_count(); ++f) {
    sum += (normals[static_cast<std::size_t>(domain.facet_cells()(f, 0))] -
            normals[static_cast<std::size_t>(domain.facet_cells()(f, 1))])
               .squaredNorm();
  }
  return std::sqrt(sum / std::max<Index>(1, domain.facet_count()));
}

std::vector<bool> held_vertices(const Domain& domain, const std::vector<Handle>& handles, bool moving_only) {
  std::vector<bool> held(static_cast<std::size_t>(domain.vertex_count()), false);
  for (const Handle& handle : handles) {
    if (moving_only && !handle.motion) continue;
    for (const Index v : handle.vertices) held[static_cast<std::size_t>(v)] = true;
  }
  return held;
}

// Cells that touch a vertex within `rings` edges of the given ones.
std::vector<bool> cells_near(const Domain& domain, std::vector<bool> vertices, int rings) {
  std::vector<bool> near(static_cast<std::size_t>(domain.cell_count()), false);
  for (int ring = 0; ring < rings; ++ring) {
    for (Index t = 0; t < domain.cell_count(); ++t) {
      for (int i = 0; i < domain.cell_size(); ++i) {
        if (vertices[static_cast<std::size_t>(domain.cells()(t, i))]) near[static_cast<std::size_t>(t)] = true;
      }
    }
    for (Index t = 0; t < domain.cell_count(); ++t) {
      if (!near[static_cast<std::size_t>(t)]) continue;
      for (int i = 0; i < domain.cell_size(); ++i) vertices[static_cast<std::size_t>(domain.cells()(t, i))] = true;
    }
  }
  return near;
}

}  // namespace

const std::vector<Parameter>& measure_parameters() {
  using Numbers = std::vector<double>;
  static const std::vector<Parameter> parameters = {
      {.name = "region", .value = Numbers{}, .doc = "box [x0, y0, (z0,) x1, y1, (z1)] around centroids of cells"},
      {.name = "line", .value = Numbers{}, .doc = "segment [x0, y0, (z0,) x1, y1, (z1)] through vertices"},
      {.name = "axis", .value = Numbers{}, .doc = "direction about which the turn of the line is measured (space)"},
      {.name = "about", .value = Numbers{}, .doc = "a point on that axis; default the origin"},
      {.name = "direction", .value = Numbers{}, .doc = "displacements orthogonal to it are measured"},
      {.name = "mirror",
       .value = std::string(),
       .doc = "coordinate in whose direction the rest shape is symmetric: how far the result is not",
       .choices = kCoordinates},
      {.name = "reflect",
       .value = std::string(),
       .doc = "coordinate that changes its sign in what [compare] compares",
       .choices = kCoordinates},
      {.name = "lattice",
       .value = std::int64_t{0},
       .doc = "[compare] at a lattice of points of a flat rest shape, per side; 0: at the vertices",
       .min = 0.0,
       .max = 1000.0},
      {.name = "condition",
       .value = false,
       .doc = "condition number of the matrix at the start (up to 3000 unknowns)"}};
  return parameters;
}

MeasureChoice read_measure(const Config& config) {
  Parameters p(measure_parameters());
  if (config.root().has("measure")) p = config.root().at("measure").parameters(measure_parameters());
  const auto fail = [&](const char* key, const char* what) { config.root().at("measure").at(key).fail(what); };
  for (const char* key : {"axis", "direction"}) {
    const std::vector<double>& x = p.numbers(key);
    const double length = Eigen::Map<const Eigen::VectorXd>(x.data(), static_cast<Eigen::Index>(x.size())).norm();
    if (!x.empty() && !(length > 0.0 && std::isfinite(length))) fail(key, "expected a vector other than 0");
  }
  if (!p.numbers("axis").empty() && p.numbers("line").empty()) fail("axis", "needs measure.line");
  if (!p.numbers("about").empty() && p.numbers("axis").empty()) fail("about", "needs measure.axis");
  return {.region = p.numbers("region"),
          .line = p.numbers("line"),
          .axis = p.numbers("axis"),
          .about = p.numbers("about"),
          .direction = p.numbers("direction"),
          .mirror = p.string("mirror"),
          .reflect = p.string("reflect"),
          .lattice = static_cast<Index>(p.integer("lattice")),
          .condition = p.boolean("condition")};
}

void check_measure(const MeasureChoice& choice, const Domain& domain, const Config& config) {
  const auto d = static_cast<std::size_t>(domain.ambient_dimension());
  const auto check = [&](const char* key, const std::vector<double>& value, std::size_t size) {
    if (value.empty() || value.size() == size) return;
    config.root().at("measure").at(key).fail(fmt::format("expected {} numbers on this mesh", size));
  };
  check("region", choice.region, 2 * d);
  check("line", choice.line, 2 * d);
  check("axis", choice.axis, 3);
  check("about", choice.about, 3);
  check("direction", choice.direction, d);
  for (const auto& [key, value] : {std::pair("mirror", choice.mirror), std::pair("reflect", choice.reflect)}) {
    if (!value.empty() && coordinate(value) >= static_cast<int>(d)) {
      config.root().at("measure").at(key).fail("the mesh is planar");
    }
  }
  if (choice.lattice > 0) {
    const Matrix& X = domain.positions();
    const bool flat = domain.kind() == DomainKind::planar ||
                      (domain.kind() == DomainKind::surface && X.col(2).maxCoeff() == X.col(2).minCoeff());
    if (!flat) config.root().at("measure").at("lattice").fail("needs triangles in the xy-plane at rest");
  }
  if (!choice.region.empty() && cells_in(domain, choice.region).empty()) {
    config.root().at("measure").at("region").fail("no cell has its centroid in it");
  }
  if (!choice.line.empty() && vertices_on(domain, choice.line).size() < 2) {
    config.root().at("measure").at("line").fail("fewer than two vertices are on it");
  }
}

std::vector<Metric> measured_metrics() {
  return {{{"displacement"}, "largest distance of a vertex from rest, by the diameter"},
          {{"E_isom_p99"}, "99th percentile of the isometric distortion of a cell"},
          {{"near_handle_E_metr", "max E_metr near handles"},
           "largest metric distortion of a cell within two rings of a moving handle"},
          {{"centroid_shift"}, "how far the mean of the free vertices moved, by the diameter"},
          {{"roughness"}, "surfaces: root mean square of the jumps of the unit normal at edges"},
          {{"tangential"}, "largest displacement orthogonal to measure.direction"},
          {{"asymmetry"}, "largest distance of a vertex from the mirror image of its partner, see measure.mirror"},
          {{"line_stretch"}, "length of measure.line by that at rest"},
          {{"line_change"}, "how far that is from 1"},
          {{"line_turn"}, "degrees that measure.line turns about measure.axis from its start to its end"},
          {{"region_area_ratio"}, "signed measure of measure.region by that at rest"},
          {{"region_area_change"}, "how far that is from 1"},
          {{"region_E_isom"}, "as E_isom, of measure.region"},
          {{"region_E_conf"}, "as E_conf, of measure.region"},
          {{"region_E_auth"}, "as E_auth, of measure.region"},
          {{"region_E_metr"}, "as E_metr, of measure.region"},
          {{"region_E_metr_max"}, "largest metric distortion of a cell of measure.region"}};
}

void measure(const Domain& domain, const std::vector<Handle>& handles, const Matrix& X, const MeasureChoice& choice,
             Row& row) {
  const CellDistortion cells = cell_distortion(domain, X);
  const int d = domain.ambient_dimension();
  const Matrix moved = X - domain.positions();
  row.set("displacement", moved.rowwise().norm().maxCoeff() / domain.diameter());

  std::vector<double> isometric(cells.isometric.data(), cells.isometric.data() + cells.isometric.size());
  const auto place = isometric.begin() + static_cast<std::ptrdiff_t>(0.99 * static_cast<double>(isometric.size() - 1));
  std::nth_element(isometric.begin(), place, isometric.end());
  row.set("E_isom_p99", *place);

  const std::vector<bool> near = cells_near(domain, held_vertices(domain, handles, true), 2);
  double largest = 0.0;
  for (Index t = 0; t < domain.cell_count(); ++t) {
    if (near[static_cast<std::size_t>(t)]) largest = std::max(largest, cells.metric[t]);
  }
  row.set("near_handle_E_metr", largest);

  const std::vector<bool> held = held_vertices(domain, handles, false);
  Eigen::RowVectorXd shift = Eigen::RowVectorXd::Zero(d);
  Index free = 0;
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    if (held[static_cast<std::size_t>(v)]) continue;
    shift += moved.row(v);
    ++free;
  }
  row.set("centroid_shift", shift.norm() / std::max<Index>(1, free) / domain.diameter());
  if (domain.kind() == DomainKind::surface) row.set("roughness", roughness(domain, X));

  if (!choice.direction.empty()) {
    const Eigen::VectorXd n = Eigen::Map<const Eigen::VectorXd>(choice.direction.data(), d).normalized();
    row.set("tangential", (moved - (moved * n) * n.transpose()).rowwise().norm().maxCoeff());
  }
  if (!choice.mirror.empty()) row.set("asymmetry", asymmetry(domain, X, coordinate(choice.mirror)));
  if (!choice.line.empty()) {
    const std::vector<Index> path = vertices_on(domain, choice.line);
    const double stretch = length_of(X, path) / length_of(domain.positions(), path);
    row.set("line_stretch", stretch);
    row.set("line_change", std::abs(stretch - 1.0));
    if (!choice.axis.empty()) {
      const Eigen::Vector3d axis = in_space(choice.axis, 0, 3);
      const Eigen::Vector3d about = choice.about.empty() ? Eigen::Vector3d::Zero() : in_space(choice.about, 0, 3);
      row.set("line_turn", turn_of(X, path, axis, about) - turn_of(domain.positions(), path, axis, about));
    }
  }
  if (!choice.region.empty()) measure_region(domain, cells, choice.region, row);
}

Matrix probe_images(const Domain& domain, const Matrix& X, const MeasureChoice& choice) {
  Matrix images = choice.lattice > 0 ? lattice_images(domain, X, choice.lattice) : X;
  if (!choice.reflect.empty()) {
    // About the middle of the rest shape.
    const int axis = coordinate(choice.reflect);
    const auto rest = domain.positions().col(axis);
    images.col(axis) = (rest.minCoeff() + rest.maxCoeff()) - images.col(axis).array();
  }
  return images;
}

double turned_angle(const Matrix& from, const Matrix& to, const std::vector<Index>& vertices, Eigen::Vector3d& axis) {
  Eigen::Vector3d a = Eigen::Vector3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  const auto count = static_cast<double>(vertices.size());
  for (const Index v : vertices) {
    a += in_space(from.row(v)) / count;
    b += in_space(to.row(v)) / count;
  }
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (const Index v : vertices) covariance += (in_space(to.row(v)) - b) * (in_space(from.row(v)) - a).transpose();
  if (from.cols() == 2) {
    return kDegrees * std::atan2(covariance(1, 0) - covariance(0, 1), covariance(0, 0) + covariance(1, 1));
  }
  Eigen::Matrix3d R;
  if (!closest_rotation(covariance, R)) return std::nan("");
  const Eigen::AngleAxisd turn(R);
  const bool opposite = turn.axis().dot(axis) < 0.0;
  if (turn.angle() > 0.0) axis = opposite ? Eigen::Vector3d(-turn.axis()) : turn.axis();
  return kDegrees * (opposite ? -turn.angle() : turn.angle());
}

}  // namespace variform
