// SPDX-License-Identifier: BSD-3-Clause
#include "tests/experiment_child/trouble.h"

#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <new>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "framework/base/error.h"

namespace variform {
namespace {

std::int64_t integer_or(const ConfigNode& model, const std::string& key, std::int64_t fallback) {
  return model.has(key) ? model.at(key).integer() : fallback;
}

// A triangle that grows step by step, and keeps what it has. Started anew, it may be killed, hang or fail at a step.
PointResult flow(const ConfigNode& model, const Workspace& workspace) {
  const std::int64_t steps = integer_or(model, "steps", 3);
  const double x = model.at("x").number();
  const std::optional<std::string> kept = workspace.load();
  const std::int64_t start = kept ? std::stoll(*kept) : 0;
  const auto ends_at = [&](const char* key, std::int64_t step) { return !kept && integer_or(model, key, -1) == step; };
  for (std::int64_t step = start; step < steps; ++step) {
    if (ends_at("kill_at", step)) raise(SIGKILL);
    if (ends_at("hang_at", step)) std::this_thread::sleep_for(std::chrono::hours(1));
    if (ends_at("fail_at", step)) throw SolverError("no step");
    if (ends_at("no_memory_at", step)) throw std::bad_alloc();
    if (ends_at("odd_at", step)) throw std::logic_error("odd");
    workspace.save(std::to_string(step + 1));
    workspace.progress(static_cast<double>(step + 1) / static_cast<double>(steps));
  }
  PointResult result;
  result.metrics.set("E", x * static_cast<double>(steps));
  result.metrics.set("drawn", start);
  Curve size{.label = "size", .x = {}, .y = {}};
  for (std::int64_t step = 0; step <= steps; ++step) {
    Trajectory::Frame frame{.time = 0.1 * static_cast<double>(step)};
    const double length = 1.0 + x * frame.time;
    frame.mesh.positions = (Matrix(3, 2) << 0, 0, length, 0, 0, length).finished();
    frame.mesh.cells = (IndexMatrix(1, 3) << 0, 1, 2).finished();
    frame.fields = {{"value", MeshField::On::cells, Matrix::Constant(1, 1, length)}};
    frame.figure = {.name = "motion", .mesh = frame.mesh, .cell_values = Vector::Constant(1, length)};
    size.x.push_back(frame.time);
    size.y.push_back(length);
    result.trajectory.frames.push_back(std::move(frame));
  }
  result.trajectory.curves = {size};
  return result;
}

PointResult run(const Config& config, const Workspace& workspace) {
  const ConfigNode model = config.root().at("model");
  const std::string what = model.string_or("what", "work");
  if (what == "flow") return flow(model, workspace);
  if (what == "throw") throw DataError("broken data");
  if (what == "abort") {
    std::signal(SIGABRT, SIG_DFL);
    std::abort();
  }
  if (what == "hang") std::this_thread::sleep_for(std::chrono::hours(1));
  if (what == "hog") take_memory(4000);
  if (what == "bad_alloc") throw std::bad_alloc();
  if (what == "vanish") _exit(0);
  const double x = model.at("x").number();
  PointResult result;
  result.metrics.set("E", x * x);
  result.metrics.set("drawn", model.has("seed") ? Value(model.at("seed").integer()) : Value());
  result.mesh.positions = Matrix::Zero(3, 2);
  result.mesh.positions << 0, 0, 1, 0, 0, 1;
  result.mesh.cells = (IndexMatrix(1, 3) << 0, 1, 2).finished();
  result.figures = {{.name = "deformed", .mesh = result.mesh, .cell_values = Vector::Constant(1, x)}};
  result.history = {{"E", {0.0, 1.0}, {x, x * x}}};
  result.probes = Matrix::Constant(1, 2, x / 3.0);
  if (x < 0.0) result.warnings.push_back("negative");
  return result;
}

}  // namespace

const Registry<PipelineEntry>& trouble_pipelines() {
  static const Registry<PipelineEntry> registry(
      "pipeline", {{.name = "trouble",
                    .doc = "for tests",
                    .sections = {"model"},
                    .metrics = {{{"E"}, "x^2"}, {{"drawn"}, "the seed; of a flow the first step"}},
                    .figures = {"deformed", "motion"},
                    .run = run}});
  return registry;
}

void take_memory(int mib, double seconds) {
  constexpr std::size_t kBlock = std::size_t{8} << 20;
  std::vector<char*> blocks;
  for (int taken = 0; taken < mib; taken += 8) {
    blocks.push_back(static_cast<char*>(std::malloc(kBlock)));
    if (blocks.back() == nullptr) throw std::bad_alloc();
    std::memset(blocks.back(), taken % 7 + 1, kBlock);
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
  for (char* block : blocks) std::free(block);
}

}  // namespace variform
