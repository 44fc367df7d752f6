// SPDX-License-Identifier: BSD-3-Clause
#include "energies/parametrization/parametrization.h"

#include <Eigen/Dense>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "framework/base/error.h"
#include "framework/topology/topology.h"

namespace variform {
namespace {

// Vertices of the one boundary of a disk, in the direction of its cells.
std::vector<Index> boundary_loop(const Domain& domain, const char* what) {
  const Topology found = topology(domain);
  if (!found.is_disk()) {
    throw DataError(
        fmt::format("{}: the domain must be a disk, but it has {} component(s), {} boundary loop(s), genus {} and {} "
                    "vertices where it touches itself; cut it open first",
                    what, found.components, found.boundary_loops, found.genus, found.singular_vertices));
  }
  return boundary_loops(domain).front();
}

// Position of each vertex of the loop along it as a fraction of its length, and 1 at the end.
std::vector<double> arc_lengths(const Domain& domain, const std::vector<Index>& loop) {
  std::vector<double> arc = {0.0};
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const Index next = loop[(i + 1) % loop.size()];
    arc.push_back(arc.back() + (domain.positions().row(next) - domain.positions().row(loop[i])).norm());
  }
  for (double& s : arc) s /= arc.back();
  arc.back() = 1.0;
  return arc;
}

// Positions on the square [-half, half]^2 with four of the vertices at its corners.
Matrix on_square(const std::vector<double>& arc, double half) {
  const std::size_t count = arc.size() - 1;
  if (count < 4) throw DataError(fmt::format("tutte map: {} boundary vertices cannot take four corners", count));
  std::array<std::size_t, 5> corner = {0, 0, 0, 0, count};
  for (std::size_t k = 1; k < 4; ++k) {
    // Nearest to the quarter, leaving a vertex for each of the other corners.
    std::size_t best = corner[k - 1] + 1;
    for (std::size_t i = best; i <= count - (4 - k); ++i) {
      if (std::abs(arc[i] - 0.25 * k) < std::abs(arc[best] - 0.25 * k)) best = i;
    }
    corner[k] = best;
  }
  const std::array<Eigen::RowVector2d, 5> at = {Eigen::RowVector2d(-half, -half), Eigen::RowVector2d(half, -half),
                                                Eigen::RowVector2d(half, half), Eigen::RowVector2d(-half, half),
                                                Eigen::RowVector2d(-half, -half)};
  Matrix result(static_cast<Eigen::Index>(count), 2);
  for (std::size_t k = 0; k < 4; ++k) {
    for (std::size_t i = corner[k]; i < corner[k + 1]; ++i) {
      const double s = (arc[i] - arc[corner[k]]) / (arc[corner[k + 1]] - arc[corner[k]]);
      // Component by component: what is constant along the side stays so exactly.
      for (int c = 0; c < 2; ++c) {
        result(static_cast<Eigen::Index>(i), c) =
            at[k][c] == at[k + 1][c] ? at[k][c] : std::lerp(at[k][c], at[k + 1][c], s);
      }
    }
  }
  return result;
}

Matrix on_circle(const std::vector<double>& arc, double radius) {
  Matrix result(static_cast<Eigen::Index>(arc.size()) - 1, 2);
  for (Eigen::Index i = 0; i < result.rows(); ++i) {
    const double angle = 2.0 * std::numbers::pi * arc[i];
    result.row(i) << radius * std::cos(angle), radius * std::sin(angle);
  }
  return result;
}

// tan of half the angle of cell t at local vertex i.
double half_angle_tangent(const Domain& domain, Index t, int i) {
  const auto x = [&](int k) { return domain.positions().row(domain.cells()(t, k % 3)); };
  const Eigen::VectorXd a = (x(i + 1) - x(i)).transpose();
  const Eigen::VectorXd b = (x(i + 2) - x(i)).transpose();
  // sin / (1 + cos), with the doubled area as |a||b| sin.
  return 2.0 * domain.cell_measures()[t] / (a.norm() * b.norm() + a.dot(b));
}

}  // namespace

Matrix tangent_frames(const Domain& domain, FrameChoice choice, std::uint64_t seed) {
  if (domain.kind() == DomainKind::tetrahedral) throw UsageError("tangent frames: triangles only");
  const int p = domain.ambient_dimension();
  std::mt19937_64 generator(seed);
  std::uniform_real_distribution<double> angles(-std::numbers::pi, std::numbers::pi);
  Matrix frames(domain.cell_count(), 2 * p);
  for (Index t = 0; t < domain.cell_count(); ++t) {
    const Eigen::Vector3d n = p == 3 ? Eigen::Vector3d(domain.normals().row(t)) : Eigen::Vector3d::UnitZ();
    Eigen::Vector3d first;
    if (choice == FrameChoice::edge_aligned) {
      first.setZero();
      first.head(p) =
          (domain.positions().row(domain.cells()(t, 1)) - domain.positions().row(domain.cells()(t, 0))).transpose();
    } else {
      // The rotation taking z to n, applied to x: x - n_x (n + z) / (1 + n_z), with 1 + n_z = (n_x^2 + n_y^2) / (1 -
      // n_z) where n_z is near -1.
      const double sine2 = n[0] * n[0] + n[1] * n[1];
      const double denominator = n[2] > 0.0 ? 1.0 + n[2] : sine2 / (1.0 - n[2]);
      first = Eigen::Vector3d::UnitX();
      if (denominator > 0.0) first -= n[0] / denominator * (n + Eigen::Vector3d::UnitZ());
    }
    // n + z loses digits near -z: what is left of n in the vector goes.
    first = (first - first.dot(n) * n).normalized();
    Eigen::Vector3d second = n.cross(first);
    if (choice == FrameChoice::random) {
      const double angle = angles(generator);
      const Eigen::Vector3d turned = std::cos(angle) * first + std::sin(angle) * second;
      second = n.cross(turned);
      first = turned;
    }
    frames.row(t).head(p) = first.head(p).transpose();
    frames.row(t).tail(p) = second.head(p).transpose();
  }
  return frames;
}

Constraints default_pins(const Domain& domain) {
  // Loops have at most some thousands of vertices: all pairs.
  const std::vector<Index> loop = boundary_loop(domain, "pins");
  double largest = -1.0;
  std::array<Index, 2> pins = {0, 0};
  for (std::size_t i = 0; i < loop.size(); ++i) {
    for (std::size_t j = i + 1; j < loop.size(); ++j) {
      const double distance = (domain.positions().row(loop[i]) - domain.positions().row(loop[j])).squaredNorm();
      if (distance > largest) {
        largest = distance;
        pins = {loop[i], loop[j]};
      }
    }
  }
  Constraints constraints(domain.vertex_count(), 2);
  constraints.fix(pins[0], Eigen::RowVector2d::Zero());
  constraints.fix(pins[1], Eigen::RowVector2d(std::sqrt(largest), 0.0));
  return constraints;
}

Matrix tutte_map(const Domain& domain, TutteBoundary boundary, TutteWeights weights, LinearBackend& backend) {
  const std::vector<Index> loop = boundary_loop(domain, "tutte map");
  const std::vector<double> arc = arc_lengths(domain, loop);
  const double area = domain.total_measure();
  const Matrix ring = boundary == TutteBoundary::circle ? on_circle(arc, std::sqrt(area / std::numbers::pi))
                                                        : on_square(arc, 0.5 * std::sqrt(area));
  Matrix U = Matrix::Zero(domain.vertex_count(), 2);
  for (std::size_t i = 0; i < loop.size(); ++i) U.row(loop[i]) = ring.row(static_cast<Eigen::Index>(i));

  // sum_j w_ij (u_i - u_j) = 0 at interior vertices i. Each cell brings both of its edges at each of its vertices, so
  // every edge at an interior vertex comes twice.
  IndexVector interior = IndexVector::Constant(domain.vertex_count(), -1);
  Index count = 0;
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    if (!domain.boundary_vertices()[v]) interior[v] = count++;
  }
  const bool symmetric = weights == TutteWeights::uniform;
  std::vector<Eigen::Triplet<double, Index>> triplets;
  Eigen::MatrixXd right_hand_side = Eigen::MatrixXd::Zero(count, 2);
  for (Index t = 0; t < domain.cell_count(); ++t) {
    for (int k = 0; k < 3; ++k) {
      const Index i = domain.cells()(t, k);
      if (interior[i] < 0) continue;
      const double tangent = symmetric ? 0.5 : half_angle_tangent(domain, t, k);
      for (int other = 1; other < 3; ++other) {
        const Index j = domain.cells()(t, (k + other) % 3);
        const double w = symmetric ? tangent : tangent / (domain.positions().row(i) - domain.positions().row(j)).norm();
        triplets.emplace_back(interior[i], interior[i], w);
        if (interior[j] < 0) {
          right_hand_side.row(interior[i]) += w * U.row(j);
        } else if (!symmetric || interior[i] > interior[j]) {
          triplets.emplace_back(interior[i], interior[j], -w);
        }
      }
    }
  }
  if (count > 0) {
    SparseMatrix A(count, count);
    A.setFromTriplets(triplets.begin(), triplets.end());
    backend.factorize(A, symmetric ? MatrixKind::spd : MatrixKind::general);
    const Eigen::MatrixXd solution = backend.solve(right_hand_side);
    for (Index v = 0; v < domain.vertex_count(); ++v) {
      if (interior[v] >= 0) U.row(v) = solution.row(interior[v]);
    }
  }

  for (Index t = 0; t < domain.cell_count(); ++t) {
    const Eigen::RowVector2d a = U.row(domain.cells()(t, 1)) - U.row(domain.cells()(t, 0));
    const Eigen::RowVector2d b = U.row(domain.cells()(t, 2)) - U.row(domain.cells()(t, 0));
    if (a[0] * b[1] - a[1] * b[0] > 0.0) continue;
    if (boundary == TutteBoundary::square) {
      throw DataError(
          fmt::format("tutte map: cell {} collapses on the square, where an inner edge joins two vertices of one side; "
                      "use the circle",
                      t));
    }
    throw SolverError(fmt::format("tutte map: the image of cell {} is too small for double precision", t));
  }
  return U;
}

}  // namespace variform
