// SPDX-License-Identifier: BSD-3-Clause
#include "energies/parametrization/parametrization.h"
#include "framework/base/error.h"
#include "framework/base/parallel.h"
#include "framework/form/energy.h"
#include "framework/operators/operators.h"
#include "framework/operators/rotation.h"

namespace variform {
namespace {

// As-rigid-as-possible parametrization of a surface: F = B G U in a tangent frame B (2 x 3) of every triangle against
// its closest planar rotation R* (Martinez Esturo 2013, sec. 7.4.5). Residuals of two triangles can be subtracted in a
// common frame only (methods: errata C8):
//   world      lifted to space, (E, c) = (G, B' R*): no frame left, the default
//   transport  in the frames, (B G, R*), rotated across each edge by the norm: the same solution but for curvature
//   raw        in the frames, subtracted as they are: what the source says, taken literally. It depends on the frames
class ArapParametrization final : public ProjectedEnergy {
 public:
  ArapParametrization(bool lifted, Gauge gauge, FrameChoice choice, std::uint64_t seed)
      : lifted_(lifted), gauge_(gauge), choice_(choice), seed_(seed) {}

  EnergyTraits traits(const Domain& domain) const override {
    if (domain.kind() == DomainKind::tetrahedral) {
      throw UsageError("energy 'arap_parametrization' maps surfaces to the plane, this domain is tetrahedral");
    }
    return {.residuals = lifted_ ? domain.ambient_dimension() : 2,
            .unknowns = 1,
            .columns = 2,
            .kernel = Kernel::constants,
            .gauge = gauge_,
            .state = StateDependence::target};
  }

  Matrix frames(const Domain& domain) const override { return tangent_frames(domain, choice_, seed_); }

  void refresh_operator(const Domain& domain, Form& form) const override {
    if (lifted_) {
      CellEnergy::refresh_operator(domain, form);
      return;
    }
    const Matrix B = frames(domain);
    parallel_for(domain.cell_count(), [&](Index t) { form.block(t) = frame(B, t) * domain.gradient(t); });
  }

  void cell(const Domain& domain, Index t, Eigen::Ref<Eigen::MatrixXd> E) const override {
    if (lifted_) {
      E = domain.gradient(t);
    } else {
      E = frame(frames(domain), t) * domain.gradient(t);
    }
  }

  bool closest_target(const Domain& domain, Index t, const Eigen::Ref<const Eigen::MatrixXd>& Y,
                      Eigen::Ref<Eigen::MatrixXd> c, SmallMatrix* derivative) const override {
    Eigen::Matrix2d R;
    Eigen::Matrix4d D;
    Eigen::Matrix4d* const slope = derivative != nullptr ? &D : nullptr;
    if (!lifted_) {
      const bool defined = closest_rotation(Eigen::Matrix2d(Y), R, slope);
      if (defined) c = R;
      if (derivative != nullptr) *derivative = D;
      return defined;
    }
    if (Y.rows() == 3 && derivative == nullptr) {
      const Eigen::Map<const Eigen::Vector3d> normal(domain.normals().data() + std::ptrdiff_t{3} * t);
      Matrix32 lifted;
      const bool defined = closest_rotation(normal, Y.topLeftCorner<3, 2>(), lifted);
      if (defined) c.topLeftCorner<3, 2>() = lifted;
      return defined;
    }
    const TangentFrame B = edge_frame(domain, t);
    const bool defined = closest_rotation(Eigen::Matrix2d(B * Y), R, slope);
    if (defined) c = B.transpose() * R;
    if (derivative != nullptr) {
      const auto p = B.cols();
      derivative->resize(2 * p, 2 * p);
      for (int j = 0; j < 2; ++j) {
        for (int i = 0; i < 2; ++i) {
          derivative->block(p * i, p * j, p, p) = B.transpose() * D.block<2, 2>(2 * i, 2 * j) * B;
        }
      }
    }
    return defined;
  }

 private:
  static TangentFrame frame(const Matrix& frames, Index t) {
    return Eigen::Map<const TangentFrame>(frames.row(t).data(), 2, frames.cols() / 2);
  }

  bool lifted_;
  Gauge gauge_;
  FrameChoice choice_;
  std::uint64_t seed_;
};

}  // namespace

EnergyEntry describe_arap_parametrization() {
  return {.name = "arap_parametrization",
          .doc = "as-rigid-as-possible map of a surface to the plane, nonlinear (Martinez Esturo 2013, sec. 7.4.5)",
          .domains = "surface, planar",
          .parameters = {{.name = "gauge",
                          .value = std::string("world"),
                          .doc = "where residuals of neighbours are compared; raw depends on the frames (errata C8)",
                          .choices = {"world", "transport", "raw"}},
                         {.name = "frames",
                          .value = std::string("minimal_rotation"),
                          .doc = "tangent frames; no effect but for gauge = \"raw\"",
                          .choices = {"minimal_rotation", "edge_aligned", "random"}},
                         {.name = "seed", .value = std::int64_t{1}, .doc = "of random frames", .min = 0.0}},
          .make = [](const Parameters& p) {
            const std::string frames = p.string("frames");
            return std::make_unique<ArapParametrization>(
                p.string("gauge") == "world", p.string("gauge") == "transport" ? Gauge::cell_frame : Gauge::world,
                frames == "random"         ? FrameChoice::random
                : frames == "edge_aligned" ? FrameChoice::edge_aligned
                                           : FrameChoice::minimal_rotation,
                static_cast<std::uint64_t>(p.integer("seed")));
          }};
}

}  // namespace variform
