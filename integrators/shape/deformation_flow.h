// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <vector>

#include "framework/domain/domain.h"
#include "framework/form/problem.h"
#include "framework/solver/linear_backend.h"
#include "framework/solver/ode_backend.h"
#include "integrators/shape/handles.h"

namespace variform {

/// How DeformationFlow takes its handles and what it does with the velocities.
struct FlowOptions {
  /// Soft handles: a penalty of this weight (see Constraints::attract) in place of interpolation. 0: hard.
  double soft_weight = 0.0;
  /// Velocities of the energy are kept on the boundary of the domain only and continued inside by the minimizer of this
  /// energy under them, the harmonic one of a Dirichlet energy (post-process of Solomon et al. 2011, the baseline of
  /// Martinez Esturo 2013, Figure 9). Handles inside are not interpolated then. Null: none.
  const Energy* continued_by = nullptr;
  LinearBackend* continuation_backend = nullptr;  ///< for that; another one than that of the flow
};

/// The continuous deformation of a shape by moving handles: at every instant the velocities of its vertices minimize a
/// regularized energy declared on the *current* shape, ||E(x) v||^2_W(x), under the velocities of the handles (Martinez
/// Esturo 2013, chapters 3 and 4; methods: continuous deformation, 3.5 and 3.7). Operators, norm and factorization are
/// made anew at every evaluation, on one sparsity pattern and one symbolic analysis.
///
/// The state is the positions, |V| x d row by row. Interpolated handles whose trajectory is known are on it at every
/// evaluation. With plain handles and isotropic energies an evaluation allocates nothing from the third one on, but in
/// the library behind the backend.
class DeformationFlow final : public OdeField {
 public:
  /// rest: the shape at time `start`. The energy, the domain of the rest shape and the backend must outlive the flow.
  /// Throws as Problem, UsageError for energies whose u is no velocity of the vertices and options that make no sense
  /// here, DataError for handles that do not fit the domain or each other.
  DeformationFlow(const Domain& rest, const Energy& energy, const NormOptions& norm, std::vector<Handle> handles,
                  double start, LinearBackend& backend, const FlowOptions& options = {});

  Index size() const override { return static_cast<Index>(rest_.positions().size()); }
  int point_size() const override { return rest_.ambient_dimension(); }
  /// Diameter of the rest shape.
  double length_scale() const override { return rest_.diameter(); }

  /// Throws StepRefused naming a cell that is inverted or, in a surface, collapses, or with what the linear backend
  /// says of a moved shape whose matrix it cannot solve; of the rest shape that is a SolverError.
  void velocity(double t, const Vector& y, Vector& dy) override;
  std::string refusal(double t, const Vector& y) override;
  double project(double t, Vector& y) override;
  std::vector<double> breaks(double t0, double t1) const override;

  /// Called with the current positions (|V| x d) before the energy is declared on them: for what an energy carries
  /// along with the shape (tensors of a material).
  std::function<void(const Matrix& positions)> carry = {};

  /// Positions of the rest shape as a state.
  Vector rest_state() const;
  /// A state as positions, |V| x dimension.
  static Matrix positions_of(const Vector& y, int dimension);

  /// Largest distance at positions X (|V| x d) of a vertex of a handle from where its motion has it at time t, in the
  /// components that are held; also of handles that are not interpolated. Handles without a path (Handle::has_path) do
  /// not count.
  double handle_error(double t, const Matrix& X) const;

  /// Minimal energy at the last evaluation, ||E v||^2_W and its parts.
  EnergyValue energy() const { return problem_.value(velocities_); }
  /// Velocities of the last evaluation, |V| x d.
  const Matrix& velocities() const { return velocities_; }
  const Problem& problem() const { return problem_; }
  const std::vector<Handle>& handles() const { return handles_; }
  /// Seconds spent on the geometry of the shape and on handles, beside Problem::times.
  double geometry_seconds() const { return geometry_seconds_; }

 private:
  // A constrained vertex, and for each of its components the handle that holds it, -1: free.
  struct HeldVertex {
    Index vertex;
    std::array<int, 3> handle;
  };

  static std::vector<HeldVertex> held_by(const std::vector<Handle>& handles, const Domain& domain);
  Constraints constraints() const;
  template <class Value, class Set>
  void for_held(const Value& of, const Set& set) const;
  template <class Place>
  double distance(const Place& of, const Matrix& X, Matrix* placed) const;
  // Whether the velocity of a handle's vertex is that of its motion.
  bool interpolated(Index vertex) const;
  // Puts handles with a known trajectory into X; returns the largest distance.
  double place_handles(double t, Matrix& X) const;
  // The domain at positions y. Throws StepRefused.
  void place(double t, const Vector& y);
  void refresh_handle_velocities(double t);
  void check_regular();
  // Velocities inside from those on the boundary.
  void continue_inside();

  const Domain& rest_;
  Domain domain_;  // the current shape
  std::vector<Handle> handles_;
  std::vector<HeldVertex> held_;  // ascending
  double start_;
  LinearBackend& backend_;
  FlowOptions options_;
  Problem problem_;
  std::unique_ptr<Problem> continuation_;
  Matrix positions_;
  Matrix velocities_;
  Matrix handle_velocities_;    // in the order of the constraints
  Matrix boundary_velocities_;  // likewise, of the continuation
  bool checked_ = false;
  double geometry_seconds_ = 0.0;
};

}  // namespace variform
