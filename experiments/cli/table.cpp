// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <filesystem>

#include "experiments/cli/commands.h"
#include "framework/experiment/pivot.h"
#include "framework/experiment/record.h"

namespace variform {

ExitCode table(const TableArguments& arguments) {
  const std::filesystem::path file = std::filesystem::path(arguments.folder) / "record.json";
  const std::vector<Row> rows = load_rows(file);
  const bool is_pivot = !arguments.rows.empty() || !arguments.columns.empty();
  if (is_pivot == arguments.value.empty()) throw UsageError("expected --value with --rows, --columns or both");
  if (!is_pivot && !arguments.aggregate.empty()) throw UsageError("--aggregate is for --value");
  const Table table = is_pivot ? pivot(rows, {.rows = arguments.rows,
                                              .columns = arguments.columns,
                                              .value = arguments.value,
                                              .aggregate = arguments.aggregate})
                               : Table::of(rows);
  const std::string text = arguments.format == "csv"    ? table.csv()
                           : arguments.format == "tex"  ? table.latex()
                           : arguments.format == "json" ? table.json()
                                                        : table.markdown();
  fmt::print("{}", text);
  return ExitCode::done;
}

}  // namespace variform
