// SPDX-License-Identifier: BSD-3-Clause
#include "integrators/shape/deformation_flow.h"

#include <Eigen/Geometry>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "framework/base/error.h"
#include "framework/base/stopwatch.h"

namespace variform {
namespace {

// A triangle in space with 2 area / (longest edge)^2 below this has collapsed: no side of it is the wrong one.
constexpr double kCollapsed = 1e-10;
// By the diameter: at the first evaluation handles have moved by the rounding of times.
constexpr double kAtRest = 1e-12;

using Positions = Eigen::Map<const Matrix>;

Positions as_positions(const Vector& y, int dimension) { return {y.data(), y.size() / dimension, dimension}; }

SpacePoint point_of(const Matrix& X, Index vertex) { return X.row(vertex).transpose(); }

void check_not_collapsed(const IndexMatrix& triangles, const Matrix& X) {
  for (Index t = 0; t < static_cast<Index>(triangles.rows()); ++t) {
    const auto corner = [&](int i) -> Eigen::Vector3d { return X.row(triangles(t, i)).transpose(); };
    const Eigen::Vector3d a = corner(1) - corner(0);
    const Eigen::Vector3d b = corner(2) - corner(0);
    const double doubled = a.cross(b).norm();
    const double longest = std::max({a.squaredNorm(), b.squaredNorm(), (b - a).squaredNorm()});
    if (!(doubled > kCollapsed * longest)) {
      throw StepRefused(fmt::format("cell {} collapses: its area is {:.3g}", t, 0.5 * doubled));
    }
  }
}

}  // namespace

DeformationFlow::DeformationFlow(const Domain& rest, const Energy& energy, const NormOptions& norm,
                                 std::vector<Handle> handles, double start, LinearBackend& backend,
                                 const FlowOptions& options)
    : rest_(rest),
      domain_(rest),
      handles_(std::move(handles)),
      held_(held_by(handles_, rest)),
      start_(start),
      backend_(backend),
      options_(options),
      problem_(domain_, energy, norm, constraints()),
      positions_(rest.positions()),
      velocities_(Matrix::Zero(rest.vertex_count(), rest.ambient_dimension())),
      handle_velocities_(Matrix::Zero(static_cast<Index>(held_.size()), rest.ambient_dimension())) {
  const EnergyTraits& traits = problem_.traits();
  if (traits.dimension() != rest.ambient_dimension() || traits.state != StateDependence::none) {
    throw UsageError("deformation flow: the energy is not one of velocities of the vertices");
  }
  for (const Term& term : problem_.terms()) {
    if (!term.form.stacked_targets().isZero(0.0)) {
      throw UsageError("deformation flow: the energy is not zero for velocities of zero: it is one of maps");
    }
  }
  if (!(options_.soft_weight >= 0.0)) {
    throw UsageError(
        fmt::format("deformation flow: weight {} of soft handles must not be negative", options_.soft_weight));
  }
  if (options_.continued_by != nullptr) {
    if (options_.continuation_backend == nullptr || options_.continuation_backend == &backend_) {
      throw UsageError("deformation flow: the continuation needs a linear backend of its own");
    }
    Constraints boundary(rest.vertex_count(), rest.ambient_dimension());
    for (Index v = 0; v < rest.vertex_count(); ++v) {
      if (rest.boundary_vertices()[v]) boundary.fix(v, Eigen::RowVectorXd::Zero(rest.ambient_dimension()));
    }
    if (boundary.fixed().empty()) {
      throw UsageError("deformation flow: velocities cannot be continued from the boundary of a shape without one");
    }
    boundary_velocities_ = Matrix::Zero(static_cast<Index>(boundary.fixed().size()), rest.ambient_dimension());
    continuation_ = std::make_unique<Problem>(domain_, *options_.continued_by, NormOptions{}, std::move(boundary));
  }
}

std::vector<DeformationFlow::HeldVertex> DeformationFlow::held_by(const std::vector<Handle>& handles,
                                                                  const Domain& domain) {
  check_handles(handles, domain);
  std::map<Index, HeldVertex> held;
  for (std::size_t h = 0; h < handles.size(); ++h) {
    for (const Index v : handles[h].vertices) {
      HeldVertex& entry = held.try_emplace(v, HeldVertex{v, {-1, -1, -1}}).first->second;
      for (std::size_t c = 0; c < 3; ++c) {
        if (handles[h].held[c]) entry.handle[c] = static_cast<int>(h);
      }
    }
  }
  std::vector<HeldVertex> list;
  for (const auto& [vertex, entry] : held) list.push_back(entry);
  return list;
}

Constraints DeformationFlow::constraints() const {
  const int d = rest_.ambient_dimension();
  Constraints constraints(rest_.vertex_count(), d);
  const Eigen::RowVectorXd zero = Eigen::RowVectorXd::Zero(d);
  for (const HeldVertex& held : held_) {
    std::vector<bool> components;
    for (int c = 0; c < d; ++c) components.push_back(held.handle[static_cast<std::size_t>(c)] >= 0);
    const bool whole = std::find(components.begin(), components.end(), false) == components.end();
    if (options_.soft_weight > 0.0) {
      if (!whole) {
        throw UsageError(fmt::format("deformation flow: soft handles hold all components, not those of vertex {} only",
                                     held.vertex));
      }
      constraints.attract(held.vertex, zero, options_.soft_weight);
    } else if (whole) {
      constraints.fix(held.vertex, zero);
    } else {
      constraints.fix(held.vertex, zero, components);
    }
  }
  return constraints;
}

// `of` gives the value of a handle at a vertex, once for all components that it holds there.
template <class Value, class Set>
void DeformationFlow::for_held(const Value& of, const Set& set) const {
  const int d = rest_.ambient_dimension();
  for (std::size_t i = 0; i < held_.size(); ++i) {
    SpacePoint value;
    int known = -1;
    for (int c = 0; c < d; ++c) {
      const int h = held_[i].handle[static_cast<std::size_t>(c)];
      if (h < 0) continue;
      if (h != known) value = of(handles_[static_cast<std::size_t>(h)], held_[i].vertex);
      known = h;
      if (value.size() == d) set(static_cast<Index>(i), held_[i].vertex, c, value[c]);
    }
  }
}

bool DeformationFlow::interpolated(Index vertex) const {
  if (options_.soft_weight > 0.0) return false;
  return options_.continued_by == nullptr || rest_.boundary_vertices()[vertex];
}

// `of` gives the place of a handle's vertex; returns the largest distance from there.
template <class Place>
double DeformationFlow::distance(const Place& of, const Matrix& X, Matrix* placed) const {
  double largest = 0.0;
  double squared = 0.0;
  Index last = -1;
  for_held(of, [&](Index, Index v, int c, double value) {
    if (v != last) squared = 0.0;
    last = v;
    squared += (value - X(v, c)) * (value - X(v, c));
    largest = std::max(largest, squared);
    if (placed != nullptr) (*placed)(v, c) = value;
  });
  return std::sqrt(largest);
}

double DeformationFlow::place_handles(double t, Matrix& X) const {
  const auto place = [&](const Handle& handle, Index v) -> SpacePoint {
    if (!interpolated(v) || !handle.closed_form(point_size())) return {};
    const SpacePoint rest = point_of(rest_.positions(), v);
    return handle.motion ? handle.motion->position(start_, rest, t) : rest;
  };
  return distance(place, X, &X);
}

double DeformationFlow::handle_error(double t, const Matrix& X) const {
  const auto place = [&](const Handle& handle, Index v) -> SpacePoint {
    if (!handle.has_path(point_size())) return {};
    const SpacePoint rest = point_of(rest_.positions(), v);
    return handle.motion ? flow(*handle.motion, start_, rest, t) : rest;
  };
  return distance(place, X, nullptr);
}

void DeformationFlow::place(double t, const Vector& y) {
  positions_ = as_positions(y, point_size());
  place_handles(t, positions_);
  if (domain_.positions() == positions_) return;  // the end of a step is looked at first, then evaluated
  if (!positions_.allFinite()) throw StepRefused("positions are not finite");
  if (domain_.kind() == DomainKind::surface) check_not_collapsed(domain_.cells(), positions_);
  try {
    domain_.set_positions(positions_);
  } catch (const DataError& error) {
    throw StepRefused(error.what());
  }
}

void DeformationFlow::refresh_handle_velocities(double t) {
  for_held([&](const Handle& handle, Index v) { return handle.velocity(t, point_of(positions_, v)); },
           [&](Index row, Index, int c, double value) { handle_velocities_(row, c) = value; });
  if (options_.soft_weight > 0.0) {
    problem_.set_soft_values(handle_velocities_);
  } else {
    problem_.set_fixed_values(handle_velocities_);
  }
}

// Constraints are checked against the kernel that an energy declares. Of one that declares none (surfaces without the
// smoothness that holds isometries), rounding lets the factorization of a singular matrix pass.
void DeformationFlow::check_regular() {
  checked_ = true;
  const bool least_squares = backend_.capabilities().least_squares && !backend_.capabilities().spd;
  if (problem_.kernel() != Kernel::other || least_squares) return;
  constexpr double kSingular = 1e-13;  // smallest eigenvalue by largest entry of the diagonal
  const SparseMatrix& K = problem_.reduced_matrix();
  Eigen::MatrixXd x = Eigen::MatrixXd::NullaryExpr(
      K.rows(), 1, [](Eigen::Index i) { return std::cos(1.0 + 7.0 * static_cast<double>(i)); });
  for (int i = 0; i < 3; ++i) x = backend_.solve(x.normalized());
  const double smallest = 1.0 / x.norm();
  const double largest = K.diagonal().maxCoeff();
  if (!(smallest > kSingular * largest)) {
    throw SolverError(
        fmt::format("the handles leave motions free that cost no energy (smallest eigenvalue {:.2g}, largest entry of "
                    "the diagonal {:.2g}): take beta > 0, or hold more vertices",
                    smallest, largest));
  }
}

void DeformationFlow::velocity(double t, const Vector& y, Vector& dy) {
  const Stopwatch watch;
  place(t, y);
  if (carry) carry(positions_);
  refresh_handle_velocities(t);
  geometry_seconds_ += watch.seconds();
  try {
    problem_.refresh_operator();
    problem_.solve(backend_, velocities_);
    if (!checked_) check_regular();
    if (continuation_) continue_inside();
  } catch (const SolverError& error) {
    // The rest shape has a solution or none. Of one that moved, cells as thin as rounding make the matrix singular: a
    // shorter step may avoid them.
    if ((positions_ - rest_.positions()).cwiseAbs().maxCoeff() <= kAtRest * rest_.diameter()) throw;
    Index thinnest = 0;
    domain_.cell_measures().cwiseQuotient(rest_.cell_measures()).minCoeff(&thinnest);
    throw StepRefused(fmt::format("no velocities where cell {} has {:.2g} of its measure: {}", thinnest,
                                  domain_.cell_measures()[thinnest] / rest_.cell_measures()[thinnest], error.what()));
  }
  dy = Eigen::Map<const Vector>(velocities_.data(), velocities_.size());
}

void DeformationFlow::continue_inside() {
  Index row = 0;
  for (Index v = 0; v < rest_.vertex_count(); ++v) {
    if (rest_.boundary_vertices()[v]) boundary_velocities_.row(row++) = velocities_.row(v);
  }
  continuation_->set_fixed_values(boundary_velocities_);
  continuation_->refresh_operator();
  continuation_->solve(*options_.continuation_backend, velocities_);
}

std::string DeformationFlow::refusal(double t, const Vector& y) {
  try {
    place(t, y);
  } catch (const StepRefused& refused) {
    return refused.what();
  }
  return {};
}

double DeformationFlow::project(double t, Vector& y) {
  positions_ = as_positions(y, point_size());
  const double drift = place_handles(t, positions_);
  y = Eigen::Map<const Vector>(positions_.data(), positions_.size());
  return drift;
}

std::vector<double> DeformationFlow::breaks(double t0, double t1) const { return breaks_of(handles_, t0, t1); }

Vector DeformationFlow::rest_state() const {
  return Eigen::Map<const Vector>(rest_.positions().data(), rest_.positions().size());
}

Matrix DeformationFlow::positions_of(const Vector& y, int dimension) { return as_positions(y, dimension); }

}  // namespace variform
