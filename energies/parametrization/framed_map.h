// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "energies/parametrization/parametrization.h"
#include "framework/base/error.h"
#include "framework/base/parallel.h"
#include "framework/form/energy.h"
#include "framework/operators/operators.h"

namespace variform {

/// How a map of a surface to the plane compares residuals of neighbours; parameters of its energy.
struct MapGauge {
  bool lifted = true;  ///< residuals in world coordinates
  Gauge gauge = Gauge::world;
  FrameChoice choice = FrameChoice::minimal_rotation;
  std::uint64_t seed = 1;

  static std::vector<Parameter> parameters();
  explicit MapGauge(const Parameters& p);
};

/// Map of a surface to the plane: F = B G U in a tangent frame B (2 x 3) of every triangle against a target C(F) that
/// turns with it, C(Q F) = Q C(F) for rotations Q (Martinez Esturo 2013, sec. 7.4.5). Residuals of two triangles can be
/// subtracted in a common frame only (methods: errata C8):
///   world      lifted to space, (E, c) = (G, B' C): no frame left, the default
///   transport  in the frames, (B G, C), rotated across each edge by the norm: the same solution but for curvature
///   raw        in the frames, subtracted as they are: what the source says, taken literally. It depends on the frames
/// Base: ProjectedEnergy or TargetEnergy.
template <class Base>
class FramedMap : public Base {
 public:
  using SmallMatrix = TargetEnergy::SmallMatrix;

  FramedMap(std::string name, const MapGauge& gauge) : name_(std::move(name)), gauge_(gauge) {}

  EnergyTraits traits(const Domain& domain) const override {
    if (domain.kind() == DomainKind::tetrahedral) {
      throw UsageError("energy '" + name_ + "' maps surfaces to the plane, this domain is tetrahedral");
    }
    return {.residuals = gauge_.lifted ? domain.ambient_dimension() : 2,
            .unknowns = 1,
            .columns = 2,
            .kernel = Kernel::constants,
            .gauge = gauge_.gauge,
            .state = StateDependence::target};
  }

  Matrix frames(const Domain& domain) const override { return tangent_frames(domain, gauge_.choice, gauge_.seed); }

  void refresh_operator(const Domain& domain, Form& form) const override {
    if (gauge_.lifted) {
      CellEnergy::refresh_operator(domain, form);
      return;
    }
    const Matrix B = frames(domain);
    parallel_for(domain.cell_count(), [&](Index t) { form.block(t) = frame(B, t) * domain.gradient(t); });
  }

  void cell(const Domain& domain, Index t, Eigen::Ref<Eigen::MatrixXd> E) const override {
    if (gauge_.lifted) {
      E = domain.gradient(t);
    } else {
      E = frame(frames(domain), t) * domain.gradient(t);
    }
  }

  bool target_of(const Domain& domain, Index t, const Eigen::Ref<const Eigen::MatrixXd>& Y,
                 Eigen::Ref<Eigen::MatrixXd> c, SmallMatrix* derivative) const override {
    Eigen::Matrix2d C;
    Eigen::Matrix4d D;
    Eigen::Matrix4d* const slope = derivative != nullptr ? &D : nullptr;
    if (Y.rows() == 2) {  // in a frame already
      const bool defined = planar_target(Y.topLeftCorner<2, 2>(), C, slope);
      if (defined) c.topLeftCorner<2, 2>() = C;
      if (derivative != nullptr) *derivative = D;
      return defined;
    }
    const SurfaceFrame B = surface_frame(domain, t);
    const bool defined = planar_target(B * Y.topLeftCorner<3, 2>(), C, slope);
    if (defined) c.topLeftCorner<3, 2>().noalias() = B.transpose() * C;
    if (derivative != nullptr) {
      derivative->resize(6, 6);
      for (int j = 0; j < 2; ++j) {
        for (int i = 0; i < 2; ++i) {
          derivative->block<3, 3>(3 * i, 3 * j) = B.transpose() * D.block<2, 2>(2 * i, 2 * j) * B;
        }
      }
    }
    return defined;
  }

  int curvature_rank(const Domain&) const override { return 4; }

  void curvature_root(const Domain& domain, Index t, const Eigen::Ref<const Eigen::MatrixXd>& Y,
                      Eigen::Ref<Eigen::MatrixXd> R) const override {
    if (Y.rows() == 2) {
      R.topLeftCorner<4, 4>() = planar_root(Y.topLeftCorner<2, 2>());
      return;
    }
    const SurfaceFrame B = surface_frame(domain, t);
    const Eigen::Matrix4d planar = planar_root(B * Y.topLeftCorner<3, 2>());
    R.block<4, 3>(0, 0).noalias() = planar.leftCols<2>() * B;
    R.block<4, 3>(0, 3).noalias() = planar.rightCols<2>() * B;
  }

 protected:
  /// C(F) and its derivative, as target_of says.
  virtual bool planar_target(const Eigen::Matrix2d& F, Eigen::Matrix2d& C, Eigen::Matrix4d* derivative) const = 0;
  /// As curvature_root says.
  virtual Eigen::Matrix4d planar_root(const Eigen::Matrix2d& F) const = 0;

  /// Y in a frame of triangle t.
  static Eigen::Matrix2d in_frame(const Domain& domain, Index t, const Eigen::Ref<const Eigen::MatrixXd>& Y) {
    if (Y.rows() == 2) return Y.topLeftCorner<2, 2>();
    return surface_frame(domain, t) * Y.topLeftCorner<3, 2>();
  }

 private:
  static TangentFrame frame(const Matrix& frames, Index t) {
    return Eigen::Map<const TangentFrame>(frames.row(t).data(), 2, frames.cols() / 2);
  }

  std::string name_;
  MapGauge gauge_;
};

}  // namespace variform
