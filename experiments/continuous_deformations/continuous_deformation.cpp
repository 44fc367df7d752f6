// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Eigenvalues>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "energies/energies.h"
#include "energies/gradient/poisson.h"
#include "energies/vector_field/vector_field.h"
#include "experiments/continuous_deformations/handle_source.h"
#include "experiments/continuous_deformations/material.h"
#include "experiments/continuous_deformations/measurements.h"
#include "experiments/continuous_deformations/saved_integration.h"
#include "experiments/smoothed_energies/study.h"
#include "framework/base/error.h"
#include "framework/base/stopwatch.h"
#include "framework/experiment/known_keys.h"
#include "framework/operators/distortion.h"
#include "integrators/ode/ode_backends.h"
#include "integrators/shape/deformation_flow.h"
#include "solvers/linear/linear_backends.h"

namespace variform {
namespace {

const std::vector<std::string> kStarts = {"rest"};

// Largest matrix whose condition number is computed, by dense eigenvalues.
constexpr Index kDenseLimit = 3000;

std::vector<Parameter> norm_parameters() {
  std::vector<Parameter> parameters = velocity_norm_parameters();
  const std::vector<Parameter> smoothing = {
      {.name = "alpha",
       .value = 0.0,
       .doc =
           "smoothing of the energy's gradient in place of beta (Martinez Esturo 2013, eq. 23), a length, for weights "
           "(sin phi, cos phi)",
       .min = 0.0},
      {.name = "alpha_relative", .value = 0.0, .doc = "alpha by the diameter of the rest shape", .min = 0.0}};
  parameters.insert(parameters.end(), smoothing.begin(), smoothing.end());
  return parameters;
}

const std::vector<Parameter> kIntegratorParameters = {
    {.name = "type", .value = std::string("abm3"), .doc = "ODE backend; means nothing for energies of maps"},
    {.name = "tolerance", .value = 1e-4, .doc = "largest error of a step at a vertex, by the diameter", .min = 1e-15},
    {.name = "first_step",
     .value = 0.02,
     .doc = "first step by the interval; the step of euler and rk4",
     .min = 1e-9,
     .max = 1.0},
    {.name = "smallest_step", .value = 1e-6, .doc = "by the interval", .min = 1e-12, .max = 1.0},
    {.name = "max_steps", .value = std::int64_t{100000}, .doc = "accepted steps", .min = 1.0, .max = 1e9},
    {.name = "end", .value = 1.0, .doc = "time at the end; the start is 0", .min = 1e-9},
    {.name = "checkpoint_steps",
     .value = std::int64_t{50},
     .doc = "steps between saved states; the SUNDIALS methods start anew at each, few make many steps of them",
     .min = 1.0,
     .max = 1e9}};

const std::vector<Parameter> kTrajectoryParameters = {{.name = "frames",
                                                       .value = std::int64_t{20},
                                                       .doc = "after the start, evenly in time; 0: none",
                                                       .min = 0.0,
                                                       .max = 10000.0},
                                                      {.name = "colour",
                                                       .value = std::string("isometric"),
                                                       .doc = "distortion shown by the figures",
                                                       .choices = {"isometric", "conformal", "authalic", "metric"}}};

const std::vector<Parameter> kBaselineParameters = {
    {.name = "soft_weight",
     .value = 0.0,
     .doc = "handles by a penalty of this weight instead of interpolation; 0: hard",
     .min = 0.0},
    {.name = "boundary_diffusion",
     .value = false,
     .doc = "velocities of the energy on the boundary only, harmonic inside (Solomon et al. 2011)"}};

struct NormInput {
  NormOptions options = {};
  double alpha = 0.0;
  bool gradient = false;  // alpha was asked for
};

struct Input {
  NormInput norm;
  MeasureChoice measure;
  OdeOptions ode;
  std::string integrator;
  double end = 1.0;
  int checkpoint_steps = 50;
  std::int64_t frames = 20;
  std::string colour;
  double soft_weight = 0.0;
  bool boundary_diffusion = false;
};

// diameter 1: a check without a mesh.
NormInput read_norm_input(const Config& config, double diameter) {
  const Parameters p = section_of(config, "norm", norm_parameters());
  NormInput input;
  const auto given = [&](const char* key) { return config.root().has("norm") && config.root().at("norm").has(key); };
  if (given("alpha") + given("alpha_relative") + given("beta") > 1) {
    config.root().at("norm").fail("expected one of beta, alpha, alpha_relative");
  }
  input.options = {p.number("beta"), facet_weight_from(p.string("facet_weight"))};
  input.gradient = given("alpha") || given("alpha_relative");
  input.alpha = given("alpha_relative") ? p.number("alpha_relative") * diameter : p.number("alpha");
  return input;
}

Input read_input(const Config& config, double diameter) {
  Input input;
  input.norm = read_norm_input(config, diameter);
  input.measure = read_measure(config);
  const Parameters p = section_of(config, "integrator", kIntegratorParameters, {"options"});
  input.integrator = p.string("type");
  input.end = p.number("end");
  input.ode = {.tolerance = p.number("tolerance"),
               .first_step = p.number("first_step"),
               .smallest_step = p.number("smallest_step"),
               .max_steps = static_cast<int>(p.integer("max_steps"))};
  if (input.ode.smallest_step > input.ode.first_step) {
    config.root().at("integrator").fail("the smallest step is longer than the first one");
  }
  input.checkpoint_steps = static_cast<int>(p.integer("checkpoint_steps"));
  const Parameters trajectory = section_of(config, "trajectory", kTrajectoryParameters);
  input.frames = trajectory.integer("frames");
  input.colour = trajectory.string("colour");
  const Parameters baseline = section_of(config, "baseline", kBaselineParameters);
  input.soft_weight = baseline.number("soft_weight");
  input.boundary_diffusion = baseline.boolean("boundary_diffusion");
  return input;
}

std::unique_ptr<OdeBackend> make_integrator(const Config& config, const std::string& type) {
  std::optional<ConfigNode> node;
  if (config.root().has("integrator")) node = config.root().at("integrator");
  const auto make = [&] {
    const OdeBackendEntry& entry = ode_backends().find(type);
    const Parameters options =
        node && node->has("options") ? node->at("options").parameters(entry.parameters) : Parameters(entry.parameters);
    return make_ode_backend(type, options);
  };
  return node && node->has("type") ? node->at("type").located(make) : make();
}

std::vector<ConfigNode> tables(const Config& config, const char* name) {
  return config.root().has(name) ? config.root().at(name).elements() : std::vector<ConfigNode>();
}

bool is_velocity_energy(const Config& config) {
  const ConfigNode type = config.root().at("energy").at("type");
  return type.located([&]() -> const EnergyEntry& { return energies().find(type.string()); }).velocities;
}

std::vector<Metric> own_metrics() {
  std::vector<Metric> all = distortion_metrics({});
  const std::vector<Metric> measured = measured_metrics();
  all.insert(all.end(), measured.begin(), measured.end());
  const std::vector<Metric> flow = {
      {{"alpha"}, "smoothing of the energy's gradient, a length, for weights (sin phi, cos phi)"},
      {{"completed"}, "whether the end of the interval was reached"},
      {{"time_reached", "time reached"}, "of the interval"},
      {{"event"}, "what ended the integration before: the cell that inverts, or the solve that fails"},
      {{"integrator"}, "ODE backend; single_step for maps"},
      {{"steps"}, "accepted"},
      {{"rejected"}, "steps rejected for their error"},
      {{"refused"}, "steps refused because a cell inverts or a solve fails"},
      {{"evaluations"}, "of the velocity field: assemblies, factorizations, solves"},
      {{"evaluations_per_step", "evaluations/step"}, "evaluations by accepted steps"},
      {{"drift", "handle drift"},
       "largest distance of integrated handles from their paths before it was removed, by the diameter"},
      {{"handle_error"}, "largest distance of a handle from its path in the result, also of soft ones"},
      {{"handle_turn"},
       "degrees that the first moving handle turned, summed over frames, which must be less than half a turn apart"},
      {{"nnz_per_row", "non-zeros/row"}, "of the matrix that is factorized, both triangles"},
      {{"condition"}, "with measure.condition: condition number of the eliminated matrix at the start"},
      {{"seconds_t1", "t1", "s"}, "symbolic analysis and patterns"},
      {{"seconds_t2", "t2", "s"}, "of an evaluation: geometry, operators, assembly"},
      {{"seconds_t3", "t3", "s"}, "of an evaluation: numeric factorization and solve"},
      {{"seconds_t1_by_t3", "t1/t3"}, "how many evaluations the analysis costs"}};
  all.insert(all.end(), flow.begin(), flow.end());
  return all;
}

// Final positions of the handles as constraints of a map.
Constraints final_constraints(const Domain& domain, const std::vector<Handle>& handles, double end) {
  const int d = domain.ambient_dimension();
  std::map<Index, std::vector<bool>> held;
  for (const Handle& handle : handles) {
    for (const Index v : handle.vertices) {
      std::vector<bool>& components = held.try_emplace(v, d, false).first->second;
      for (int c = 0; c < d; ++c) components[c] = components[c] || handle.held[static_cast<std::size_t>(c)];
    }
  }
  Constraints constraints(domain.vertex_count(), d);
  const Matrix places = handle_positions(handles, domain.positions(), 0.0, end);
  for (const auto& [v, components] : held) {
    if (std::find(components.begin(), components.end(), false) == components.end()) {
      constraints.fix(v, places.row(v));
    } else {
      constraints.fix(v, places.row(v), components);
    }
  }
  return constraints;
}

LoadedConstraints marks_of(const Domain& domain, const std::vector<Handle>& handles) {
  LoadedConstraints marks{Constraints(domain.vertex_count(), domain.ambient_dimension()), {}, {}, {}};
  for (const Handle& handle : handles) {
    std::vector<Index>& list = handle.motion ? marks.moved : marks.fixed;
    list.insert(list.end(), handle.vertices.begin(), handle.vertices.end());
  }
  return marks;
}

Vector coloured(const CellDistortion& cells, const std::string& colour) {
  if (colour == "conformal") return cells.conformal;
  if (colour == "authalic") return cells.authalic;
  if (colour == "metric") return cells.metric;
  return cells.isometric;
}

// Everything a study of one shape keeps together.
struct Scene {
  const LoadedDomain& loaded;
  const Domain& domain;
  const std::vector<Handle>& handles;
  const Input& input;
  LoadedConstraints marks;

  MeshFigure figure(const std::string& name, const Matrix& X, const CellDistortion& cells) const {
    MeshFigure picture = study_figure(name, X, domain, coloured(cells, input.colour), marks, cells.flipped);
    picture.scale.label = input.colour + " distortion";
    return picture;
  }

  std::vector<MeshField> fields(const Matrix& X, const CellDistortion& cells) const {
    Matrix displacement = Matrix::Zero(X.rows(), 3);
    displacement.leftCols(X.cols()) = X - domain.positions();
    return {{"isometric_distortion", MeshField::On::cells, cells.isometric},
            {"conformal_distortion", MeshField::On::cells, cells.conformal},
            {"authalic_distortion", MeshField::On::cells, cells.authalic},
            {"metric_distortion", MeshField::On::cells, cells.metric},
            {"displacement", MeshField::On::vertices, loaded.values_as_input(displacement)}};
  }

  void finish(const Matrix& X, PointResult& result) const {
    const CellDistortion cells = cell_distortion(domain, X);
    result.mesh = loaded.as_input(X);
    result.fields = fields(X, cells);
    result.figures = {figure("deformed", X, cells)};
    result.probes = probe_images(domain, X, input.measure);
    result.probe_scale = domain.diameter();
  }
};

// Maps: handles at their final positions, one minimization (Martinez Esturo 2013, Figure 18: single-step methods).
void run_single_step(const Config& config, const Scene& scene, const Energy& energy, PointResult& result) {
  const Domain& domain = scene.domain;
  SolverChoice solver = read_solver(config, kStarts);
  NormChoice norm;
  norm.options = scene.input.norm.options;
  const Constraints constraints = final_constraints(domain, scene.handles, scene.input.end);
  Study study{domain, energy, norm, constraints, solver, {}, {}};
  study.start = [&](double) { return domain.positions(); };
  study.measure = [&](const Matrix& U, Row& row) {
    set_distortion(domain, U, row);
    measure(domain, scene.handles, U, scene.input.measure, row);
  };
  Vector local;
  const Matrix U = run_study(study, result, local);
  result.metrics.set("integrator", std::string("single_step"));
  result.metrics.set("completed", true);
  scene.finish(U, result);
}

double condition_number(Problem& problem) {
  const SparseMatrix& K = problem.reduced_matrix();
  if (K.rows() > kDenseLimit) return std::nan("");
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(
      Eigen::MatrixXd(SparseMatrix(K.selfadjointView<Eigen::Lower>())), Eigen::EigenvaluesOnly);
  return eigen.eigenvalues().maxCoeff() / eigen.eigenvalues().minCoeff();
}

// Integrates the flow, or goes on where an earlier run was interrupted, and keeps the frames.
class Integration {
 public:
  Integration(const Scene& scene, DeformationFlow& flow, OdeBackend& backend, const Workspace& workspace)
      : scene_(scene), flow_(flow), backend_(backend), workspace_(workspace) {}

  Matrix run() {
    OdeOptions options = scene_.input.ode;
    const double end = scene_.input.end;
    for (std::int64_t k = 0; k <= scene_.input.frames; ++k) {
      options.outputs.push_back(
          scene_.input.frames == 0 ? 0.0 : end * static_cast<double>(k) / static_cast<double>(scene_.input.frames));
    }
    const OdeObserver observer = {.step =
                                      [&](const OdeStep& step, const Vector&) {
                                        workspace_.progress(step.time / end);
                                        return true;
                                      },
                                  .output =
                                      [this](double t, const Vector& y) {
                                        add_frame(t, y);
                                        return true;
                                      },
                                  .checkpoint =
                                      [this](const OdeCheckpoint& at) {
                                        saved_.checkpoint = at;
                                        saved_.seconds = before_ + watch_.seconds();
                                        workspace_.save(to_bytes(saved_));
                                      },
                                  .checkpoint_steps = scene_.input.checkpoint_steps};
    std::optional<SavedIntegration> earlier;
    if (const std::optional<std::string> bytes = workspace_.load()) earlier = integration_from(*bytes);
    Vector y;
    if (earlier && earlier->checkpoint.state.size() == flow_.size()) {
      saved_ = std::move(*earlier);
      before_ = saved_.seconds;
      if (saved_.axis.size() == 3) axis_ = Eigen::Map<const Eigen::Vector3d>(saved_.axis.data());
      const OdeCheckpoint from = saved_.checkpoint;
      evaluations_before_ = from.report.evaluations;
      y = backend_.resume(flow_, from, 0.0, end, options, observer);
    } else {
      y = backend_.integrate(flow_, flow_.rest_state(), 0.0, end, options, observer);
    }
    const OdeReport& report = backend_.report();
    if (saved_.times.empty() || saved_.times.back() < report.time) add_frame(report.time, y);
    return DeformationFlow::positions_of(y, flow_.point_size());
  }

  const std::vector<double>& times() const { return saved_.times; }
  const std::vector<Vector>& states() const { return saved_.states; }
  double turned() const { return saved_.turned; }
  double seconds() const { return before_ + watch_.seconds(); }
  /// Evaluations of this run, without those before an interruption.
  std::int64_t own_evaluations() const { return backend_.report().evaluations - evaluations_before_; }

 private:
  void add_frame(double t, const Vector& y) {
    if (!saved_.states.empty()) {
      for (const Handle& handle : scene_.handles) {
        if (!handle.motion || handle.vertices.size() < 2) continue;
        const int d = flow_.point_size();
        saved_.turned += turned_angle(DeformationFlow::positions_of(saved_.states.back(), d),
                                      DeformationFlow::positions_of(y, d), handle.vertices, axis_);
        saved_.axis = {axis_[0], axis_[1], axis_[2]};
        break;
      }
    }
    saved_.times.push_back(t);
    saved_.states.push_back(y);
  }

  const Scene& scene_;
  DeformationFlow& flow_;
  OdeBackend& backend_;
  const Workspace& workspace_;
  SavedIntegration saved_;
  Eigen::Vector3d axis_ = Eigen::Vector3d::Zero();
  double before_ = 0.0;  // seconds
  std::int64_t evaluations_before_ = 0;
  Stopwatch watch_;
};

void run_continuous(const Config& config, const Scene& scene, Energy& energy, const Workspace& workspace,
                    const std::function<void(const Matrix&)>& carry, PointResult& result) {
  const Domain& domain = scene.domain;
  const Input& input = scene.input;
  SolverChoice solver = read_solver(config, kStarts);
  const std::unique_ptr<OdeBackend> backend = make_integrator(config, input.integrator);
  const auto dirichlet =
      make_poisson(Eigen::MatrixXd(Eigen::MatrixXd::Zero(domain.ambient_dimension(), domain.ambient_dimension())));
  const auto continuation_backend = make_linear_backend(solver.linear->report().backend);
  DeformationFlow flow(domain, energy, input.norm.options, scene.handles, 0.0, *solver.linear,
                       {.soft_weight = input.soft_weight,
                        .continued_by = input.boundary_diffusion ? dirichlet.get() : nullptr,
                        .continuation_backend = continuation_backend.get()});
  flow.carry = carry;

  Row& row = result.metrics;
  double condition = std::nan("");
  if (input.measure.condition) {
    Problem rest(domain, energy, input.norm.options, flow.problem().constraints());
    condition = condition_number(rest);
  }
  Integration integration(scene, flow, *backend, workspace);
  const Matrix X = integration.run();
  const OdeReport& report = backend->report();
  if (!report.completed) {
    result.warnings.push_back(fmt::format("the integration ended at t = {:.4g} of {:.4g}: {}", report.time, input.end,
                                          report.event.empty() ? report.reason : report.event));
  }

  // Frames, and what changes over them.
  std::vector<Curve> curves;
  const auto add = [&](const std::string& name, double t, double value) {
    auto curve = std::find_if(curves.begin(), curves.end(), [&](const Curve& c) { return c.label == name; });
    if (curve == curves.end()) curve = curves.insert(curves.end(), Curve{name, {}, {}});
    curve->x.push_back(t);
    curve->y.push_back(value);
  };
  for (std::size_t k = 0; k < integration.times().size(); ++k) {
    const double t = integration.times()[k];
    const Matrix positions = DeformationFlow::positions_of(integration.states()[k], domain.ambient_dimension());
    const CellDistortion cells = cell_distortion(domain, positions);
    const Distortion errors = distortion(domain, cells);
    add("E_isom", t, errors.isometric);
    add("E_conf", t, errors.conformal);
    add("E_auth", t, errors.authalic);
    add("E_metr", t, errors.metric);
    add("area ratio", t, errors.area_ratio);
    if (input.frames == 0) continue;
    Trajectory::Frame frame{t, scene.loaded.as_input(positions), scene.fields(positions, cells),
                            scene.figure("deformed", positions, cells)};
    result.trajectory.frames.push_back(std::move(frame));
  }
  for (const OdeStep& step : report.history) {
    add("step size", step.time, step.size);
    add("handle drift", step.time, step.drift);
  }
  result.trajectory.curves = std::move(curves);

  const std::int64_t evaluations = report.evaluations;
  const ProblemTimes times = flow.problem().times();
  const auto each = static_cast<double>(std::max<std::int64_t>(1, integration.own_evaluations()));
  row.set("beta", input.norm.options.beta);
  row.set("alpha", input.norm.gradient ? Value(input.norm.alpha) : Value());
  row.set("facet_weight", to_string(input.norm.options.facet_weight));
  set_distortion(domain, X, row);
  measure(domain, scene.handles, X, input.measure, row);
  row.set("completed", report.completed);
  row.set("time_reached", report.time);
  row.set("event", report.event);
  row.set("integrator", report.backend);
  row.set("steps", static_cast<std::int64_t>(report.steps));
  row.set("rejected", static_cast<std::int64_t>(report.rejected));
  row.set("refused", static_cast<std::int64_t>(report.refused));
  row.set("evaluations", evaluations);
  row.set("evaluations_per_step", static_cast<double>(evaluations) / std::max(1, report.steps));
  row.set("drift", report.drift);
  row.set("handle_error", flow.handle_error(report.time, X));
  row.set("handle_turn", integration.turned());
  const Vector end = Eigen::Map<const Vector>(X.data(), X.size());
  try {
    Vector ignored(flow.size());
    flow.velocity(report.time, end, ignored);
    const EnergyValue energy_now = flow.energy();
    row.set("energy", energy_now.plain);
    row.set("energy_R", energy_now.variation);
    row.set("energy_W", energy_now.total);
  } catch (const StepRefused&) {
    // A shape that an event left without velocities has no energy.
  }
  if (input.measure.condition) row.set("condition", condition);
  const LinearReport& linear = solver.linear->report();
  row.set("solver", linear.backend);
  row.set("solver_residual", linear.residual);
  row.set("analyses", static_cast<std::int64_t>(linear.analyses));
  set_system(linear, row);
  row.set("nnz_per_row", 2.0 * static_cast<double>(linear.nnz_matrix) / static_cast<double>(linear.columns) - 1.0);
  row.set("seconds_t1", times.pattern + times.analyze);
  row.set("seconds_t2", (flow.geometry_seconds() + times.declare + times.refill) / each);
  row.set("seconds_t3", (times.factorize + times.solve) / each);
  row.set("seconds_t1_by_t3", (times.pattern + times.analyze) * each / (times.factorize + times.solve));
  set_times(times, integration.seconds(), row);
  scene.finish(X, result);
}

void check(const Config& config) {
  check_domain(config.root().at("domain"));
  const bool velocities = is_velocity_energy(config);
  const ConfigNode type = config.root().at("energy").at("type");
  const auto energy = read_energy(config.root().at("energy"), velocities);
  const Input input = read_input(config, 1.0);
  read_solver(config, kStarts);
  const std::vector<ConfigNode> handles = tables(config, "handle");
  if (handles.empty()) throw UsageError("continuous_deformation: expected [[handle]] tables: nothing holds the shape");
  check_handle_tables(handles);
  const std::vector<ConfigNode> materials = tables(config, "material");
  check_materials(materials);
  if (input.norm.gradient || !materials.empty()) check_has_material(type, *energy);
  make_integrator(config, input.integrator);
  if (!velocities && (input.soft_weight > 0.0 || input.boundary_diffusion)) {
    config.root().at("baseline").fail("is for energies of velocity fields");
  }
}

PointResult run(const Config& config, const Workspace& workspace) {
  const ConfigNode root = config.root();
  const LoadedDomain loaded = load_domain(root.at("domain"), config.folder());
  const Domain& domain = loaded.domain;
  Input input = read_input(config, domain.diameter());
  check_measure(input.measure, domain, config);
  const bool velocities = is_velocity_energy(config);
  std::unique_ptr<Energy> energy = read_energy(root.at("energy"), velocities);
  std::function<void(const Matrix&)> carry;
  if (velocities) {
    const Material material = load_material(tables(config, "material"), domain);
    carry = apply_material(root.at("energy"), material, domain, input.norm.gradient, energy);
    if (input.norm.gradient) input.norm.options.beta = smoothing_beta(*energy, domain, input.norm.alpha);
  }
  const EnergyTraits traits = root.at("energy").at("type").located([&] { return energy->traits(domain); });
  const std::vector<ConfigNode> handle_tables = tables(config, "handle");
  const std::vector<Handle> handles = load_handles(handle_tables, loaded, {0.0, input.end});
  for (std::size_t k = 0; k < handles.size(); ++k) {
    const auto& held = handles[k].held;
    if (std::all_of(held.begin(), held.begin() + domain.ambient_dimension(), [](bool h) { return h; })) continue;
    if (input.soft_weight > 0.0) handle_tables[k].at("held").fail("soft handles hold all components");
    if (traits.columns > 1) handle_tables[k].at("held").fail("this energy solves for each coordinate separately");
  }

  PointResult result;
  result.warnings = loaded.warnings;
  set_sizes(domain, result.metrics);
  const Scene scene{loaded, domain, handles, input, marks_of(domain, handles)};
  if (velocities) {
    run_continuous(config, scene, *energy, workspace, carry, result);
  } else {
    run_single_step(config, scene, *energy, result);
  }
  return result;
}

std::vector<Section> sections() {
  std::vector<Section> all;
  for (const Section& s : study_sections(kStarts)) {
    if (s.name == "solver") all.push_back(s);
  }
  all.push_back({"norm", norm_parameters()});
  all.push_back({"integrator", kIntegratorParameters});
  all.push_back({"trajectory", kTrajectoryParameters});
  all.push_back({"baseline", kBaselineParameters});
  all.push_back({"measure", measure_parameters()});
  return all;
}

}  // namespace

PipelineEntry describe_continuous_deformation() {
  std::vector<Metric> metrics = study_metrics(own_metrics());
  metrics.push_back(
      {{"map_difference"}, "with [compare]: largest distance of probe images from the reference, by the diameter"});
  metrics.push_back({{"map_difference_mean"}, "with [compare]: their mean"});
  return {.name = "continuous_deformation",
          .doc =
              "moves a shape by handles: velocities of least energy on the current shape, integrated in time; or, for "
              "energies of maps, a single step to the final handles (Martinez Esturo 2013, ch. 3 and 4)",
          .sections = {"domain", "energy", "norm", "handle", "material", "solver", "integrator", "trajectory",
                       "baseline", "measure"},
          .parameters = sections(),
          .metrics = metrics,
          .figures = {"deformed"},
          .run = run,
          .inputs = study_inputs,
          .check = check};
}

}  // namespace variform
