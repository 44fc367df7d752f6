// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/assembly.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <limits>
#include <numeric>
#include <type_traits>
#include <utility>

#include "framework/base/error.h"
#include "framework/base/parallel.h"

namespace variform {
namespace {

constexpr int kMaxBlock = 256;

}  // namespace

Assembly::Assembly(const std::vector<Term>& terms) {
  if (terms.empty()) throw UsageError("assembly: no terms");
  const Form& first = terms.front().form;
  unknowns_ = first.unknowns();
  node_count_ = first.node_count();
  for (const Term& term : terms) {
    const Form& form = term.form;
    if (form.unknowns() != unknowns_ || form.node_count() != node_count_ || form.columns() != first.columns()) {
      throw UsageError("assembly: the terms of a problem must share nodes, unknowns and columns");
    }
    if (form.residuals() * unknowns_ > kMaxBlock) {
      throw UsageError(
          fmt::format("assembly: {} residuals x {} unknowns exceed {}", form.residuals(), unknowns_, kMaxBlock));
    }
    if (term.norm->transports().size() > 0 && form.residuals() % 2 != 0) {
      throw UsageError(
          fmt::format("assembly: {} residuals; in cell frames they come in pairs of components", form.residuals()));
    }
    if (term.norm->site_count() != form.site_count()) {
      throw UsageError(
          fmt::format("assembly: the norm has {} sites, the form {}", term.norm->site_count(), form.site_count()));
    }
  }
  right_hand_side_.setZero(first.unknown_count(), first.columns());

  stencils_.resize(terms.size());
  for (std::size_t i = 0; i < terms.size(); ++i) {
    const Form& form = terms[i].form;
    find_slots(form, stencils_[i]);
    stencils_[i].weighted_targets.resize(form.site_count(), form.residuals() * form.columns());
  }
  find_pattern(terms);
}

void Assembly::find_slots(const Form& form, Stencil& stencil) const {
  stencil.offsets.assign(node_count_ + 1, 0);
  for (const Index node : form.nodes()) ++stencil.offsets[node + 1];
  std::partial_sum(stencil.offsets.begin(), stencil.offsets.end(), stencil.offsets.begin());
  stencil.slots.resize(form.nodes().size());
  stencil.sites.resize(form.nodes().size());
  std::vector<Index> next(stencil.offsets.begin(), stencil.offsets.end() - 1);
  for (Index s = 0; s < form.site_count(); ++s) {
    for (Index slot = form.offset(s); slot < form.offset(s + 1); ++slot) {
      const Index at = next[form.nodes()[slot]]++;
      stencil.slots[at] = slot;
      stencil.sites[at] = s;
    }
  }
}

void Assembly::find_pattern(const std::vector<Term>& terms) {
  // What the terms have at the current node; parts name their coupling until they are sorted by it.
  struct Local {
    std::vector<Index> stamps;  // site -> its coupling, if that coupling is of this site
    std::vector<Coupling> couplings;
    std::vector<std::pair<Index, Part>> parts;
  };
  std::vector<Local> locals(terms.size());
  for (std::size_t i = 0; i < terms.size(); ++i) {
    locals[i].stamps.assign(terms[i].form.site_count(), 0);
    for (auto* offsets : {&stencils_[i].coupling_offsets, &stencils_[i].part_offsets, &stencils_[i].place_offsets}) {
      offsets->assign(node_count_ + 1, 0);
    }
  }
  // Nodes w >= v that share an entry with v, sorted: the block rows of its columns. ranks: node -> place among them.
  std::vector<Index> row_offsets(node_count_ + 1, 0);
  std::vector<Index> rows;
  std::vector<Index> ranks(node_count_, -1);

  for (Index v = 0; v < node_count_; ++v) {
    const std::size_t begin = rows.size();
    // Every node has its diagonal block, so that soft constraints find their place.
    rows.push_back(v);
    ranks[v] = 0;
    for (std::size_t i = 0; i < terms.size(); ++i) {
      const Form& form = terms[i].form;
      const Norm& norm = *terms[i].norm;
      Local& local = locals[i];
      local.couplings.clear();
      local.parts.clear();
      const auto couple = [&](Index s, Part part) {
        Index at = local.stamps[s];
        if (at >= static_cast<Index>(local.couplings.size()) || local.couplings[at].site != s) {
          at = local.stamps[s] = static_cast<Index>(local.couplings.size());
          Coupling coupling{s, 0, 0};
          for (Index slot = form.offset(s); slot < form.offset(s + 1); ++slot) {
            const Index w = form.nodes()[slot];
            if (w < v) continue;
            ++coupling.places;
            if (ranks[w] >= 0) continue;
            ranks[w] = 0;
            rows.push_back(w);
          }
          local.couplings.push_back(coupling);
        }
        if (local.couplings[at].places == 0) return;
        ++local.couplings[at].parts;
        local.parts.emplace_back(at, part);
      };
      for (Index k = stencils_[i].offsets[v]; k < stencils_[i].offsets[v + 1]; ++k) {
        const Index t = stencils_[i].sites[k];
        const Index slot = stencils_[i].slots[k];
        couple(t, {slot, -1});
        for (Index a = norm.adjacency_offsets_[t]; a < norm.adjacency_offsets_[t + 1]; ++a) {
          const Index seen_from_s = norm.adjacency_[a] ^ 1;
          couple(norm.links_(seen_from_s / 2, seen_from_s % 2), {slot, seen_from_s});
        }
      }
    }
    std::sort(rows.begin() + static_cast<std::ptrdiff_t>(begin), rows.end());
    for (std::size_t k = begin; k < rows.size(); ++k) ranks[rows[k]] = static_cast<Index>(k - begin);

    for (std::size_t i = 0; i < terms.size(); ++i) {
      const Form& form = terms[i].form;
      Stencil& stencil = stencils_[i];
      Local& local = locals[i];
      std::size_t next = stencil.parts.size();
      stencil.parts.resize(next + local.parts.size());
      for (Coupling& coupling : local.couplings) {
        if (coupling.places == 0) continue;
        stencil.couplings.push_back(coupling);
        for (Index slot = form.offset(coupling.site); slot < form.offset(coupling.site + 1); ++slot) {
          const Index w = form.nodes()[slot];
          if (w >= v) stencil.places.push_back({slot, ranks[w]});
        }
        next += std::exchange(coupling.parts, static_cast<Index>(next - stencil.part_offsets[v]));
      }
      for (const auto& [at, part] : local.parts) {
        stencil.parts[stencil.part_offsets[v] + local.couplings[at].parts++] = part;
      }
      stencil.coupling_offsets[v + 1] = stencil.couplings.size();
      stencil.part_offsets[v + 1] = stencil.parts.size();
      stencil.place_offsets[v + 1] = stencil.places.size();
    }
    for (std::size_t k = begin; k < rows.size(); ++k) ranks[rows[k]] = -1;
    row_offsets[v + 1] = static_cast<Index>(rows.size());
  }

  // Column (v, i) holds rows i.. of the diagonal block, then the full blocks of the other rows.
  const Index size = node_count_ * unknowns_;
  matrix_.resize(size, size);
  const std::size_t nonzeros = (rows.size() - node_count_) * unknowns_ * unknowns_ +
                               static_cast<std::size_t>(node_count_) * unknowns_ * (unknowns_ + 1) / 2;
  if (nonzeros > static_cast<std::size_t>(std::numeric_limits<Index>::max())) {
    throw UsageError(fmt::format("assembly: {} non-zeros exceed 32-bit indices", nonzeros));
  }
  matrix_.resizeNonZeros(static_cast<Index>(nonzeros));
  Index position = 0;
  for (Index v = 0; v < node_count_; ++v) {
    for (int i = 0; i < unknowns_; ++i) {
      matrix_.outerIndexPtr()[v * unknowns_ + i] = position;
      for (int j = i; j < unknowns_; ++j) matrix_.innerIndexPtr()[position++] = v * unknowns_ + j;
      for (Index k = row_offsets[v] + 1; k < row_offsets[v + 1]; ++k) {
        for (int j = 0; j < unknowns_; ++j) matrix_.innerIndexPtr()[position++] = rows[k] * unknowns_ + j;
      }
    }
  }
  matrix_.outerIndexPtr()[size] = position;
  std::fill_n(matrix_.valuePtr(), position, 0.0);
}

template <int N, int U>
void Assembly::refill_nodes(const Term& term, const Stencil& stencil, bool first) {
  const Norm& norm = *term.norm;
  const int n = N > 0 ? N : term.form.residuals();
  const int u = U > 0 ? U : unknowns_;
  const bool turned = norm.transports_.size() > 0;
  const double* E = term.form.block_data(0);
  const double* diagonal = norm.diagonal_.data();
  const double* link_weights = norm.link_weights_.data();
  double* values = matrix_.valuePtr();
  const Index* starts = matrix_.outerIndexPtr();
  const auto block = [E, n, u](Index slot) { return E + static_cast<std::ptrdiff_t>(slot) * n * u; };
  const auto body = [&](Index v) {
    std::array<double, N * U == 0 ? kMaxBlock : N * U> Y;
    if (first) std::fill(values + starts[v * u], values + starts[(v + 1) * u], 0.0);
    const Part* part = stencil.parts.data() + stencil.part_offsets[v];
    const Place* place = stencil.places.data() + stencil.place_offsets[v];
    for (std::size_t k = stencil.coupling_offsets[v]; k < stencil.coupling_offsets[v + 1]; ++k) {
      const Coupling& coupling = stencil.couplings[k];
      std::fill_n(Y.data(), n * u, 0.0);
      for (const Part* end = part + coupling.parts; part != end; ++part) {
        const double* E_t = block(part->slot);
        const double weight = part->link < 0 ? diagonal[coupling.site] : link_weights[part->link / 2];
        if (turned && part->link >= 0) {
          // T takes residuals of the link's second site to its first; here from t to s.
          const double c = weight * norm.transports_(part->link / 2, 0);
          const double d = weight * norm.transports_(part->link / 2, 1) * (part->link % 2 == 0 ? 1.0 : -1.0);
          for (int i = 0; i + 1 < n * u; i += 2) {
            Y[i] += c * E_t[i] - d * E_t[i + 1];
            Y[i + 1] += d * E_t[i] + c * E_t[i + 1];
          }
        } else {
          for (int i = 0; i < n * u; ++i) Y[i] += weight * E_t[i];
        }
      }
      for (const Place* end = place + coupling.places; place != end; ++place) {
        const double* E_s = block(place->slot);
        for (int i = 0; i < u; ++i) {
          // Row j of block row r is at r u + j, the diagonal block being cut to its lower part.
          double* target = values + starts[v * u + i] - i + static_cast<std::ptrdiff_t>(place->rank) * u;
          for (int j = place->rank == 0 ? i : 0; j < u; ++j) {
            double sum = 0.0;
            for (int l = 0; l < n; ++l) sum += E_s[j * n + l] * Y[i * n + l];
            target[j] += sum;
          }
        }
      }
    }
  };
  parallel_for(node_count_, body, 256);
}

void Assembly::refill(const std::vector<Term>& terms) {
  for (std::size_t i = 0; i < terms.size(); ++i) {
    const Term& term = terms[i];
    const Stencil& stencil = stencils_[i];
    const bool first = i == 0;
    const std::pair<int, int> sizes = {term.form.residuals(), unknowns_};
    // The sizes of the common energies, so that the compiler can unroll them.
    if (sizes == std::pair(2, 1))
      refill_nodes<2, 1>(term, stencil, first);
    else if (sizes == std::pair(3, 1))
      refill_nodes<3, 1>(term, stencil, first);
    else if (sizes == std::pair(3, 2))
      refill_nodes<3, 2>(term, stencil, first);
    else if (sizes == std::pair(4, 2))
      refill_nodes<4, 2>(term, stencil, first);
    else if (sizes == std::pair(3, 3))
      refill_nodes<3, 3>(term, stencil, first);
    else if (sizes == std::pair(9, 3))
      refill_nodes<9, 3>(term, stencil, first);
    else if (sizes == std::pair(12, 3))
      refill_nodes<12, 3>(term, stencil, first);
    else
      refill_nodes<0, 0>(term, stencil, first);
  }
}

void Assembly::refill_targets(const std::vector<Term>& terms) {
  right_hand_side_.setZero();
  for (std::size_t i = 0; i < terms.size(); ++i) {
    const Form& form = terms[i].form;
    Stencil& stencil = stencils_[i];
    const Eigen::Map<const Matrix> targets(form.target_data(0), form.site_count(), form.residuals() * form.columns());
    terms[i].norm->apply(targets, stencil.weighted_targets);
    // Sizes as integral constants where the compiler is to know them.
    const auto gather = [&](auto n, auto u, auto columns) {
      parallel_for(node_count_, [&](Index v) {
        double* g = right_hand_side_.data() + static_cast<std::ptrdiff_t>(v) * u * columns;
        for (Index k = stencil.offsets[v]; k < stencil.offsets[v + 1]; ++k) {
          const double* E = form.block_data(0) + static_cast<std::ptrdiff_t>(stencil.slots[k]) * n * u;
          const double* y =
              stencil.weighted_targets.data() + static_cast<std::ptrdiff_t>(stencil.sites[k]) * n * columns;
          for (int j = 0; j < u; ++j) {
            for (int column = 0; column < columns; ++column) {
              double sum = 0.0;
              for (int l = 0; l < n; ++l) sum += E[j * n + l] * y[column * n + l];
              g[j * columns + column] += sum;
            }
          }
        }
      });
    };
    const std::array<int, 3> sizes = {form.residuals(), unknowns_, form.columns()};
    using Sizes = std::array<int, 3>;
    // The sizes of the common nonlinear energies.
    if (sizes == Sizes{2, 1, 2})
      gather(std::integral_constant<int, 2>(), std::integral_constant<int, 1>(), std::integral_constant<int, 2>());
    else if (sizes == Sizes{3, 1, 2})
      gather(std::integral_constant<int, 3>(), std::integral_constant<int, 1>(), std::integral_constant<int, 2>());
    else if (sizes == Sizes{3, 1, 3})
      gather(std::integral_constant<int, 3>(), std::integral_constant<int, 1>(), std::integral_constant<int, 3>());
    else
      gather(form.residuals(), unknowns_, form.columns());
  }
}

namespace {

// Visits the entries of all roots: visit(form, site, first of its n stacked rows, factor, rotation of pairs of
// components or nullptr). Returns the number of stacked rows.
template <class Visit>
Index for_each_stacked_block(const std::vector<Term>& terms, const Visit& visit) {
  Index base = 0;
  for (const Term& term : terms) {
    const Norm& norm = *term.norm;
    const auto root = norm.root();
    const std::vector<Index> links = norm.root_links();
    for (Index q = 0; q < root.rows(); ++q, base += term.form.residuals()) {
      const Index link = links.empty() || norm.transports().size() == 0 ? -1 : links[q];
      for (Eigen::SparseMatrix<double, Eigen::RowMajor, Index>::InnerIterator it(root, q); it; ++it) {
        const auto site = static_cast<Index>(it.col());
        Eigen::Matrix2d T;
        const bool turned = link >= 0 && site == norm.links()(link, 1);
        if (turned) {
          const double c = norm.transports()(link, 0);
          const double s = norm.transports()(link, 1);
          T << c, -s, s, c;
        }
        visit(term.form, site, base, it.value(), turned ? &T : nullptr);
      }
    }
  }
  return base;
}

Eigen::MatrixXd stacked_block(const Eigen::Ref<const Eigen::MatrixXd>& block, double factor, const Eigen::Matrix2d* T) {
  Eigen::MatrixXd result = factor * block;
  for (Eigen::Index i = 0; T != nullptr && i + 1 < result.rows(); i += 2) {
    result.middleRows(i, 2) = (*T * result.middleRows(i, 2)).eval();
  }
  return result;
}

}  // namespace

SparseMatrix stacked_operator(const std::vector<Term>& terms) {
  std::vector<Eigen::Triplet<double, Index>> triplets;
  const Index rows = for_each_stacked_block(
      terms, [&](const Form& form, Index site, Index base, double factor, const Eigen::Matrix2d* T) {
        const Eigen::MatrixXd E = stacked_block(form.block(site), factor, T);
        const int u = form.unknowns();
        for (int k = 0; k < E.cols(); ++k) {
          for (int i = 0; i < form.residuals(); ++i) {
            triplets.emplace_back(base + i, form.node(site, k / u) * u + k % u, E(i, k));
          }
        }
      });
  SparseMatrix result(rows, terms.front().form.unknown_count());
  result.setFromTriplets(triplets.begin(), triplets.end());
  return result;
}

Eigen::MatrixXd stacked_targets(const std::vector<Term>& terms) {
  Index rows = 0;
  for (const Term& term : terms) rows += static_cast<Index>(term.norm->root().rows()) * term.form.residuals();
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(rows, terms.front().form.columns());
  for_each_stacked_block(terms, [&](const Form& form, Index site, Index base, double factor, const Eigen::Matrix2d* T) {
    result.middleRows(base, form.residuals()) += stacked_block(form.target(site), factor, T);
  });
  return result;
}

}  // namespace variform
