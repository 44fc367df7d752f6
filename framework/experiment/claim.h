// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "framework/experiment/config.h"
#include "framework/experiment/record.h"

namespace variform {

/// Condition on the keys of a row: comparisons joined by `and`, such as
///   norm.beta > 0 and energy.type == "arap"
/// with == != < <= > >=, numbers, strings in quotes, true and false. The empty condition holds always.
class Condition {
 public:
  Condition() = default;
  /// Throws UsageError saying where the text stops making sense.
  explicit Condition(const std::string& text);

  /// Throws UsageError naming the key when the row lacks it.
  bool holds(const Row& row) const;
  const std::string& text() const { return text_; }
  /// The keys it compares.
  std::vector<std::string> keys() const;

 private:
  struct Comparison {
    std::string key;
    std::string relation;
    Value value;
  };
  std::string text_;
  std::vector<Comparison> comparisons_;
};

/// A statement of a source in a form that rows can decide. As TOML:
///
///   [[claim]]
///   text      = "no flipped triangle when regularized"
///   published = "none"                     # optional: the source's number or words
///   where     = "norm.beta > 0"            # optional: which rows
///   metric    = "flipped"
///   is        = "== 0"                     # == != < <= > >= NUMBER, or
///                                          # nonincreasing, nondecreasing, increasing, decreasing
///   quantifier  = "all"                    # optional: all (default) or any of the rows, or their median
///   share       = 0.8                      # optional, with all: this share of the rows is enough
///   relative_to = "norm.beta == 0"         # optional: divide by the metric of this row (other swept keys equal)
///   minus       = "norm.beta == 0"         # optional: subtract it instead
///   along     = "norm.beta"                # for the four monotone relations: order of rows, other swept keys equal
///   tolerance = 1e-9                       # optional slack of monotone relations, relative
struct Claim {
  std::string text;
  std::string published;
  Condition where;
  std::string metric;
  std::string is;
  bool any = false;
  bool median = false;
  double share = 1.0;
  std::string relative_to;
  std::string minus;
  std::string along;
  double tolerance = 1e-9;
  std::string file_place;  ///< "FILE:LINE", for messages
};

/// Reads a [[claim]] table; throws UsageError with its place when it makes no sense.
Claim read_claim(const ConfigNode& node);

/// Decides a claim; says how many of the rows that count have converged = false. swept: the swept keys, by which rows
/// are matched to each other. A claim that the rows cannot decide (nothing matches, a metric is missing or not a
/// number, no or several rows to refer to, fewer than two rows in a group along a key) is undecided with the reason,
/// never held.
Verdict decide(const Claim& claim, const std::vector<Row>& rows, const std::vector<std::string>& swept);

}  // namespace variform
