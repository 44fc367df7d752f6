// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "framework/experiment/constraint_source.h"
#include "framework/experiment/domain_source.h"
#include "framework/experiment/pipeline.h"
#include "framework/experiment/search.h"
#include "framework/form/problem.h"

namespace variform {

/// How beta = "auto" is found; [norm.auto] in a config.
struct BetaSearch {
  bool l_curve = false;  ///< corner of the L-curve instead of the smallest value that fulfils a condition
  ThresholdSearch threshold = {};
  LCurveSearch corner = {};
  bool warm_start = false;  ///< nonlinear runs start from the last trial's result instead of the start of the study
};

/// [norm] of a config.
struct NormChoice {
  NormOptions options = {};
  std::optional<BetaSearch> search = {};
};

/// [solver] of a config.
struct SolverChoice {
  std::unique_ptr<LinearBackend> linear;
  std::unique_ptr<NonlinearBackend> nonlinear;
  NonlinearOptions options = {};
  std::string start = {};
  std::string start_energy = {};  ///< of start = "regularized"; empty: the pipeline's own
  double start_beta = 0.0;
  bool backend_named = false;  ///< whether the config names the nonlinear backend, and the start
  bool start_named = false;
};

/// What the pipelines of this chapter share: a regularized energy on a domain under constraints, minimized once or for
/// the beta that a search asks for.
struct Study {
  const Domain& domain;
  const Energy& energy;
  const NormChoice& norm;
  const Constraints& constraints;
  SolverChoice& solver;
  /// Where nonlinear backends start for a given beta, |V| x d; moved to satisfy the hard constraints.
  std::function<Matrix(double beta)> start;
  /// Metrics of a result U that only the pipeline knows; the condition of a search may ask for them.
  std::function<void(const Matrix& U, Row& row)> measure;
};

/// Runs a study and returns the result U (|V| x d). Puts the metrics of study_metrics() and of Study::measure, the
/// convergence history, the trials of a search and warnings into `result`; local_energy becomes |r_s|^2 of each site.
Matrix run_study(Study& study, PointResult& result, Vector& local_energy);

/// All metrics of run_study, in order, for PipelineEntry::metrics; `own` in between, after the energies.
std::vector<Metric> study_metrics(const std::vector<Metric>& own);
/// Metrics of a map's distortion, as set_distortion fills them in, and `more`.
std::vector<Metric> distortion_metrics(const std::vector<Metric>& more);

/// Reads [energy]; velocities: which of the energies make sense. Throws UsageError naming the key.
std::unique_ptr<Energy> read_energy(const ConfigNode& node, bool velocities);
/// own: the metrics of Study::measure, which the condition of a search may ask for. Throws UsageError naming the key.
NormChoice read_norm(const Config& config, const std::vector<Metric>& own);
/// starts: accepted values of solver.start, the first is the default.
SolverChoice read_solver(const Config& config, const std::vector<std::string>& starts);
/// What barrier energies take where the config does not say: the backend newton, and this start.
void adapt_to_barrier(const EnergyTraits& traits, const std::string& start, SolverChoice& solver);
/// start = "regularized": the minimizer of another energy at solver.start_beta, which flips nothing if that is large
/// enough, found from the state `from` (|V| x d); `energy` where the config names none. Throws UsageError for energies
/// that do not map to the same dimension.
Matrix regularized_start(const Study& study, const std::string& energy, const Matrix& from);
/// The parameters of [norm], [norm.auto] and [solver], for listings.
std::vector<Section> study_sections(const std::vector<std::string>& starts);
std::vector<ConfigNode> constraint_tables(const Config& config);
/// The mesh file of [domain], if any.
std::vector<std::filesystem::path> study_inputs(const Config& config);

/// A section of a config as checked parameters, all defaults where it has none.
Parameters section_of(const Config& config, const std::string& name, const std::vector<Parameter>& declared,
                      const std::vector<std::string>& others = {});
/// beta, which may be 1, and facet_weight: [norm] of pipelines for energies of velocities.
const std::vector<Parameter>& velocity_norm_parameters();

/// Size of the last system, and seconds of all phases, for the end of a row.
void set_system(const LinearReport& report, Row& row);
void set_times(const ProblemTimes& times, double total, Row& row);
/// Sizes and quality of the mesh, for the head of a row.
void set_sizes(const Domain& domain, Row& row);
void set_distortion(const Domain& domain, const Matrix& U, Row& row);
/// Fields of a result for the VTU, per cell or vertex as the energy has its residuals.
MeshField local_energy_field(const LoadedDomain& loaded, const Vector& local_energy);
/// Picture of a domain's cells at other positions, coloured by local energy, constraints marked.
MeshFigure study_figure(const std::string& name, const Matrix& positions, const Domain& domain,
                        const Vector& local_energy, const LoadedConstraints& constraints,
                        const std::vector<Index>& flipped);
/// Images of a lattice of lattice x lattice points of the bounding box under the map with vertex values U (|V| x d), a
/// row each, NaN outside the domain. For triangles in the xy-plane at rest.
Matrix lattice_images(const Domain& domain, const Matrix& U, Index lattice);
/// Values per cell for colours: those of vertices averaged.
Vector on_cells(const Domain& domain, const Vector& values);

}  // namespace variform
