// SPDX-License-Identifier: BSD-3-Clause
#include "tests/experiment_child/trouble.h"

#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <new>
#include <thread>
#include <vector>

#include "framework/base/error.h"

namespace variform {
namespace {

PointResult run(const Config& config) {
  const ConfigNode model = config.root().at("model");
  const std::string what = model.string_or("what", "work");
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
  static const Registry<PipelineEntry> registry("pipeline", {{.name = "trouble",
                                                              .doc = "for tests",
                                                              .sections = {"model"},
                                                              .metrics = {{{"E"}, "x^2"}, {{"drawn"}, "the seed"}},
                                                              .figures = {"deformed"},
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
