// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "framework/experiment/config.h"
#include "framework/experiment/table.h"

namespace variform {

/// A table of one metric over two sets of keys: a line for each combination of the values of `rows`, a column for each
/// of `columns`, both in order of first appearance.
struct PivotRequest {
  std::vector<std::string> rows = {};
  std::vector<std::string> columns = {};
  std::string value = {};
  /// What a cell of several rows shows: "mean", "median", "min", "max" of their finite numbers (flags count as 0 and
  /// 1), "count" of the rows that have the metric. Empty: every cell has at most one row, which it shows as it is.
  std::string aggregate = {};
};

/// Reads [[output.pivot]]; throws UsageError with its place.
PivotRequest read_pivot(const ConfigNode& node);

/// The table. Rows without the metric leave no trace in cells, but have lines and columns. Throws UsageError for an
/// aggregate that is none, a key that no row has (naming those there are), texts that cannot be aggregated, and cells
/// of several rows without an aggregate (naming them).
Table pivot(const std::vector<Row>& rows, const PivotRequest& request);

}  // namespace variform
