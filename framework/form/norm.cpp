// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/norm.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "framework/base/error.h"
#include "framework/base/parallel.h"
#include "framework/operators/operators.h"

namespace variform {
namespace {

using RowSparseMatrix = Eigen::SparseMatrix<double, Eigen::RowMajor, Index>;

void check_beta(double beta) {
  if (!(beta >= 0.0 && beta < 1.0)) throw UsageError(fmt::format("norm: beta = {}: expected a value in [0, 1)", beta));
}

RowSparseMatrix from_rows(Index rows, Index columns, const std::vector<Eigen::Triplet<double, Index>>& triplets) {
  RowSparseMatrix result(rows, columns);
  result.setFromTriplets(triplets.begin(), triplets.end());
  return result;
}

class CellNorm final : public Norm {
 public:
  // plain: the factor of A, 1 - beta for the whole norm.
  CellNorm(const Domain& domain, const NormOptions& options, const Matrix& frames, double plain)
      : options_(options), plain_(plain) {
    links_ = options.beta > 0.0 ? domain.facet_cells() : IndexMatrix(0, 2);
    if (frames.size() > 0) set_transports(domain, frames);
    build_adjacency(domain.cell_count());
    refresh(domain);
  }

  void refresh(const Domain& domain) override {
    plain_diagonal_ = domain.cell_measures();
    diagonal_ = plain_ * plain_diagonal_;
    if (link_count() == 0) {
      link_weights_.resize(0);
      return;
    }
    facet_weights(domain, options_.facet_weight, link_weights_);
    link_weights_ *= -options_.beta;
    for (Index f = 0; f < link_count(); ++f) {
      diagonal_[links_(f, 0)] -= link_weights_[f];
      diagonal_[links_(f, 1)] -= link_weights_[f];
    }
  }

  RowSparseMatrix root() const override {
    std::vector<Eigen::Triplet<double, Index>> triplets;
    const Index cells = site_count();
    for (Index t = 0; t < cells; ++t) {
      triplets.emplace_back(t, t, std::sqrt(plain_ * plain_diagonal_[t]));
    }
    for (Index f = 0; f < link_count(); ++f) {
      const double weight = std::sqrt(-link_weights_[f]);
      triplets.emplace_back(cells + f, links_(f, 0), weight);
      triplets.emplace_back(cells + f, links_(f, 1), -weight);
    }
    return from_rows(cells + link_count(), cells, triplets);
  }

  std::vector<Index> root_links() const override {
    std::vector<Index> links(site_count() + link_count(), -1);
    std::iota(links.begin() + site_count(), links.end(), 0);
    return links;
  }

 private:
  void set_transports(const Domain& domain, const Matrix& frames) {
    const int p = domain.ambient_dimension();
    if (domain.intrinsic_dimension() != 2 || frames.rows() != domain.cell_count() || frames.cols() != 2 * p) {
      throw UsageError(fmt::format("norm: cell frames must be {} x {} on triangles, got {} x {}", domain.cell_count(),
                                   2 * p, frames.rows(), frames.cols()));
    }
    transports_.resize(link_count(), 2);
    for (Index f = 0; f < link_count(); ++f) {
      const Eigen::VectorXd edge = (domain.positions().row(domain.facet_vertices()(f, 1)) -
                                    domain.positions().row(domain.facet_vertices()(f, 0)))
                                       .transpose();
      const auto angle = [&](Index cell) {
        const Eigen::Map<const Eigen::VectorXd> first(frames.row(cell).data(), p);
        const Eigen::Map<const Eigen::VectorXd> second(frames.row(cell).data() + p, p);
        return std::atan2(second.dot(edge), first.dot(edge));
      };
      const double turn = angle(links_(f, 0)) - angle(links_(f, 1));
      transports_(f, 0) = std::cos(turn);
      transports_(f, 1) = std::sin(turn);
    }
  }

  NormOptions options_;
  double plain_;
};

class VertexNorm final : public Norm {
 public:
  VertexNorm(const Domain& domain, const NormOptions& options) : options_(options) {
    check_beta(options.beta);
    const SparseMatrix pattern = mass_matrix(domain);
    links_.resize((pattern.nonZeros() - domain.vertex_count()) / 2, 2);
    Index link = 0;
    for (Index j = 0; j < pattern.outerSize(); ++j) {
      for (SparseMatrix::InnerIterator it(pattern, j); it; ++it) {
        if (it.row() > it.col()) links_.row(link++) << static_cast<Index>(it.row()), static_cast<Index>(it.col());
      }
    }
    build_adjacency(domain.vertex_count());
    refresh(domain);
  }

  void refresh(const Domain& domain) override {
    // Matrices, not local blocks: no energy of the library moves a vertex norm in a hot loop.
    const SparseMatrix M = mass_matrix(domain);
    const SparseMatrix L = cotangent_laplacian(domain);
    const double beta = options_.beta;
    gradient_weight_ = beta;
    if (options_.facet_weight != FacetWeight::facet_measure) {
      gradient_weight_ *= std::pow(domain.total_measure(), 2.0 / domain.intrinsic_dimension());
    }
    plain_diagonal_ = M.diagonal();
    diagonal_ = (1.0 - beta) * plain_diagonal_ + gradient_weight_ * L.diagonal();
    link_weights_.resize(link_count());
    plain_link_weights_.resize(link_count());
    for (Index link = 0; link < link_count(); ++link) {
      const Index i = links_(link, 0);
      const Index j = links_(link, 1);
      plain_link_weights_[link] = M.coeff(i, j);
      link_weights_[link] = (1.0 - beta) * M.coeff(i, j) + gradient_weight_ * L.coeff(i, j);
    }
    build_root(domain);
  }

  RowSparseMatrix root() const override { return root_; }

 private:
  // Cell by cell: W = sum_t s (I + 1 1')/((m+1)(m+2)) + g A_t G_t' G_t. The root of I + 1 1' (size k = m+1) is
  // I + a 1 1' with k a^2 + 2 a = 1.
  void build_root(const Domain& domain) {
    const int k = domain.cell_size();
    const int p = domain.ambient_dimension();
    const double a = (std::sqrt(k + 1.0) - 1.0) / k;
    std::vector<Eigen::Triplet<double, Index>> triplets;
    Index row = 0;
    for (Index t = 0; t < domain.cell_count(); ++t) {
      const double mass = std::sqrt((1.0 - options_.beta) * domain.cell_measures()[t] / (k * (k + 1.0)));
      for (int i = 0; i < k; ++i, ++row) {
        for (int j = 0; j < k; ++j) triplets.emplace_back(row, domain.cells()(t, j), mass * (a + (i == j ? 1.0 : 0.0)));
      }
      if (gradient_weight_ == 0.0) continue;
      const double weight = std::sqrt(gradient_weight_ * domain.cell_measures()[t]);
      const auto G = domain.gradient(t);
      for (int i = 0; i < p; ++i, ++row) {
        for (int j = 0; j < k; ++j) triplets.emplace_back(row, domain.cells()(t, j), weight * G(i, j));
      }
    }
    root_ = from_rows(row, domain.vertex_count(), triplets);
  }

  NormOptions options_;
  double gradient_weight_ = 0.0;
  RowSparseMatrix root_;
};

class DiagonalNorm final : public Norm {
 public:
  explicit DiagonalNorm(const Vector& weights) {
    if (!(weights.array() >= 0.0).all()) throw UsageError("norm: weights must not be negative");
    diagonal_ = plain_diagonal_ = weights;
    links_.resize(0, 2);
    build_adjacency(static_cast<Index>(weights.size()));
  }

  void refresh(const Domain&) override {}

  RowSparseMatrix root() const override {
    std::vector<Eigen::Triplet<double, Index>> triplets;
    for (Index s = 0; s < site_count(); ++s) triplets.emplace_back(s, s, std::sqrt(diagonal_[s]));
    return from_rows(site_count(), site_count(), triplets);
  }
};

class ScaledNorm final : public Norm {
 public:
  ScaledNorm(std::unique_ptr<Norm> norm, double factor) : norm_(std::move(norm)), factor_(factor) {
    links_ = norm_->links();
    transports_ = norm_->transports();
    build_adjacency(norm_->site_count());
    scale();
  }

  void refresh(const Domain& domain) override {
    norm_->refresh(domain);
    scale();
  }

  RowSparseMatrix root() const override { return std::sqrt(factor_) * norm_->root(); }
  std::vector<Index> root_links() const override { return norm_->root_links(); }

 private:
  void scale() {
    plain_diagonal_ = norm_->diagonal();
    plain_link_weights_ = norm_->link_weights();
    diagonal_ = factor_ * plain_diagonal_;
    link_weights_ = factor_ * plain_link_weights_;
  }

  std::unique_ptr<Norm> norm_;
  double factor_;
};

// y += weight * T x on pairs of components, T = [c -s; s c], or its transpose.
void add_rotated(double weight, double c, double s, const double* x, double* y, int size) {
  for (int i = 0; i + 1 < size; i += 2) {
    y[i] += weight * (c * x[i] - s * x[i + 1]);
    y[i + 1] += weight * (s * x[i] + c * x[i + 1]);
  }
}

}  // namespace

std::string to_string(FacetWeight weight) { return facet_weight_names()[static_cast<std::size_t>(weight)]; }

const std::vector<std::string>& facet_weight_names() {
  static const std::vector<std::string> names = {"facet_measure", "facet_measure_unit", "finite_volume"};
  return names;
}

FacetWeight facet_weight_from(const std::string& name) {
  const auto& names = facet_weight_names();
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) {
    throw UsageError(fmt::format("unknown facet weight '{}'; known: {}", name, fmt::join(names, ", ")));
  }
  return static_cast<FacetWeight>(found - names.begin());
}

Vector facet_weights(const Domain& domain, FacetWeight weight) {
  Vector b;
  facet_weights(domain, weight, b);
  return b;
}

void facet_weights(const Domain& domain, FacetWeight weight, Vector& b) {
  const double m = domain.intrinsic_dimension();
  const double sigma = std::pow(domain.total_measure(), 1.0 / m);
  b = domain.facet_measures();
  if (weight == FacetWeight::facet_measure_unit) b *= sigma;
  if (weight == FacetWeight::finite_volume) {
    for (Index f = 0; f < domain.facet_count(); ++f) {
      const double measures =
          domain.cell_measures()[domain.facet_cells()(f, 0)] + domain.cell_measures()[domain.facet_cells()(f, 1)];
      const double h = m * measures / ((m + 1.0) * b[f]);
      b[f] *= sigma * sigma / h;
    }
  }
}

double residual_variation(const Domain& domain, FacetWeight weight, const Matrix& R) {
  const Vector b = facet_weights(domain, weight);
  return parallel_sum(domain.facet_count(), [&](Index f) {
    return b[f] * (R.row(domain.facet_cells()(f, 0)) - R.row(domain.facet_cells()(f, 1))).squaredNorm();
  });
}

std::unique_ptr<Norm> cell_norm(const Domain& domain, const NormOptions& options, const Matrix& frames) {
  check_beta(options.beta);
  return std::make_unique<CellNorm>(domain, options, frames, 1.0 - options.beta);
}

std::unique_ptr<Norm> variation_norm(const Domain& domain, const NormOptions& options, const Matrix& frames) {
  if (!(options.beta >= 0.0 && options.beta <= 1.0)) {
    throw UsageError(fmt::format("norm: beta = {}: expected a value in [0, 1]", options.beta));
  }
  return std::make_unique<CellNorm>(domain, options, frames, 0.0);
}

std::unique_ptr<Norm> vertex_norm(const Domain& domain, const NormOptions& options) {
  return std::make_unique<VertexNorm>(domain, options);
}

std::unique_ptr<Norm> scaled_norm(std::unique_ptr<Norm> norm, double factor) {
  return std::make_unique<ScaledNorm>(std::move(norm), factor);
}

std::unique_ptr<Norm> diagonal_norm(const Vector& weights) { return std::make_unique<DiagonalNorm>(weights); }

void Norm::build_adjacency(Index sites) {
  adjacency_offsets_.assign(sites + 1, 0);
  for (Index l = 0; l < link_count(); ++l) {
    ++adjacency_offsets_[links_(l, 0) + 1];
    ++adjacency_offsets_[links_(l, 1) + 1];
  }
  std::partial_sum(adjacency_offsets_.begin(), adjacency_offsets_.end(), adjacency_offsets_.begin());
  adjacency_.resize(2 * static_cast<std::size_t>(link_count()));
  std::vector<Index> next(adjacency_offsets_.begin(), adjacency_offsets_.end() - 1);
  for (Index l = 0; l < link_count(); ++l) {
    adjacency_[next[links_(l, 0)]++] = 2 * l;
    adjacency_[next[links_(l, 1)]++] = 2 * l + 1;
  }
}

Matrix Norm::apply(const Eigen::Ref<const Matrix>& R) const {
  Matrix result;
  apply(R, result);
  return result;
}

void Norm::apply(const Eigen::Ref<const Matrix>& R, Matrix& result) const {
  if (R.rows() != site_count()) {
    throw UsageError(fmt::format("norm: {} rows of residuals for {} sites", R.rows(), site_count()));
  }
  const auto size = static_cast<int>(R.cols());
  if (transports_.size() > 0 && size % 2 != 0) {
    throw UsageError("norm: residuals in cell frames come in pairs of components");
  }
  result.resize(R.rows(), R.cols());
  parallel_for(site_count(), [&](Index s) {
    const auto row = [&](Index i) { return R.data() + i * R.outerStride(); };
    double* y = result.data() + static_cast<std::size_t>(s) * size;
    const double* x = row(s);
    for (int i = 0; i < size; ++i) y[i] = diagonal_[s] * x[i];
    for (Index k = adjacency_offsets_[s]; k < adjacency_offsets_[s + 1]; ++k) {
      const Index link = adjacency_[k] / 2;
      const bool first = adjacency_[k] % 2 == 0;
      const double* other = row(links_(link, first ? 1 : 0));
      const double weight = link_weights_[link];
      if (transports_.size() == 0) {
        for (int i = 0; i < size; ++i) y[i] += weight * other[i];
      } else {
        add_rotated(weight, transports_(link, 0), first ? transports_(link, 1) : -transports_(link, 1), other, y, size);
      }
    }
  });
}

double Norm::quadratic(const Matrix& R, const Vector& diagonal, const Vector& link_weights) const {
  const double own = parallel_sum(site_count(), [&](Index s) { return diagonal[s] * R.row(s).squaredNorm(); });
  const auto links = static_cast<Index>(link_weights.size());
  const double mixed = parallel_sum(links, [&](Index l) {
    const auto a = R.row(links_(l, 0));
    const auto b = R.row(links_(l, 1));
    if (transports_.size() == 0) return link_weights[l] * a.dot(b);
    double sum = 0.0;
    const double c = transports_(l, 0);
    const double s = transports_(l, 1);
    for (Index i = 0; i + 1 < R.cols(); i += 2) {
      sum += a[i] * (c * b[i] - s * b[i + 1]) + a[i + 1] * (s * b[i] + c * b[i + 1]);
    }
    return link_weights[l] * sum;
  });
  return own + 2.0 * mixed;
}

double Norm::squared(const Matrix& R) const { return quadratic(R, diagonal_, link_weights_); }
double Norm::plain_squared(const Matrix& R) const { return quadratic(R, plain_diagonal_, plain_link_weights_); }

SparseMatrix Norm::matrix() const {
  if (transports_.size() > 0) throw UsageError("norm: a norm with transports has no scalar matrix");
  std::vector<Eigen::Triplet<double, Index>> triplets;
  for (Index s = 0; s < site_count(); ++s) triplets.emplace_back(s, s, diagonal_[s]);
  for (Index l = 0; l < link_count(); ++l) {
    triplets.emplace_back(links_(l, 0), links_(l, 1), link_weights_[l]);
    triplets.emplace_back(links_(l, 1), links_(l, 0), link_weights_[l]);
  }
  SparseMatrix W(site_count(), site_count());
  W.setFromTriplets(triplets.begin(), triplets.end());
  return W;
}

}  // namespace variform
