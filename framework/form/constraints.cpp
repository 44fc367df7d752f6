// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/constraints.h"

#include <Eigen/Dense>
#include <Eigen/IterativeLinearSolvers>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "framework/base/error.h"
#include "framework/base/parallel.h"

namespace variform {

void Constraints::check_vertex(Index vertex) const {
  if (vertex < 0 || vertex >= vertex_count_) {
    throw DataError(
        fmt::format("constraint: vertex {} does not exist; the mesh has vertices 0 to {}", vertex, vertex_count_ - 1));
  }
}

void Constraints::check_value(Index vertex, const Eigen::Ref<const Eigen::RowVectorXd>& value) const {
  if (value.size() != dimension_) {
    throw DataError(
        fmt::format("constraint: vertex {}: expected {} coordinates, got {}", vertex, dimension_, value.size()));
  }
  if (!value.allFinite()) throw DataError(fmt::format("constraint: vertex {}: the value is not finite", vertex));
}

void Constraints::fix(Index vertex, const Eigen::RowVectorXd& value) { fix(vertex, value, {}); }

void Constraints::fix(Index vertex, const Eigen::RowVectorXd& value, const std::vector<bool>& components) {
  check_vertex(vertex);
  check_value(vertex, value);
  const auto marked = std::count(components.begin(), components.end(), true);
  if (!components.empty() && (components.size() != static_cast<std::size_t>(dimension_) || marked == 0)) {
    throw DataError(
        fmt::format("constraint: vertex {}: {} of {} components are held; expected {} flags, one set at least", vertex,
                    marked, components.size(), dimension_));
  }
  Value fixed{vertex, value};
  if (marked < dimension_) fixed.components = components;  // all of them: no mark
  if (fixed_index_.empty()) fixed_index_.assign(vertex_count_, -1);
  if (const Index at = fixed_index_[vertex]; at >= 0) {
    if (fixed_[at].components != fixed.components) {
      throw DataError(fmt::format("constraint: vertex {} is fixed twice, in different components", vertex));
    }
    bool same = true;
    for (int i = 0; i < dimension_; ++i) same = same && (!fixed.holds(i) || fixed_[at].value[i] == value[i]);
    if (!same) {
      throw DataError(fmt::format("constraint: vertex {} is fixed at both ({}) and ({})", vertex,
                                  fmt::join(fixed_[at].value, ", "), fmt::join(value, ", ")));
    }
    return;
  }
  fixed_index_[vertex] = static_cast<Index>(fixed_.size());
  has_components_ = has_components_ || !fixed.components.empty();
  fixed_.push_back(std::move(fixed));
}

void Constraints::attract(Index vertex, const Eigen::RowVectorXd& value, double weight) {
  check_vertex(vertex);
  check_value(vertex, value);
  if (!(weight >= 0.0) || !std::isfinite(weight)) {
    throw DataError(fmt::format("constraint: vertex {}: soft weight {} is not a positive number", vertex, weight));
  }
  soft_.push_back({vertex, value, weight, {}});
}

void Constraints::identify(Index first, Index second) {
  check_vertex(first);
  check_vertex(second);
  identified_.push_back({first, second});
}

void Constraints::combine(const std::vector<Index>& vertices, const std::vector<double>& weights,
                          const Eigen::RowVectorXd& value) {
  if (vertices.empty() || vertices.size() != weights.size()) {
    throw DataError(fmt::format("constraint: {} vertices with {} weights", vertices.size(), weights.size()));
  }
  for (const Index vertex : vertices) check_vertex(vertex);
  check_value(vertices.front(), value);
  if (!std::all_of(weights.begin(), weights.end(), [](double w) { return std::isfinite(w); })) {
    throw DataError(fmt::format("constraint: vertex {}: a weight is not finite", vertices.front()));
  }
  equalities_.push_back({vertices, weights, value});
}

void Constraints::set_fixed_values(const Matrix& values) {
  if (values.rows() != static_cast<Eigen::Index>(fixed_.size()) || values.cols() != dimension_) {
    throw DataError(fmt::format("constraint: expected {} x {} values, got {} x {}", fixed_.size(), dimension_,
                                values.rows(), values.cols()));
  }
  for (std::size_t i = 0; i < fixed_.size(); ++i) {
    check_value(fixed_[i].vertex, values.row(static_cast<Index>(i)));
    fixed_[i].value = values.row(static_cast<Index>(i));
  }
}

void Constraints::set_soft_values(const Matrix& values) {
  if (values.rows() != static_cast<Eigen::Index>(soft_.size()) || values.cols() != dimension_) {
    throw DataError(fmt::format("constraint: expected {} x {} values of soft constraints, got {} x {}", soft_.size(),
                                dimension_, values.rows(), values.cols()));
  }
  for (std::size_t i = 0; i < soft_.size(); ++i) {
    check_value(soft_[i].vertex, values.row(static_cast<Index>(i)));
    soft_[i].value = values.row(static_cast<Index>(i));
  }
}

void Constraints::set_equality_values(const Matrix& values) {
  if (values.rows() != static_cast<Eigen::Index>(equalities_.size()) || values.cols() != dimension_) {
    throw DataError(fmt::format("constraint: expected {} x {} values of linear equalities, got {} x {}",
                                equalities_.size(), dimension_, values.rows(), values.cols()));
  }
  for (std::size_t i = 0; i < equalities_.size(); ++i) {
    check_value(equalities_[i].vertices.front(), values.row(static_cast<Index>(i)));
    equalities_[i].value = values.row(static_cast<Index>(i));
  }
}

namespace {

// Calls visit(unknown, column, value) for each scalar of a vertex value.
template <class Visit>
void for_each_scalar(Index vertex, const Eigen::RowVectorXd& value, int unknowns, const Visit& visit) {
  for (int i = 0; i < value.size(); ++i) {
    if (unknowns == 1)
      visit(vertex, i, value[i]);
    else
      visit(vertex * unknowns + i, 0, value[i]);
  }
}

}  // namespace

Reduction::Reduction(const SparseMatrix& H, const Constraints& constraints, int unknowns)
    : unknowns_(unknowns), unknown_count_(static_cast<Index>(H.cols())) {
  if (unknown_count_ != constraints.vertex_count() * unknowns ||
      (unknowns != 1 && unknowns != constraints.dimension())) {
    throw UsageError(fmt::format("constraints on {} vertices in dimension {} do not fit {} unknowns",
                                 constraints.vertex_count(), constraints.dimension(), unknown_count_));
  }
  if (unknowns_ == 1 && constraints.has_components()) {
    throw UsageError(
        "constraints hold vertices in single components, which needs an energy that solves for all coordinates of a "
        "vertex together");
  }
  // Groups of identified vertices; a group with a fixed vertex is fixed.
  std::vector<Index> group(constraints.vertex_count());
  std::iota(group.begin(), group.end(), 0);
  const auto root = [&group](Index v) {
    while (group[v] != v) v = group[v] = group[group[v]];
    return v;
  };
  for (const auto& pair : constraints.identified()) {
    const Index a = root(pair.first);
    const Index b = root(pair.second);
    group[std::max(a, b)] = std::min(a, b);
  }
  // The constraint that fixes each unknown of each group, -1: none.
  std::vector<Index> fixed(static_cast<std::size_t>(unknown_count_), -1);
  const auto component_of = [&](int c) { return unknowns_ == 1 ? -1 : c; };
  for (std::size_t i = 0; i < constraints.fixed().size(); ++i) {
    const Constraints::Value& value = constraints.fixed()[i];
    for (int c = 0; c < unknowns_; ++c) {
      if (!value.holds(c)) continue;
      Index& first = fixed[root(value.vertex) * unknowns_ + c];
      if (first < 0) {
        first = static_cast<Index>(i);
      } else {
        fixed_pairs_.push_back({first, static_cast<Index>(i), component_of(c)});
      }
    }
  }
  check_fixed_pairs(constraints);

  target_.setConstant(unknown_count_, -1);
  for (Index v = 0; v < constraints.vertex_count(); ++v) {
    const Index r = root(v);
    for (int i = 0; i < unknowns_; ++i) {
      if (const Index constraint = fixed[r * unknowns_ + i]; constraint >= 0) {
        fixed_unknowns_.push_back({v * unknowns_ + i, constraint, component_of(i)});
      } else {
        target_[v * unknowns_ + i] = r == v ? free_count_++ : target_[r * unknowns_ + i];
      }
    }
  }
  const int copies = unknowns_ == 1 ? 1 : constraints.dimension();
  multiplier_count_ = static_cast<Index>(constraints.equalities().size()) * copies;

  // Pattern of K. Without identified vertices and multipliers it is that of H, rows and columns of fixed unknowns left
  // out.
  const Index size = free_count_ + multiplier_count_;
  const bool submatrix = constraints.identified().empty() && multiplier_count_ == 0;
  std::vector<Eigen::Triplet<double, Index>> triplets;
  const auto placed = [&](Index row, Index column) { return std::pair(std::max(row, column), std::min(row, column)); };
  if (!submatrix) triplets.reserve(static_cast<std::size_t>(H.nonZeros()) + size);
  for (Index j = 0; j < unknown_count_ && !submatrix; ++j) {
    for (SparseMatrix::InnerIterator it(H, j); it; ++it) {
      if (target_[it.row()] < 0 || target_[j] < 0) continue;
      const auto [row, column] = placed(target_[it.row()], target_[j]);
      triplets.emplace_back(row, column, 0.0);
    }
  }
  for (Index y = 0; y < size && !submatrix; ++y) triplets.emplace_back(y, y, 0.0);
  struct Multiplier {
    Index row, column;
    double value;
  };
  std::vector<Multiplier> multipliers;
  for (std::size_t e = 0; e < constraints.equalities().size(); ++e) {
    const auto& equality = constraints.equalities()[e];
    std::vector<bool> sees(copies, false);  // something free
    for (std::size_t k = 0; k < equality.vertices.size(); ++k) {
      for (int i = 0; i < copies; ++i) {
        const Index y = target_[equality.vertices[k] * unknowns_ + (unknowns_ == 1 ? 0 : i)];
        if (y < 0) continue;
        sees[i] = true;
        multipliers.push_back({free_count_ + static_cast<Index>(e) * copies + i, y, equality.weights[k]});
      }
    }
    if (std::find(sees.begin(), sees.end(), false) != sees.end()) {
      throw DataError(fmt::format("constraint: linear equality {} has only fixed vertices ({}){}", e,
                                  fmt::join(equality.vertices, ", "),
                                  constraints.has_components() ? " in some component" : ""));
    }
  }
  for (const Multiplier& m : multipliers) triplets.emplace_back(m.row, m.column, 0.0);
  matrix_.resize(size, size);
  if (submatrix) {
    std::vector<Index> rows;
    rows.reserve(static_cast<std::size_t>(H.nonZeros()));
    for (Index j = 0; j < unknown_count_; ++j) {
      if (target_[j] < 0) continue;
      matrix_.outerIndexPtr()[target_[j]] = static_cast<Index>(rows.size());
      for (SparseMatrix::InnerIterator it(H, j); it; ++it) {
        if (target_[it.row()] >= 0) rows.push_back(target_[it.row()]);
      }
    }
    matrix_.outerIndexPtr()[size] = static_cast<Index>(rows.size());
    matrix_.resizeNonZeros(static_cast<Index>(rows.size()));
    std::copy(rows.begin(), rows.end(), matrix_.innerIndexPtr());
    std::fill_n(matrix_.valuePtr(), rows.size(), 0.0);
  } else {
    matrix_.setFromTriplets(triplets.begin(), triplets.end());
    matrix_.makeCompressed();
  }

  // Mostly the one after the last one asked for.
  auto entry = [&, next = Index{0}](Index row, Index column) mutable {
    const Index* rows = matrix_.innerIndexPtr();
    const Index begin = matrix_.outerIndexPtr()[column];
    const Index end = matrix_.outerIndexPtr()[column + 1];
    const bool found = begin <= next && next < end && rows[next] == row;
    const Index at = found ? next : static_cast<Index>(std::lower_bound(rows + begin, rows + end, row) - rows);
    next = at + 1;
    return at;
  };
  constexpr Index kLongestRun = 1024;  // so that parallel parts are of similar size
  std::vector<bool> filled(static_cast<std::size_t>(matrix_.nonZeros()), false);
  for (Index j = 0, k = 0; j < unknown_count_; ++j) {
    for (SparseMatrix::InnerIterator it(H, j); it; ++it, ++k) {
      const auto i = static_cast<Index>(it.row());
      if (target_[i] < 0 && target_[j] < 0) continue;
      if (target_[i] < 0 || target_[j] < 0) {
        couplings_.push_back(target_[j] < 0 ? Coupling{k, target_[i], j} : Coupling{k, target_[j], i});
        continue;
      }
      const auto [row, column] = placed(target_[i], target_[j]);
      const Index at = entry(row, column);
      if (filled[at]) {
        additions_.push_back({k, at});
      } else if (!runs_.empty() && runs_.back().count < kLongestRun && runs_.back().source + runs_.back().count == k &&
                 runs_.back().target + runs_.back().count == at) {
        ++runs_.back().count;
      } else {
        runs_.push_back({k, at, 1});
      }
      filled[at] = true;
      // An off-diagonal entry of H stands for two; on the diagonal of K both meet.
      if (row == column && i != j) additions_.push_back({k, at});
    }
  }
  diagonal_entry_.resize(size);
  for (Index y = 0; y < size; ++y) diagonal_entry_[y] = entry(y, y);
  for (const Multiplier& m : multipliers) multiplier_entries_.emplace_back(entry(m.row, m.column), m.value);
}

double Reduction::refill(const SparseMatrix& H, const Constraints& constraints) {
  double* values = matrix_.valuePtr();
  const double* h = H.valuePtr();
  parallel_for(
      static_cast<Index>(runs_.size()),
      [&](Index r) { std::copy_n(h + runs_[r].source, runs_[r].count, values + runs_[r].target); }, 32);
  for (const Addition& addition : additions_) values[addition.target] += h[addition.source];
  for (const auto& entry_value : multiplier_entries_) values[entry_value.first] = 0.0;
  // The diagonal entry of a column comes first.
  const double trace = parallel_sum(unknown_count_, [&](Index j) { return h[H.outerIndexPtr()[j]]; });
  default_weight_ = 1e3 * trace / std::max<Index>(unknown_count_, 1);
  for (const auto& soft : constraints.soft()) {
    for_each_scalar(soft.vertex, soft.value, unknowns_, [&](Index unknown, int column, double) {
      if (target_[unknown] >= 0 && column == 0) values[diagonal_entry_[target_[unknown]]] += soft_weight(soft);
    });
  }
  for (const auto& [at, value] : multiplier_entries_) values[at] += value;
  return default_weight_;
}

Eigen::MatrixXd Reduction::right_hand_side(const SparseMatrix& H, const Matrix& g,
                                           const Constraints& constraints) const {
  Eigen::MatrixXd rhs;
  right_hand_side(H, g, constraints, rhs);
  return rhs;
}

void Reduction::right_hand_side(const SparseMatrix& H, const Matrix& g, const Constraints& constraints,
                                Eigen::MatrixXd& rhs) const {
  const Eigen::Index columns = g.cols();
  rhs.setZero(matrix_.rows(), columns);
  const auto add = [&](Index i) {
    if (target_[i] < 0) return;
    for (Eigen::Index column = 0; column < columns; ++column) rhs(target_[i], column) += g(i, column);
  };
  if (additions_.empty()) {  // no two of them to the same row
    parallel_for(unknown_count_, add, 4096);
  } else {
    for (Index i = 0; i < unknown_count_; ++i) add(i);
  }
  Matrix& fixed = fixed_values_;
  if (!couplings_.empty() || multiplier_count_ > 0) {
    if (fixed.cols() != columns) fixed.setZero(unknown_count_, columns);
    set_fixed_part(constraints, fixed);
  }
  for (const Coupling& coupling : couplings_) {
    const double entry = H.valuePtr()[coupling.entry];
    for (Eigen::Index column = 0; column < columns; ++column) {
      rhs(coupling.row, column) -= entry * fixed(coupling.fixed, column);
    }
  }
  for (const auto& soft : constraints.soft()) {
    for_each_scalar(soft.vertex, soft.value, unknowns_, [&](Index unknown, int column, double value) {
      if (target_[unknown] >= 0) rhs(target_[unknown], column) += soft_weight(soft) * value;
    });
  }
  const int copies = unknowns_ == 1 ? 1 : constraints.dimension();
  if (multiplier_count_ > 0) {
    for (std::size_t e = 0; e < constraints.equalities().size(); ++e) {
      const auto& equality = constraints.equalities()[e];
      for_each_scalar(0, equality.value, unknowns_, [&](Index component, int column, double value) {
        const Index i = unknowns_ == 1 ? 0 : component;
        double right = value;
        for (std::size_t k = 0; k < equality.vertices.size(); ++k) {
          const Index unknown = equality.vertices[k] * unknowns_ + i;
          if (target_[unknown] < 0) right -= equality.weights[k] * fixed(unknown, column);
        }
        rhs(free_count_ + static_cast<Index>(e) * copies + i, column) = right;
      });
    }
  }
}

void Reduction::check_fixed_pairs(const Constraints& constraints) const {
  for (const FixedPair& pair : fixed_pairs_) {
    const Constraints::Value& a = constraints.fixed()[pair.first];
    const Constraints::Value& b = constraints.fixed()[pair.second];
    if (pair.component < 0 ? a.value != b.value : a.value[pair.component] != b.value[pair.component]) {
      throw DataError(fmt::format("constraint: vertices {} and {} are identified, but fixed at ({}) and ({})", a.vertex,
                                  b.vertex, fmt::join(a.value, ", "), fmt::join(b.value, ", ")));
    }
  }
}

void Reduction::set_fixed_part(const Constraints& constraints, Matrix& X) const {
  check_fixed_pairs(constraints);  // values may have changed since the constructor
  for (const FixedUnknown& fixed : fixed_unknowns_) {
    const Eigen::RowVectorXd& value = constraints.fixed()[fixed.constraint].value;
    if (fixed.component < 0) {
      X.row(fixed.unknown) = value;
    } else {
      X(fixed.unknown, 0) = value[fixed.component];
    }
  }
}

Matrix Reduction::fixed_part(const Constraints& constraints, Eigen::Index columns) const {
  Matrix X = Matrix::Zero(unknown_count_, columns);
  set_fixed_part(constraints, X);
  return X;
}

Matrix Reduction::expand(const Eigen::MatrixXd& Y, const Constraints& constraints, Eigen::Index columns) const {
  Matrix X(unknown_count_, columns);
  expand(Y, constraints, X);
  return X;
}

void Reduction::expand(const Eigen::MatrixXd& Y, const Constraints& constraints, Matrix& X) const {
  set_fixed_part(constraints, X);
  parallel_for(
      unknown_count_,
      [&](Index i) {
        if (target_[i] < 0) return;
        for (Eigen::Index column = 0; column < X.cols(); ++column) X(i, column) = Y(target_[i], column);
      },
      4096);
}

SparseMatrix Reduction::elimination() const {
  std::vector<Eigen::Triplet<double, Index>> triplets;
  for (Index i = 0; i < unknown_count_; ++i) {
    if (target_[i] >= 0) triplets.emplace_back(i, target_[i], 1.0);
  }
  SparseMatrix Z(unknown_count_, free_count_);
  Z.setFromTriplets(triplets.begin(), triplets.end());
  return Z;
}

Index Reduction::soft_row_count(const Constraints& constraints) const {
  return static_cast<Index>(constraints.soft().size()) * unknowns_;
}

void Reduction::append_soft_rows(const Constraints& constraints, std::vector<Eigen::Triplet<double, Index>>& triplets,
                                 Eigen::MatrixXd& right_hand_side, Index first_row) const {
  Index row = first_row;
  for (const auto& soft : constraints.soft()) {
    const double weight = std::sqrt(soft_weight(soft));
    for_each_scalar(soft.vertex, soft.value, unknowns_, [&](Index unknown, int column, double value) {
      if (target_[unknown] < 0) return;
      const Index at = row + (unknowns_ == 1 ? 0 : unknown % unknowns_);
      if (column == 0) triplets.emplace_back(at, target_[unknown], weight);
      right_hand_side(at, column) = weight * value;
    });
    row += unknowns_;
  }
}

namespace {

// Rank of rows that come in blocks; keeps at most a triangle and one batch of them.
class RowSpace {
 public:
  explicit RowSpace(Eigen::Index columns) : columns_(columns), rows_(0, columns) {}

  void add(const Eigen::MatrixXd& block) {
    rows_.conservativeResize(rows_.rows() + block.rows(), Eigen::NoChange);
    rows_.bottomRows(block.rows()) = block;
    if (rows_.rows() > 2 * columns_ + kBatch) {
      // R of a QR factorization has the singular values of the rows.
      const Eigen::MatrixXd R =
          Eigen::HouseholderQR<Eigen::MatrixXd>(rows_).matrixQR().topRows(columns_).triangularView<Eigen::Upper>();
      rows_ = R;
    }
  }

  Eigen::Index rank() const {
    if (rows_.rows() == 0) return 0;
    Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(rows_);
    qr.setThreshold(1e-10);
    return qr.rank();
  }

 private:
  static constexpr Eigen::Index kBatch = 256;
  Eigen::Index columns_;
  Eigen::MatrixXd rows_;
};

// Components of the domain that each vertex belongs to.
std::vector<std::vector<Index>> components_of_vertices(const Domain& domain) {
  std::vector<std::vector<Index>> components(domain.vertex_count());
  for (Index t = 0; t < domain.cell_count(); ++t) {
    const Index component = domain.cell_components()[t];
    for (int i = 0; i < domain.cell_size(); ++i) {
      auto& list = components[domain.cells()(t, i)];
      if (std::find(list.begin(), list.end(), component) == list.end()) list.push_back(component);
    }
  }
  return components;
}

}  // namespace

void check_constraint_rank(const Domain& domain, const Constraints& constraints, const Eigen::MatrixXd& kernel,
                           int unknowns) {
  const Eigen::Index motions = kernel.cols();
  if (motions == 0) return;
  const auto at = [&](Index vertex) { return kernel.middleRows(vertex * unknowns, unknowns); };
  // The motions of what is held: of a vertex, or of single components.
  const auto held_at = [&](const Constraints::Value& value) {
    Eigen::MatrixXd rows = at(value.vertex);
    Eigen::Index count = 0;
    for (int c = 0; c < unknowns; ++c) {
      if (value.holds(c)) rows.row(count++) = kernel.row(value.vertex * unknowns + c);
    }
    rows.conservativeResize(count, Eigen::NoChange);
    return rows;
  };
  if (domain.component_count() == 1) {
    RowSpace held(motions);
    for (const auto* values : {&constraints.fixed(), &constraints.soft()}) {
      for (const auto& value : *values) held.add(held_at(value));
    }
    if (held.rank() == motions) return;
  }
  const auto components_of = components_of_vertices(domain);

  // What hard and soft constraints hold of each component on its own.
  std::vector<RowSpace> own(domain.component_count(), RowSpace(motions));
  std::vector<Index> count(domain.component_count(), 0);
  for (const auto* values : {&constraints.fixed(), &constraints.soft()}) {
    for (const auto& value : *values) {
      for (const Index component : components_of[value.vertex]) {
        own[component].add(held_at(value));
        ++count[component];
      }
    }
  }
  std::vector<Index> column(domain.component_count(), -1);  // of the components that could still move
  std::vector<Index> loose;
  for (Index component = 0; component < domain.component_count(); ++component) {
    if (own[component].rank() == motions) continue;
    column[component] = static_cast<Index>(loose.size()) * static_cast<Index>(motions);
    loose.push_back(component);
  }
  if (loose.empty()) return;

  // Those are held together by shared vertices, identifications and equalities: the rank over all of their motions.
  const Eigen::Index size = static_cast<Eigen::Index>(loose.size()) * motions;
  constexpr Eigen::Index kLargest = 4000;  // dense algebra; beyond, only what stands alone is checked
  RowSpace together(size <= kLargest ? size : 0);
  Eigen::MatrixXd row;
  const auto add_to_row = [&](Index vertex, double weight) {
    const Index component = components_of[vertex].front();
    if (column[component] >= 0) row.middleCols(column[component], motions) += weight * at(vertex);
  };
  const auto finish_row = [&] {
    if (!row.isZero(0.0)) together.add(row);
  };
  const auto start_row = [&] { row.setZero(unknowns, size); };
  const bool coupled = size <= kLargest && (domain.component_count() > 1 || !constraints.identified().empty() ||
                                            !constraints.equalities().empty());
  if (coupled) {
    for (const auto* values : {&constraints.fixed(), &constraints.soft()}) {
      for (const auto& value : *values) {
        const Index component = components_of[value.vertex].front();
        if (column[component] < 0) continue;
        const Eigen::MatrixXd held = held_at(value);
        row.setZero(held.rows(), size);
        row.middleCols(column[component], motions) = held;
        finish_row();
      }
    }
    for (Index v = 0; v < domain.vertex_count(); ++v) {
      for (std::size_t k = 1; k < components_of[v].size(); ++k) {
        start_row();
        add_to_row(v, 1.0);
        const Index other = components_of[v][k];
        if (column[other] >= 0) row.middleCols(column[other], motions) -= at(v);
        finish_row();
      }
    }
    for (const auto& pair : constraints.identified()) {
      start_row();
      add_to_row(pair.first, 1.0);
      add_to_row(pair.second, -1.0);
      finish_row();
    }
    for (const auto& equality : constraints.equalities()) {
      start_row();
      for (std::size_t k = 0; k < equality.vertices.size(); ++k) add_to_row(equality.vertices[k], equality.weights[k]);
      finish_row();
    }
    if (together.rank() == size) return;
  }
  const Index component = loose.front();
  Index cell = 0;
  while (domain.cell_components()[cell] != component) ++cell;
  throw DataError(fmt::format(
      "too few constraints: component {} of {} (with cell {}) has {} constrained vertices, which hold {} of the {} "
      "motions that the energy does not see{}; constrain more vertices there",
      component, domain.component_count(), cell, count[component], own[component].rank(), motions,
      coupled ? ", and what it shares with other vertices does not hold the rest" : ""));
}

Matrix closest_feasible(const Constraints& constraints, const Matrix& U) {
  Matrix result = U;
  const auto d = static_cast<int>(U.cols());
  // Columns are alike unless vertices are held in single components.
  const int groups = constraints.has_components() ? d : 1;
  std::vector<std::vector<bool>> held(groups, std::vector<bool>(constraints.vertex_count(), false));
  for (const auto& fixed : constraints.fixed()) {
    for (int c = 0; c < d; ++c) {
      if (!fixed.holds(c)) continue;
      result(fixed.vertex, c) = fixed.value[c];
      held[groups == 1 ? 0 : c][fixed.vertex] = true;
    }
  }
  const auto rows = static_cast<Index>(constraints.identified().size() + constraints.equalities().size());
  if (rows == 0) return result;
  // min |change|^2 subject to A change = defect, on what is not fixed.
  for (int group = 0; group < groups; ++group) {
    const int first = groups == 1 ? 0 : group;
    const int columns = groups == 1 ? d : 1;
    std::vector<Eigen::Triplet<double, Index>> triplets;
    Eigen::MatrixXd defect = Eigen::MatrixXd::Zero(rows, columns);
    Index row = 0;
    const auto add = [&](Index vertex, double weight) {
      defect.row(row) -= weight * result.row(vertex).segment(first, columns);
      if (!held[group][vertex]) triplets.emplace_back(row, vertex, weight);
    };
    for (const auto& pair : constraints.identified()) {
      add(pair.first, 1.0);
      add(pair.second, -1.0);
      ++row;
    }
    for (const auto& equality : constraints.equalities()) {
      defect.row(row) += equality.value.segment(first, columns);
      for (std::size_t i = 0; i < equality.vertices.size(); ++i) add(equality.vertices[i], equality.weights[i]);
      ++row;
    }
    SparseMatrix A(rows, constraints.vertex_count());
    A.setFromTriplets(triplets.begin(), triplets.end());
    // Conjugate gradients do not mind constraints that say the same twice.
    const SparseMatrix normal = A * SparseMatrix(A.transpose());
    Eigen::ConjugateGradient<SparseMatrix, Eigen::Lower | Eigen::Upper, Eigen::IdentityPreconditioner> solver(normal);
    solver.setTolerance(1e-15);
    solver.setMaxIterations(10 * static_cast<Eigen::Index>(rows) + 100);
    const Eigen::MatrixXd multipliers = solver.solve(defect);
    const Eigen::MatrixXd change = A.transpose() * multipliers;
    const double left = (A * change - defect).cwiseAbs().maxCoeff();
    if (!(left <= 1e-10 * (1.0 + U.cwiseAbs().maxCoeff()))) {
      throw SolverError(fmt::format("the hard constraints contradict each other: {:.3g} is left", left));
    }
    result.middleCols(first, columns) += change;
  }
  return result;
}

}  // namespace variform
