// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <benchmark/benchmark.h>

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "framework/base/stopwatch.h"
#include "framework/domain/domain.h"
#include "framework/form/problem.h"

namespace variform::benchmarks {

/// What all benchmarks work on: a jittered square of about the given number of triangles, the left side held and the
/// right side moved.
struct Scene {
  Scene(const std::string& energy_name, double beta, Index cells);

  /// Declared anew: E, c and W of the energy.
  Problem problem() const { return {domain, *energy, norm, constraints}; }

  Domain domain;
  std::unique_ptr<Energy> energy;
  NormOptions norm;
  Constraints constraints;
};

/// CPU time of the calling thread so far.
double thread_cpu_seconds();

/// Timings of things that are measured in turn within each iteration of one benchmark, so that a change in the load of
/// the machine hits all of them alike. Ratios are those of medians.
class Samples {
 public:
  template <class Action>
  double time(const std::string& name, const Action& action) {
    const Stopwatch watch;
    action();
    seconds_[name].push_back(watch.seconds());
    return seconds_[name].back();
  }
  void add(const std::string& name, double seconds) { seconds_[name].push_back(seconds); }
  /// CPU time of the calling thread, which should be the only one at work: hardly depends on what else runs.
  template <class Action>
  double cpu_time(const std::string& name, const Action& action) {
    const double before = thread_cpu_seconds();
    action();
    add(name, thread_cpu_seconds() - before);
    return seconds_[name].back();
  }

  double median(const std::string& name) const;
  double ratio(const std::string& name, const std::string& other) const { return median(name) / median(other); }

  /// The median of everything, in milliseconds, as counter "<name>_ms".
  void report(benchmark::State& state) const;

 private:
  std::map<std::string, std::vector<double>> seconds_;
};

/// Largest resident set of this process so far, in bytes.
double peak_memory();

}  // namespace variform::benchmarks
