// SPDX-License-Identifier: BSD-3-Clause
#include "experiments/continuous_deformations/segmentation.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>

#include "framework/base/error.h"
#include "framework/base/parallel.h"

namespace variform {
namespace {

constexpr double kEqual = 1e-6;  // relative gap of eigenvalues that count as equal
constexpr int kRounds = 200;     // of Lloyd's iteration

using Pairs = std::set<std::pair<Index, Index>>;

constexpr int kSimilar = 12;

// Every vertex with those of the most similar features; all distances, in parallel.
void join_similar(const Matrix& features, Pairs& pairs) {
  const auto vertices = static_cast<Index>(features.rows());
  const int count = std::min<int>(kSimilar, vertices - 1);
  const Vector squares = features.rowwise().squaredNorm();
  IndexMatrix similar(vertices, count);
  parallel_for(vertices, [&](Index v) {
    const Vector distance = squares - 2.0 * features * features.row(v).transpose();
    std::vector<Index> order(static_cast<std::size_t>(vertices));
    std::iota(order.begin(), order.end(), 0);
    std::swap(order[0], order[static_cast<std::size_t>(v)]);  // itself
    std::partial_sort(order.begin() + 1, order.begin() + 1 + count, order.end(),
                      [&](Index a, Index b) { return distance[a] != distance[b] ? distance[a] < distance[b] : a < b; });
    for (int k = 0; k < count; ++k) similar(v, k) = order[static_cast<std::size_t>(k) + 1];
  });
  for (Index v = 0; v < vertices; ++v) {
    for (int k = 0; k < count; ++k) pairs.insert(std::minmax(v, similar(v, k)));
  }
}

Pairs edges_of(const Domain& domain) {
  Pairs edges;
  for (Index t = 0; t < domain.cell_count(); ++t) {
    for (int i = 0; i < domain.cell_size(); ++i) {
      for (int j = 0; j < i; ++j) edges.insert(std::minmax(domain.cells()(t, i), domain.cells()(t, j)));
    }
  }
  return edges;
}

// Clusters of the rows of X, started by farthest points from the one farthest from the mean.
std::vector<int> cluster(const Matrix& X, int count) {
  std::vector<Eigen::RowVectorXd> centres;
  Eigen::Index first = 0;
  (X.rowwise() - X.colwise().mean().eval()).rowwise().squaredNorm().maxCoeff(&first);
  centres.emplace_back(X.row(first));
  Vector distance = Vector::Constant(X.rows(), std::numeric_limits<double>::infinity());
  while (static_cast<int>(centres.size()) < count) {
    distance = distance.cwiseMin((X.rowwise() - centres.back()).rowwise().squaredNorm());
    Eigen::Index farthest = 0;
    distance.maxCoeff(&farthest);
    centres.emplace_back(X.row(farthest));
  }
  std::vector<int> labels(static_cast<std::size_t>(X.rows()), -1);
  for (int round = 0; round < kRounds; ++round) {
    bool changed = false;
    std::vector<Eigen::RowVectorXd> sums(centres.size(), Eigen::RowVectorXd::Zero(X.cols()));
    std::vector<int> sizes(centres.size(), 0);
    for (Eigen::Index v = 0; v < X.rows(); ++v) {
      int best = 0;
      for (std::size_t k = 1; k < centres.size(); ++k) {
        if ((X.row(v) - centres[k]).squaredNorm() <
            (X.row(v) - centres[static_cast<std::size_t>(best)]).squaredNorm()) {
          best = static_cast<int>(k);
        }
      }
      changed = changed || labels[static_cast<std::size_t>(v)] != best;
      labels[static_cast<std::size_t>(v)] = best;
      sums[static_cast<std::size_t>(best)] += X.row(v);
      ++sizes[static_cast<std::size_t>(best)];
    }
    if (!changed) break;
    for (std::size_t k = 0; k < centres.size(); ++k) {
      if (sizes[k] > 0) centres[k] = sums[k] / sizes[k];
    }
  }
  return labels;
}

}  // namespace

Matrix mode_features(const EigenPairs& modes, Index skip, int d) {
  const auto count = static_cast<Index>(modes.values.size());
  const auto vertices = static_cast<Index>(modes.vectors.rows() / d);
  std::vector<Vector> columns;
  double before = -std::numeric_limits<double>::infinity();
  for (Index i = skip; i < count; ++i) {
    const double value = modes.values[i];
    const bool alone = columns.empty() || value - before > kEqual * std::abs(value);
    before = value;
    if (alone) columns.emplace_back(Vector::Zero(vertices));
    for (Index v = 0; v < vertices; ++v) columns.back()[v] += modes.vectors.col(i).segment(v * d, d).squaredNorm();
  }
  Matrix features(vertices, static_cast<Index>(columns.size()));
  for (std::size_t k = 0; k < columns.size(); ++k) features.col(static_cast<Index>(k)) = columns[k].cwiseSqrt();
  return features;
}

Vector stiffness_descriptor(const Matrix& features) { return features.rowwise().sum(); }

Segmentation segment(const Domain& domain, const Matrix& features, int most, SegmentGraph graph,
                     EigenBackend& backend) {
  const Index vertices = domain.vertex_count();
  if (most < 2 || vertices <= most + 1) {
    throw UsageError(fmt::format(
        "segmentation: {} segments of {} vertices: expected 2 or more, and fewer than vertices", most, vertices));
  }
  Pairs edges = edges_of(domain);
  if (graph == SegmentGraph::similarity) join_similar(features, edges);
  double scale = 0.0;
  for (const auto& [a, b] : edges) {
    scale += (features.row(a) - features.row(b)).squaredNorm() / static_cast<double>(edges.size());
  }
  if (!(scale > 0.0)) throw UsageError("segmentation: all vertices have the same features");
  std::vector<Eigen::Triplet<double, Index>> entries;
  Vector degree = Vector::Zero(vertices);
  std::vector<std::tuple<Index, Index, double>> weights;
  for (const auto& [a, b] : edges) {
    // Without a floor a cut could be free, and the graph fall apart.
    const double w = std::max(1e-6, std::exp(-0.5 * (features.row(a) - features.row(b)).squaredNorm() / scale));
    weights.emplace_back(a, b, w);
    degree[a] += w;
    degree[b] += w;
    entries.emplace_back(b, a, -w);
  }
  std::vector<Eigen::Triplet<double, Index>> masses;
  for (Index v = 0; v < vertices; ++v) {
    entries.emplace_back(v, v, degree[v]);
    masses.emplace_back(v, v, degree[v]);
  }
  SparseMatrix L(vertices, vertices);
  L.setFromTriplets(entries.begin(), entries.end());
  SparseMatrix D(vertices, vertices);
  D.setFromTriplets(masses.begin(), masses.end());
  const EigenPairs modes = backend.solve(L, D, most + 1);

  Segmentation result;
  for (int count = 2; count <= most + 1; ++count) {
    Matrix X = modes.vectors.leftCols(count);
    X.rowwise().normalize();
    const std::vector<int> labels = cluster(X, count);
    std::vector<double> cut(static_cast<std::size_t>(count), 0.0);
    std::vector<double> volume(static_cast<std::size_t>(count), 0.0);
    for (Index v = 0; v < vertices; ++v)
      volume[static_cast<std::size_t>(labels[static_cast<std::size_t>(v)])] += degree[v];
    for (const auto& [a, b, w] : weights) {
      const auto la = static_cast<std::size_t>(labels[static_cast<std::size_t>(a)]);
      const auto lb = static_cast<std::size_t>(labels[static_cast<std::size_t>(b)]);
      if (la == lb) continue;
      cut[la] += w;
      cut[lb] += w;
    }
    double sum = 0.0;
    for (std::size_t k = 0; k < cut.size(); ++k) sum += volume[k] > 0.0 ? cut[k] / volume[k] : 0.0;
    result.cut.push_back(sum);
    result.labels.push_back(labels);
  }
  double largest = -std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k + 1 < result.cut.size(); ++k) {
    const double rise = result.cut[k + 1] - result.cut[k];
    if (rise <= largest) continue;
    largest = rise;
    result.segments = static_cast<int>(k) + 2;
  }
  result.cut.pop_back();  // of one more segment, for the last rise
  result.labels.pop_back();
  return result;
}

double agreement(const std::vector<int>& labels, const std::vector<int>& reference) {
  const int segments = labels.empty() ? 0 : *std::max_element(labels.begin(), labels.end()) + 1;
  const int names = reference.empty() ? 0 : *std::max_element(reference.begin(), reference.end()) + 1;
  const int size = std::max(segments, names);
  Eigen::MatrixXd common = Eigen::MatrixXd::Zero(size, size);
  double all = 0.0;
  for (std::size_t v = 0; v < labels.size(); ++v) {
    if (reference[v] < 0) continue;
    common(labels[v], reference[v]) += 1.0;
    all += 1.0;
  }
  if (all == 0.0) return std::nan("");
  std::vector<int> match(static_cast<std::size_t>(size));
  std::iota(match.begin(), match.end(), 0);
  double best = 0.0;
  do {
    double sum = 0.0;
    for (int s = 0; s < size; ++s) sum += common(s, match[static_cast<std::size_t>(s)]);
    best = std::max(best, sum);
  } while (std::next_permutation(match.begin(), match.end()));
  return best / all;
}

}  // namespace variform
