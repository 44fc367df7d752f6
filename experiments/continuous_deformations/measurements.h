// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "framework/domain/domain.h"
#include "framework/experiment/config.h"
#include "framework/experiment/pipeline.h"
#include "integrators/shape/handles.h"

namespace variform {

/// [measure] of a config: what is looked at beside the distortion of the whole shape. Coordinates are those of the rest
/// shape.
struct MeasureChoice {
  std::vector<double> region = {};     ///< box; cells whose centroid is inside
  std::vector<double> line = {};       ///< two points: vertices on the segment between them, in order
  std::vector<double> axis = {};       ///< direction, of the turn of the line
  std::vector<double> about = {};      ///< a point on that axis
  std::vector<double> direction = {};  ///< displacements orthogonal to it are measured
  std::string mirror = {};             ///< coordinate in whose direction the shape is symmetric
  std::string reflect = {};            ///< coordinate that changes its sign in the probes
  Index lattice = 0;                   ///< probes on a lattice instead of at the vertices
  bool condition = false;              ///< condition number of the matrix at the start
};

/// Parameters of [measure].
const std::vector<Parameter>& measure_parameters();
/// Throws UsageError naming the key for directions of length 0, and an axis without a line.
MeasureChoice read_measure(const Config& config);
/// Throws UsageError naming the key for what does not fit the mesh: sizes of points, regions without a cell, lines with
/// less than two vertices, lattices on rest shapes that are not flat.
void check_measure(const MeasureChoice& choice, const Domain& domain, const Config& config);

/// Metrics that measure() sets.
std::vector<Metric> measured_metrics();

/// Measures a state X (|V| x d) of a shape with handles:
///   displacement, E_isom_p99, centroid_shift, roughness (surfaces), near_handle_E_metr: of every shape;
///   region_..., line_stretch, line_turn, tangential, asymmetry: where [measure] asks for them.
void measure(const Domain& domain, const std::vector<Handle>& handles, const Matrix& X, const MeasureChoice& choice,
             Row& row);

/// What [compare] compares: images of the vertices, or of a lattice of points of the flat rest shape.
Matrix probe_images(const Domain& domain, const Matrix& X, const MeasureChoice& choice);

/// Angle in degrees by which the vertices turned from one state to another by the rotation that fits best, about the
/// axis that it has; `axis`, unless zero, decides the sign and becomes that axis. In the plane counter-clockwise, and
/// `axis` stays. NaN where no one rotation fits best: in space, vertices on a line.
double turned_angle(const Matrix& from, const Matrix& to, const std::vector<Index>& vertices, Eigen::Vector3d& axis);

}  // namespace variform
