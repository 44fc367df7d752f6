// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/assembly.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <numeric>

#include "framework/base/error.h"
#include "framework/base/parallel.h"

namespace variform {
namespace {

constexpr int kMaxBlock = 256;

// Calls visit(site, link, is_first) for site s itself (link -1) and for each site that the norm links to it.
template <class Visit>
void for_coupled_sites(const Norm& norm, const std::vector<Index>& offsets, const std::vector<Index>& adjacency,
                       Index s, const Visit& visit) {
  visit(s, -1, true);
  for (Index k = offsets[s]; k < offsets[s + 1]; ++k) {
    const Index link = adjacency[k] / 2;
    const bool first = adjacency[k] % 2 == 0;
    visit(norm.links()(link, first ? 1 : 0), link, first);
  }
}

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
    if (term.norm->site_count() != form.site_count()) {
      throw UsageError(
          fmt::format("assembly: the norm has {} sites, the form {}", term.norm->site_count(), form.site_count()));
    }
  }
  right_hand_side_.setZero(first.unknown_count(), first.columns());

  incidences_.resize(terms.size());
  for (std::size_t i = 0; i < terms.size(); ++i) {
    const Form& form = terms[i].form;
    Incidence& incidence = incidences_[i];
    incidence.offsets.assign(node_count_ + 1, 0);
    for (const Index node : form.nodes()) ++incidence.offsets[node + 1];
    std::partial_sum(incidence.offsets.begin(), incidence.offsets.end(), incidence.offsets.begin());
    incidence.sites.resize(form.nodes().size());
    incidence.locals.resize(form.nodes().size());
    std::vector<Index> next(incidence.offsets.begin(), incidence.offsets.end() - 1);
    for (Index s = 0; s < form.site_count(); ++s) {
      for (int a = 0; a < form.site_size(s); ++a) {
        const Index at = next[form.node(s, a)]++;
        incidence.sites[at] = s;
        incidence.locals[at] = a;
      }
    }
    incidence.targets.resize(form.site_count(), form.residuals() * form.columns());
    incidence.weighted_targets.resize(form.site_count(), form.residuals() * form.columns());
  }

  // Neighbours w >= v of each node v, sorted: the block rows of its columns.
  std::vector<Index> neighbour_offsets(node_count_ + 1, 0);
  std::vector<Index> neighbours;
  std::vector<Index> stamp(node_count_, -1);
  for (Index v = 0; v < node_count_; ++v) {
    const std::size_t begin = neighbours.size();
    // Every node has its diagonal block, so that soft constraints find their place.
    stamp[v] = v;
    neighbours.push_back(v);
    for (std::size_t i = 0; i < terms.size(); ++i) {
      const Term& term = terms[i];
      for (Index k = incidences_[i].offsets[v]; k < incidences_[i].offsets[v + 1]; ++k) {
        for_coupled_sites(*term.norm, term.norm->adjacency_offsets_, term.norm->adjacency_, incidences_[i].sites[k],
                          [&](Index s, Index, bool) {
                            for (int b = 0; b < term.form.site_size(s); ++b) {
                              const Index w = term.form.node(s, b);
                              if (w < v || stamp[w] == v) continue;
                              stamp[w] = v;
                              neighbours.push_back(w);
                            }
                          });
      }
    }
    std::sort(neighbours.begin() + static_cast<std::ptrdiff_t>(begin), neighbours.end());
    neighbour_offsets[v + 1] = static_cast<Index>(neighbours.size());
  }

  // Ranks, in the order in which refill will meet them.
  std::vector<Index>& rank = stamp;
  for (std::size_t i = 0; i < terms.size(); ++i) {
    const Term& term = terms[i];
    Incidence& incidence = incidences_[i];
    incidence.rank_offsets.resize(incidence.sites.size());
    for (Index v = 0; v < node_count_; ++v) {
      for (Index k = neighbour_offsets[v]; k < neighbour_offsets[v + 1]; ++k) {
        rank[neighbours[k]] = k - neighbour_offsets[v];
      }
      for (Index k = incidence.offsets[v]; k < incidence.offsets[v + 1]; ++k) {
        incidence.rank_offsets[k] = incidence.ranks.size();
        for_coupled_sites(*term.norm, term.norm->adjacency_offsets_, term.norm->adjacency_, incidence.sites[k],
                          [&](Index s, Index, bool) {
                            for (int b = 0; b < term.form.site_size(s); ++b) {
                              const Index w = term.form.node(s, b);
                              incidence.ranks.push_back(w < v ? -1 : rank[w]);
                            }
                          });
      }
    }
  }

  // Column (v, i) holds rows i.. of the diagonal block, then the full blocks of the other neighbours.
  const Index size = first.unknown_count();
  matrix_.resize(size, size);
  std::size_t nonzeros = 0;
  for (Index v = 0; v < node_count_; ++v) {
    const std::size_t others = neighbour_offsets[v + 1] - neighbour_offsets[v] - 1;
    nonzeros += others * unknowns_ * unknowns_ + unknowns_ * (unknowns_ + 1) / 2;
  }
  if (nonzeros > static_cast<std::size_t>(std::numeric_limits<Index>::max())) {
    throw UsageError(fmt::format("assembly: {} non-zeros exceed 32-bit indices", nonzeros));
  }
  matrix_.resizeNonZeros(static_cast<Index>(nonzeros));
  Index position = 0;
  for (Index v = 0; v < node_count_; ++v) {
    for (int i = 0; i < unknowns_; ++i) {
      matrix_.outerIndexPtr()[v * unknowns_ + i] = position;
      for (int j = i; j < unknowns_; ++j) matrix_.innerIndexPtr()[position++] = v * unknowns_ + j;
      for (Index k = neighbour_offsets[v] + 1; k < neighbour_offsets[v + 1]; ++k) {
        for (int j = 0; j < unknowns_; ++j) matrix_.innerIndexPtr()[position++] = neighbours[k] * unknowns_ + j;
      }
    }
  }
  matrix_.outerIndexPtr()[size] = position;
  std::fill_n(matrix_.valuePtr(), position, 0.0);
}

template <int N, int U>
void Assembly::refill_nodes(const Term& term, const Incidence& incidence) {
  const Form& form = term.form;
  const Norm& norm = *term.norm;
  const int n = N > 0 ? N : form.residuals();
  const int u = U > 0 ? U : unknowns_;
  const bool turned = norm.transports_.size() > 0;
  parallel_for(
      node_count_,
      [&](Index v) {
        std::array<double, kMaxBlock> column;  // W_st T_st E_t of the columns of v
        // Where rank r, row j goes in column i: starts[i] + r u + j, the diagonal block being cut to its lower part.
        const auto start = [&](int i) { return matrix_.valuePtr() + matrix_.outerIndexPtr()[v * u + i] - i; };
        for (Index k = incidence.offsets[v]; k < incidence.offsets[v + 1]; ++k) {
          const Index t = incidence.sites[k];
          const double* E_t = form.block_data(t) + static_cast<std::ptrdiff_t>(incidence.locals[k]) * n * u;
          const Index* rank = incidence.ranks.data() + incidence.rank_offsets[k];
          for_coupled_sites(norm, norm.adjacency_offsets_, norm.adjacency_, t, [&](Index s, Index link, bool t_first) {
            const double weight = link < 0 ? norm.diagonal_[t] : norm.link_weights_[link];
            if (turned && link >= 0) {
              // T takes residuals of the link's second site to its first; here from t to s.
              const double c = weight * norm.transports_(link, 0);
              const double d = weight * (t_first ? -norm.transports_(link, 1) : norm.transports_(link, 1));
              for (int i = 0; i < n * u; i += 2) {
                column[i] = c * E_t[i] - d * E_t[i + 1];
                column[i + 1] = d * E_t[i] + c * E_t[i + 1];
              }
            } else {
              for (int i = 0; i < n * u; ++i) column[i] = weight * E_t[i];
            }
            const double* E_s = form.block_data(s);
            const int size = form.site_size(s);
            for (int b = 0; b < size; ++b, E_s += n * u) {
              const Index r = *rank++;
              if (r < 0) continue;
              for (int i = 0; i < u; ++i) {
                double* target = start(i) + static_cast<std::ptrdiff_t>(r) * u;
                for (int j = r == 0 ? i : 0; j < u; ++j) {
                  double sum = 0.0;
                  for (int l = 0; l < n; ++l) sum += E_s[j * n + l] * column[i * n + l];
                  target[j] += sum;
                }
              }
            }
          });
        }
      },
      256);
}

void Assembly::refill(const std::vector<Term>& terms) {
  std::fill_n(matrix_.valuePtr(), matrix_.nonZeros(), 0.0);
  for (std::size_t i = 0; i < terms.size(); ++i) {
    const Term& term = terms[i];
    const Incidence& incidence = incidences_[i];
    const std::pair<int, int> sizes = {term.form.residuals(), unknowns_};
    // The sizes of the common energies, so that the compiler can unroll them.
    if (sizes == std::pair(2, 1))
      refill_nodes<2, 1>(term, incidence);
    else if (sizes == std::pair(3, 1))
      refill_nodes<3, 1>(term, incidence);
    else if (sizes == std::pair(3, 2))
      refill_nodes<3, 2>(term, incidence);
    else if (sizes == std::pair(4, 2))
      refill_nodes<4, 2>(term, incidence);
    else if (sizes == std::pair(9, 3))
      refill_nodes<9, 3>(term, incidence);
    else
      refill_nodes<0, 0>(term, incidence);
  }
}

void Assembly::refill_targets(const std::vector<Term>& terms) {
  right_hand_side_.setZero();
  for (std::size_t i = 0; i < terms.size(); ++i) {
    const Form& form = terms[i].form;
    Incidence& incidence = incidences_[i];
    const int n = form.residuals();
    const int columns = form.columns();
    std::copy_n(form.target_data(0), incidence.targets.size(), incidence.targets.data());
    terms[i].norm->apply(incidence.targets, incidence.weighted_targets);
    parallel_for(node_count_, [&](Index v) {
      for (Index k = incidence.offsets[v]; k < incidence.offsets[v + 1]; ++k) {
        const Index t = incidence.sites[k];
        const double* E = form.block_data(t) + static_cast<std::ptrdiff_t>(incidence.locals[k]) * n * unknowns_;
        const double* y = incidence.weighted_targets.data() + static_cast<std::ptrdiff_t>(t) * n * columns;
        for (int i_unknown = 0; i_unknown < unknowns_; ++i_unknown) {
          for (int column = 0; column < columns; ++column) {
            double sum = 0.0;
            for (int l = 0; l < n; ++l) sum += E[i_unknown * n + l] * y[column * n + l];
            right_hand_side_(v * unknowns_ + i_unknown, column) += sum;
          }
        }
      }
    });
  }
}

StackedForm stack(const std::vector<Term>& terms) {
  std::vector<Eigen::Triplet<double, Index>> triplets;
  StackedForm stacked;
  Index rows = 0;
  for (const Term& term : terms) rows += static_cast<Index>(term.norm->root().rows()) * term.form.residuals();
  stacked.right_hand_side.setZero(rows, terms.front().form.columns());
  Index base = 0;
  for (const Term& term : terms) {
    const Form& form = term.form;
    const Norm& norm = *term.norm;
    const int n = form.residuals();
    const int u = form.unknowns();
    const auto root = norm.root();
    const std::vector<Index> links = norm.root_links();
    for (Index q = 0; q < root.rows(); ++q, base += n) {
      const Index link = links.empty() || norm.transports().size() == 0 ? -1 : links[q];
      for (Eigen::SparseMatrix<double, Eigen::RowMajor, Index>::InnerIterator it(root, q); it; ++it) {
        const auto s = static_cast<Index>(it.col());
        Eigen::MatrixXd E = it.value() * form.block(s);
        Eigen::MatrixXd c = it.value() * form.target(s);
        if (link >= 0 && s == norm.links()(link, 1)) {
          Eigen::Matrix2d T;
          T << norm.transports()(link, 0), -norm.transports()(link, 1), norm.transports()(link, 1),
              norm.transports()(link, 0);
          for (int i = 0; i + 1 < n; i += 2) {
            E.middleRows(i, 2) = (T * E.middleRows(i, 2)).eval();
            c.middleRows(i, 2) = (T * c.middleRows(i, 2)).eval();
          }
        }
        stacked.right_hand_side.middleRows(base, n) += c;
        for (Eigen::Index k = 0; k < E.cols(); ++k) {
          const Index column = form.node(s, static_cast<int>(k) / u) * u + static_cast<int>(k) % u;
          for (int i = 0; i < n; ++i) triplets.emplace_back(base + i, column, E(i, k));
        }
      }
    }
  }
  stacked.matrix.resize(rows, terms.front().form.unknown_count());
  stacked.matrix.setFromTriplets(triplets.begin(), triplets.end());
  return stacked;
}

}  // namespace variform
