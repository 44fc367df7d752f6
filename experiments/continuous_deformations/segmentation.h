// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "framework/domain/domain.h"
#include "framework/solver/eigen_backend.h"

namespace variform {

/// Vibration features of a shape at its vertices, |V| x clusters: of every cluster of equal eigenvalues (relative gap
/// below 1e-6) beyond the first `skip` modes the root of the sum of the squared velocities |v_i(x)|^2, which does not
/// depend on the basis chosen inside a cluster. modes: vectors of length d |V|, vertex by vertex (methods: continuous
/// deformation, 5.6).
Matrix mode_features(const EigenPairs& modes, Index skip, int d);

/// Stiffness descriptor of Martinez Esturo 2013, Figure 25: the sum of the features of each vertex.
Vector stiffness_descriptor(const Matrix& features);

/// Which vertices the graph of a segmentation joins.
enum class SegmentGraph {
  edges,       ///< those of an edge of the mesh
  similarity,  ///< also every vertex and the 12 with the most similar features, wherever they are
};

/// Partitions of the vertices by normalized cuts of a graph (Shi, Malik 2000), whose weights are exp(-|f_v - f_w|^2 /
/// (2 s^2)) of features f, s^2 the mean of the squared difference of the vertices that it joins.
struct Segmentation {
  int segments = 0;                      ///< chosen: before the largest rise of the cut value; `most` may matter
  std::vector<double> cut;               ///< normalized cut of 2, 3, ... segments
  std::vector<std::vector<int>> labels;  ///< of each vertex, for 2, 3, ... segments
};

/// For 2 to `most` segments. Eigenvectors come from the backend, clusters from Lloyd's iteration started by farthest
/// points; deterministic. Throws as the backend, UsageError for a graph of fewer vertices than segments.
Segmentation segment(const Domain& domain, const Matrix& features, int most, SegmentGraph graph, EigenBackend& backend);

/// Share of the labelled vertices (reference >= 0) that the best one-to-one match of segments to reference labels
/// explains; segments without a partner count as wrong.
double agreement(const std::vector<int>& labels, const std::vector<int>& reference);

}  // namespace variform
