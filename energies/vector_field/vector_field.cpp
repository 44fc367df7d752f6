// SPDX-License-Identifier: BSD-3-Clause
#include "energies/vector_field/vector_field.h"

#include <Eigen/Dense>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "framework/base/error.h"
#include "framework/base/parallel.h"
#include "framework/operators/operators.h"
#include "framework/operators/rotation.h"

namespace variform {
namespace {

// What counts as zero, relative to the largest eigenvalue of M.
constexpr double kRelativeZero = 1e-12;

// j' M j / tr(B) for J = I, where M is least (by Cauchy and Schwarz tr(BJ)^2 <= tr(B) |J + J'|^2_B / 4 for symmetric J,
// with equality on multiples of I): M is positive semi-definite exactly when this and the strain are not negative.
double identity_stiffness(const VectorFieldWeights& w, double trace) { return 4.0 * w.strain + trace * w.divergence; }

double scale(const VectorFieldWeights& w, double trace) { return 4.0 * w.strain + trace * std::abs(w.divergence); }

bool vanishes(double stiffness, const VectorFieldWeights& w, double trace) {
  return std::abs(stiffness) <= kRelativeZero * scale(w, trace);
}

// Its root; 0 where only rounding is left, which would be noise of 1e-8 after the root.
double identity_root(const VectorFieldWeights& w, double trace) {
  const double stiffness = identity_stiffness(w, trace);
  return vanishes(stiffness, w, trace) ? 0.0 : std::sqrt(stiffness);
}

bool indefinite(const VectorFieldWeights& w, double trace) {
  return !(w.strain >= 0.0) || !(identity_stiffness(w, trace) >= -kRelativeZero * scale(w, trace));
}

[[noreturn]] void refuse(const VectorFieldWeights& w, double trace) {
  throw UsageError(fmt::format(
      "vector-field energy: weights {} of strain and {} of divergence make it negative; expected strain >= 0 "
      "and 4 strain + {} divergence >= 0",
      w.strain, w.divergence, trace));
}

template <int p>
using Square = Eigen::Matrix<double, p * p, p * p>;

// Vectorised transposition: K vec(A) = vec(A').
template <int p>
Square<p> commutation() {
  Square<p> K = Square<p>::Zero();
  for (int r = 0; r < p; ++r) {
    for (int c = 0; c < p; ++c) K(c * p + r, r * p + c) = 1.0;
  }
  return K;
}

// Orthonormal basis of the symmetric matrices, vectorised.
template <int p>
Eigen::Matrix<double, p * p, p*(p + 1) / 2> symmetric_basis() {
  Eigen::Matrix<double, p * p, p*(p + 1) / 2> basis;
  basis.setZero();
  int column = 0;
  for (int r = 0; r < p; ++r) {
    basis(r * p + r, column++) = 1.0;
    for (int c = r + 1; c < p; ++c, ++column) {
      basis(r * p + c, column) = basis(c * p + r, column) = std::sqrt(0.5);
    }
  }
  return basis;
}

template <int p>
Square<p> matrix_of(const VectorFieldWeights& weights, const Eigen::Matrix<double, p, p>& B) {
  const Square<p> twice_symmetric = Square<p>::Identity() + commutation<p>();
  Square<p> blocks = Square<p>::Zero();
  for (int i = 0; i < p; ++i) blocks.template block<p, p>(i * p, i * p) = B;
  const Eigen::Map<const Eigen::Matrix<double, p * p, 1>> b(B.data());
  return weights.strain * twice_symmetric.transpose() * blocks * twice_symmetric +
         weights.divergence * b * b.transpose();
}

template <int p>
Square<p> root_of(const VectorFieldWeights& weights, const Eigen::Matrix<double, p, p>& B) {
  const auto N = symmetric_basis<p>();
  using Reduced = Eigen::Matrix<double, p*(p + 1) / 2, p*(p + 1) / 2>;
  const Reduced reduced = N.transpose() * matrix_of<p>(weights, B) * N;
  const Eigen::SelfAdjointEigenSolver<Reduced> eigen(reduced);
  auto values = eigen.eigenvalues();
  const double zero = kRelativeZero * values.cwiseAbs().maxCoeff();
  if (!(values.minCoeff() >= -zero)) refuse(weights, B.trace());
  // As in identity_root.
  for (double& value : values) value = value <= zero ? 0.0 : std::sqrt(value);
  const Eigen::Matrix<double, p * p, p*(p + 1) / 2> V = N * eigen.eigenvectors();
  return V * values.asDiagonal() * V.transpose();
}

int dimension_of(const Matrix& tensors) { return tensors.cols() == 4 ? 2 : 3; }

// At most 3 x 3, its storage in place.
using Tensor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, 3, 3>;

Tensor tensor_at(const Matrix& tensors, Index t) {
  const int p = dimension_of(tensors);
  return Eigen::Map<const Eigen::MatrixXd>(tensors.row(tensors.rows() == 1 ? 0 : t).data(), p, p);
}

void check_tensors(const Matrix& tensors) {
  if (tensors.cols() != 4 && tensors.cols() != 9) {
    throw DataError(
        fmt::format("vector-field energy: tensors have {} entries per cell, expected 4 or 9", tensors.cols()));
  }
  const auto symmetric = [](const Tensor& B) {
    return B.allFinite() && (B - B.transpose()).cwiseAbs().maxCoeff() <= 1e-12 * B.cwiseAbs().maxCoeff();
  };
  for (Index t = 0; t < tensors.rows(); ++t) {
    const Tensor B = tensor_at(tensors, t);
    if (symmetric(B) && B.llt().info() == Eigen::Success) continue;
    std::string why = "it is not symmetric, or not finite";
    if (symmetric(B)) {
      const Eigen::SelfAdjointEigenSolver<Tensor> eigen(B, Eigen::EigenvaluesOnly);
      why = fmt::format("its smallest eigenvalue is {:.3g}", eigen.eigenvalues()[0]);
    }
    throw DataError(
        fmt::format("vector-field energy: the tensor of cell {} is not symmetric positive definite: {}", t, why));
  }
}

}  // namespace

VectorFieldWeights phi_weights(double phi) { return {std::sin(phi), std::cos(phi)}; }

double largest_phi(double trace) { return std::numbers::pi - std::atan(trace / 4.0); }

Eigen::MatrixXd vector_field_matrix(const VectorFieldWeights& weights, const Eigen::MatrixXd& B) {
  if (B.rows() == 2) return matrix_of<2>(weights, B);
  return matrix_of<3>(weights, B);
}

Eigen::MatrixXd vector_field_root(const VectorFieldWeights& weights, int p) {
  if (indefinite(weights, p)) refuse(weights, p);
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(p, p);
  const Eigen::Map<const Eigen::VectorXd> e(identity.data(), p * p);
  const Eigen::MatrixXd P_tr = e * e.transpose() / p;
  const Eigen::MatrixXd K = p == 2 ? Eigen::MatrixXd(commutation<2>()) : Eigen::MatrixXd(commutation<3>());
  const Eigen::MatrixXd P_sym = 0.5 * (Eigen::MatrixXd::Identity(p * p, p * p) + K) - P_tr;
  return 2.0 * std::sqrt(weights.strain) * P_sym + identity_root(weights, p) * P_tr;
}

Eigen::MatrixXd vector_field_root(const VectorFieldWeights& weights, const Eigen::MatrixXd& B) {
  if (B.rows() == 2) return root_of<2>(weights, B);
  return root_of<3>(weights, B);
}

VectorFieldEnergy::VectorFieldEnergy(VectorFieldKind kind, Vector parameter, const Matrix& tensors,
                                     Smoothness smoothness)
    : kind_(kind), parameter_(std::move(parameter)), tensors_(tensors), smoothness_(smoothness) {
  if (parameter_.size() == 0) throw UsageError("vector-field energy: a parameter for all cells or one each is needed");
  for (const double value : parameter_) {
    if (kind_ == VectorFieldKind::authalic && !(value >= 0.0 && std::isfinite(value))) {
      throw UsageError(fmt::format("vector-field energy: shear = {}: expected a finite value >= 0", value));
    }
    if (kind_ == VectorFieldKind::phi && !(value > 0.0 && value < std::numbers::pi)) {
      throw UsageError(
          fmt::format("vector-field energy: phi = {}: expected a value in (0, pi - arctan(tr(B)/4)]", value));
    }
  }
  if (tensors.size() > 0) set_tensors(tensors);
}

void VectorFieldEnergy::set_tensors(const Matrix& tensors) {
  check_tensors(tensors);
  if (tensors.rows() != tensors_.rows() || tensors.cols() != tensors_.cols()) {
    throw UsageError(fmt::format("vector-field energy: expected {} x {} tensor entries, got {} x {}", tensors_.rows(),
                                 tensors_.cols(), tensors.rows(), tensors.cols()));
  }
  if (tensors.rows() > 1 && parameter_.size() > 1 && tensors.rows() != parameter_.size()) {
    throw UsageError(fmt::format("vector-field energy: {} parameters and {} tensors do not belong to the same cells",
                                 parameter_.size(), tensors.rows()));
  }
  tensors_ = tensors;
  // Where the kind and the tensor allow it: a phi out of range is for traits to refuse, with the cell.
  const int p = dimension_of(tensors_);
  const auto count = std::max<std::size_t>(tensors.rows(), parameter_.size());
  if (roots_.size() != count) {
    roots_.assign(count, Eigen::MatrixXd::Zero(p * p, p * p));
    gradients_ = roots_;
  }
  const auto place = [&]<int dimension>(Index t) {
    const VectorFieldWeights w = weights(t, trace(t, p));
    if (indefinite(w, trace(t, p))) return;
    const Eigen::Matrix<double, dimension, dimension> B = tensor_at(tensors_, t);
    roots_[t] = root_of<dimension>(w, B);
    if (smoothness_ == Smoothness::gradient) gradients_[t] = 2.0 * matrix_of<dimension>(w, B);
  };
  parallel_for(static_cast<Index>(count),
               [&](Index t) { p == 2 ? place.template operator()<2>(t) : place.template operator()<3>(t); });
}

double VectorFieldEnergy::trace(Index t, int p) const {
  return tensors_.size() == 0 ? p : tensor_at(tensors_, t).trace();
}

VectorFieldWeights VectorFieldEnergy::weights(Index t, double trace) const {
  const double parameter = parameter_[parameter_.size() == 1 ? 0 : t];
  switch (kind_) {
    case VectorFieldKind::killing: return {1.0, 0.0};
    case VectorFieldKind::metric: return {1.0, 2.0};
    case VectorFieldKind::conformal: return {1.0, -4.0 / trace};
    case VectorFieldKind::authalic: return {parameter, 1.0};
    case VectorFieldKind::phi: return phi_weights(parameter);
  }
  return {};
}

EnergyTraits VectorFieldEnergy::traits(const Domain& domain) const {
  if (domain.kind() == DomainKind::surface) {
    throw UsageError("vector-field energies need a planar or tetrahedral domain, this one is surface");
  }
  const int p = domain.ambient_dimension();
  const Index cells = domain.cell_count();
  if (tensors_.size() > 0 && dimension_of(tensors_) != p) {
    throw UsageError(fmt::format("vector-field energy: tensors are {0} x {0}, the domain has dimension {1}",
                                 dimension_of(tensors_), p));
  }
  for (const auto& [what, rows] : {std::pair<const char*, Eigen::Index>("parameters", parameter_.size()),
                                   {"tensors", tensors_.size() > 0 ? tensors_.rows() : 1}}) {
    if (rows != 1 && rows != cells) {
      throw UsageError(fmt::format("vector-field energy: {} {} for {} cells; expected one for each, or one for all",
                                   rows, what, cells));
    }
  }
  const bool alike = parameter_.size() == 1 && tensors_.rows() <= 1;
  bool bare = false;
  Index conformal = 0;
  std::vector<bool> rigid(domain.component_count(), false);  // components with a cell that sees scaling
  for (Index t = 0; t < (alike ? 1 : cells); ++t) {
    const double B = trace(t, p);
    const VectorFieldWeights w = weights(t, B);
    if (indefinite(w, B)) {
      const double phi = parameter_[parameter_.size() == 1 ? 0 : t];
      throw UsageError(fmt::format("vector-field energy: phi = {}{}: expected a value in (0, {}], pi - arctan({}/4)",
                                   phi, alike ? "" : fmt::format(" on cell {}", t), largest_phi(B), B));
    }
    if (vanishes(w.strain, w, B)) bare = true;
    if (vanishes(identity_stiffness(w, B), w, B)) {
      ++conformal;
    } else {
      rigid[domain.cell_components()[t]] = true;
    }
  }
  // A similarity that is a rigid motion on one cell is one on its neighbours: they share a facet.
  Kernel kernel = Kernel::rigid_motions;
  if (conformal == (alike ? 1 : cells)) {
    kernel = Kernel::similarities;
  } else if (conformal > 0 && std::find(rigid.begin(), rigid.end(), false) != rigid.end()) {
    kernel = Kernel::other;
  }
  if (bare) kernel = Kernel::other;
  return {.residuals = p * p, .unknowns = p, .columns = 1, .kernel = kernel};
}

namespace {

// For isotropic materials S and 2 M are of the form a (I + K) + b vec(I) vec(I)', K the transposition.
struct Isotropic {
  double a;
  double b;
};

Isotropic coefficients(const VectorFieldWeights& w, int p, Smoothness what) {
  if (what == Smoothness::gradient) return {4.0 * w.strain, 2.0 * w.divergence};
  // A phi out of range is for traits to refuse, with the cell.
  if (indefinite(w, p)) return {0.0, 0.0};
  const double shear = std::sqrt(w.strain);
  return {shear, (identity_root(w, p) - 2.0 * shear) / p};
}

// That matrix times H, column by column of G.
template <int p, class Block>
void apply(const Isotropic& matrix, const Eigen::Matrix<double, p, p + 1>& G, Block& E) {
  E.setZero();
  for (int i = 0; i <= p; ++i) {
    for (int c = 0; c < p; ++c) {
      auto column = E.col(i * p + c);
      for (int r = 0; r < p; ++r) {
        column[c * p + r] += matrix.a * G(r, i);
        column[r * p + c] += matrix.a * G(r, i);
        column[r * (p + 1)] += matrix.b * G(c, i);
      }
    }
  }
}

// A general matrix times H: the gradient of coordinate c of vertex i meets its columns c p to c p + p - 1.
template <int p, class Block>
void apply(const Eigen::MatrixXd& matrix, const Eigen::Matrix<double, p, p + 1>& G, Block& E) {
  const Eigen::Map<const Eigen::Matrix<double, p * p, p * p>> A(matrix.data());
  for (int i = 0; i <= p; ++i) {
    for (int c = 0; c < p; ++c) {
      E.col(i * p + c).noalias() = A.template middleCols<p>(c * p) * G.col(i);
    }
  }
}

}  // namespace

template <int p>
void VectorFieldEnergy::fill(const Domain& domain, Smoothness what, Form& form) const {
  const std::vector<Eigen::MatrixXd>& matrices = what == Smoothness::residual ? roots_ : gradients_;
  const bool alike = parameter_.size() == 1;
  const Isotropic all = coefficients(weights(0, p), p, what);
  parallel_for(domain.cell_count(), [&](Index t) {
    const Eigen::Matrix<double, p, p + 1> G =
        Eigen::Map<const Eigen::Matrix<double, p, p + 1>>(domain.gradient(t).data());
    Eigen::Map<Eigen::Matrix<double, p * p, p*(p + 1)>> E(form.block_data(t));
    if (!matrices.empty()) {
      apply<p>(matrices[matrices.size() == 1 ? 0 : t], G, E);
    } else {
      apply<p>(alike ? all : coefficients(weights(t, p), p, what), G, E);
    }
  });
}

void VectorFieldEnergy::fill(const Domain& domain, Smoothness what, Form& form) const {
  if (domain.ambient_dimension() == 2) {
    fill<2>(domain, what, form);
  } else {
    fill<3>(domain, what, form);
  }
}

void VectorFieldEnergy::cell(const Domain& domain, Index t, Eigen::Ref<Eigen::MatrixXd> E) const {
  const auto place = [&]<int p>() {
    const Eigen::Matrix<double, p, p + 1> G = domain.gradient(t);
    if (!roots_.empty()) {
      apply<p>(roots_[roots_.size() == 1 ? 0 : t], G, E);
    } else {
      apply<p>(coefficients(weights(t, p), p, Smoothness::residual), G, E);
    }
  };
  if (domain.ambient_dimension() == 2) {
    place.template operator()<2>();
  } else {
    place.template operator()<3>();
  }
}

void VectorFieldEnergy::refresh_operator(const Domain& domain, Form& form) const {
  fill(domain, Smoothness::residual, form);
}

std::optional<Term> VectorFieldEnergy::regularizer(const Domain& domain, const NormOptions& norm) const {
  if (smoothness_ == Smoothness::residual) return std::nullopt;
  const int p = domain.ambient_dimension();
  Form form(domain.vertex_count(), domain.cells(), p * p, p, 1);
  refresh_regularizer(domain, form);
  return Term{std::move(form), variation_norm(domain, {.beta = 1.0, .facet_weight = norm.facet_weight})};
}

void VectorFieldEnergy::refresh_regularizer(const Domain& domain, Form& form) const {
  fill(domain, Smoothness::gradient, form);
}

double beta_from_alpha(double alpha) {
  if (!(alpha >= 0.0 && std::isfinite(alpha))) {
    throw UsageError(fmt::format("vector-field energy: alpha = {}: expected a finite value >= 0", alpha));
  }
  return alpha / (1.0 + alpha);
}

double alpha_from_beta(double beta) {
  if (!(beta >= 0.0 && beta < 1.0)) {
    throw UsageError(fmt::format("vector-field energy: beta = {}: expected a value in [0, 1)", beta));
  }
  return beta / (1.0 - beta);
}

double residual_beta(double alpha, double m) {
  if (!(m >= 0.0 && std::isfinite(m))) {
    throw UsageError(fmt::format("vector-field energy: stiffness {}: expected a finite value >= 0", m));
  }
  return beta_from_alpha(4.0 * m * alpha);
}

std::optional<double> only_stiffness(const VectorFieldWeights& weights, int p) {
  if (vanishes(weights.divergence, weights, p) || vanishes(identity_stiffness(weights, p), weights, p)) {
    return 4.0 * weights.strain;
  }
  if (vanishes(weights.strain, weights, p)) return p * weights.divergence;
  return std::nullopt;
}

std::unique_ptr<VectorFieldEnergy> make_vector_field_energy(const Vector& phi, const Matrix& tensors,
                                                            Smoothness smoothness) {
  return std::make_unique<VectorFieldEnergy>(VectorFieldKind::phi, phi, tensors, smoothness);
}

Matrix rotated_tensors(const Domain& domain, const Matrix& U, const Matrix& tensors) {
  Matrix result;
  rotated_tensors(domain, U, tensors, result);
  return result;
}

void rotated_tensors(const Domain& domain, const Matrix& U, const Matrix& tensors, Matrix& result) {
  const int p = domain.ambient_dimension();
  if (domain.kind() == DomainKind::surface || U.rows() != domain.vertex_count() || U.cols() != p ||
      tensors.cols() != p * p || (tensors.rows() != 1 && tensors.rows() != domain.cell_count())) {
    throw UsageError(
        fmt::format("rotated tensors: {} x {} values and {} x {} tensors on a {} domain with {} vertices "
                    "and {} cells",
                    U.rows(), U.cols(), tensors.rows(), tensors.cols(), to_string(domain.kind()), domain.vertex_count(),
                    domain.cell_count()));
  }
  result.resize(domain.cell_count(), p * p);
  const auto place = [&]<int dimension>(Index t) {
    using Small = Eigen::Matrix<double, dimension, dimension>;
    Small J = Small::Zero();
    const Eigen::Map<const Eigen::Matrix<double, dimension, dimension + 1>> G(domain.gradient(t).data());
    for (int i = 0; i <= dimension; ++i) {
      const Eigen::Matrix<double, dimension, 1> u = U.row(domain.cells()(t, i)).transpose();
      J += u * G.col(i).transpose();
    }
    Small Q = Small::Identity();  // stays where there is no unique closest rotation
    closest_rotation(J, Q);
    const Small B = Q * Small(tensor_at(tensors, t)) * Q.transpose();
    Eigen::Map<Small>(result.row(t).data()) = 0.5 * (B + B.transpose());
  };
  parallel_for(domain.cell_count(),
               [&](Index t) { p == 2 ? place.template operator()<2>(t) : place.template operator()<3>(t); });
}

namespace {

const std::vector<Parameter> kCommonParameters = {
    {.name = "smoothness",
     .value = std::string("residual"),
     .doc = "what beta weighs: the variation of the residual (the norm W_n) or of the gradient of the density (chapter "
            "3: E + alpha E_S with alpha = beta / (1 - beta))",
     .choices = {"residual", "gradient"}},
    {.name = "stiffness",
     .value = std::vector<double>{},
     .doc = "factors [along, across] of the axis, both positive, the same on all cells; none: isotropic",
     .min = 0.0},
    {.name = "axis",
     .value = std::vector<double>{},
     .doc = "direction that 'stiffness' refers to, one entry per "
            "coordinate, of any length but 0"}};

// across I + (along - across) a a', one row; nothing where the parameters leave the material isotropic.
Matrix tensor_from(const Parameters& parameters) {
  const std::vector<double>& stiffness = parameters.numbers("stiffness");
  const std::vector<double>& axis = parameters.numbers("axis");
  if (stiffness.empty() && axis.empty()) return {};
  const auto p = static_cast<Eigen::Index>(axis.size());
  const Eigen::VectorXd a = Eigen::Map<const Eigen::VectorXd>(axis.data(), p);
  if (stiffness.size() != 2 || !(stiffness[0] > 0.0 && stiffness[1] > 0.0)) {
    throw UsageError("'stiffness': expected two positive numbers, along and across 'axis'");
  }
  if ((p != 2 && p != 3) || !(a.norm() > 0.0) || !a.allFinite()) {
    throw UsageError("'axis': expected 2 or 3 numbers, not all 0, one per coordinate");
  }
  const Eigen::MatrixXd B = stiffness[1] * Eigen::MatrixXd::Identity(p, p) +
                            (stiffness[0] - stiffness[1]) * a.normalized() * a.normalized().transpose();
  return Eigen::Map<const Eigen::RowVectorXd>(B.data(), p * p);
}

EnergyEntry describe(const std::string& name, VectorFieldKind kind, const std::string& doc,
                     const std::vector<Parameter>& own = {}) {
  std::vector<Parameter> parameters = own;
  parameters.insert(parameters.end(), kCommonParameters.begin(), kCommonParameters.end());
  const std::string key = own.empty() ? "" : own.front().name;
  return {.name = name,
          .doc = doc + "; velocities (Martinez Esturo 2013, ch. 3 and 7)",
          .domains = "planar, tetrahedral",
          .velocities = true,
          .parameters = parameters,
          .make = [kind, key](const Parameters& values) {
            const Vector parameter = Vector::Constant(1, key.empty() ? 0.0 : values.number(key));
            const auto smoothness =
                values.string("smoothness") == "gradient" ? Smoothness::gradient : Smoothness::residual;
            return std::make_unique<VectorFieldEnergy>(kind, parameter, tensor_from(values), smoothness);
          }};
}

}  // namespace

EnergyEntry describe_akvf() { return describe("akvf", VectorFieldKind::killing, "as-Killing-as-possible: |J + J'|^2"); }

EnergyEntry describe_metr() {
  return describe("metr", VectorFieldKind::metric, "mean rate of length: |J + J'|^2 + 2 tr(J)^2");
}

EnergyEntry describe_conf() {
  return describe("conf", VectorFieldKind::conformal, "rate of angles: |J + J'|^2 - (4/p) tr(J)^2");
}

EnergyEntry describe_auth() {
  return describe("auth", VectorFieldKind::authalic, "rate of area or volume: tr(J)^2 + shear |J + J'|^2",
                  {{.name = "shear",
                    .value = 1.0 / 512.0,
                    .doc = "weight of the strain that makes the problem solvable; 0: the bare form",
                    .min = 0.0}});
}

EnergyEntry describe_phi() {
  return describe("phi", VectorFieldKind::phi, "sin(phi) |J + J'|^2 + cos(phi) tr(J)^2",
                  {{.name = "phi",
                    .value = std::numbers::pi / 2.0,
                    .doc = "angle in (0, pi - arctan(p/4)]: akvf at pi/2, metr at arctan(1/2), conf at the end",
                    .min = 0.0,
                    .max = std::numbers::pi}});
}

}  // namespace variform
