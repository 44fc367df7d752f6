// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "framework/experiment/table.h"

namespace variform {

/// What a search tried, in the order in which it was tried: kept with the result, put into record.json, tabled and
/// plotted by the runner. Pipelines that search by themselves (a value of a key that the config leaves open, such as
/// norm.beta = "auto") push it to PointResult::trials.
///
/// A trial is a row: the key's value under the key's name, then
///   asked   why this value was tried: "low end", "high end", "start", "grow", "shrink", "bisect" or "grid"
///   held    whether the condition held there (for L-curves: whether the point could be used)
/// then all metrics of the run, as it gave them.
struct Trials {
  std::string key = {};                   ///< name of the searched value, for example "norm.beta"
  std::string aim = {};                   ///< what was searched for, in words; for captions
  std::vector<std::string> metrics = {};  ///< of interest: columns of the table, curves of the plot
  std::string against = {};               ///< abscissa of the plot: a metric; empty: the key
  std::vector<Row> rows = {};
  bool found = false;
  double value = 0.0;                     ///< the answer; NaN when there is none
  double low = 0.0;                       ///< bracket of the answer, in values of the key
  double high = 0.0;                      ///< upper end of the bracket
  std::vector<std::string> remarks = {};  ///< what did not go as theory has it, one sentence each
};

}  // namespace variform
