// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/claim.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <optional>
#include <string_view>

#include "framework/base/error.h"
#include "framework/experiment/config_keys.h"

namespace variform {
namespace {

constexpr std::array<const char*, 6> kRelations = {"==", "!=", "<=", ">=", "<", ">"};
constexpr std::array<const char*, 4> kMonotone = {"nonincreasing", "nondecreasing", "increasing", "decreasing"};

std::string trimmed(const std::string& text) {
  const std::size_t first = text.find_first_not_of(" \t\n");
  const std::size_t last = text.find_last_not_of(" \t\n");
  return first == std::string::npos ? std::string() : text.substr(first, last - first + 1);
}

std::optional<double> parsed_number(const std::string& text) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

Value parsed_value(const std::string& text, const std::string& context) {
  if (text.size() >= 2 && (text.front() == '"' || text.front() == '\'') && text.back() == text.front()) {
    return text.substr(1, text.size() - 2);
  }
  if (text == "true") return true;
  if (text == "false") return false;
  if (const auto number = parsed_number(text)) return *number;
  throw UsageError(
      fmt::format("condition '{}': '{}' is no number, no quoted string, not true or false", context, text));
}

// A NaN stands in no relation to anything, not even in !=.
bool compare(double a, const std::string& relation, double b) {
  if (std::isnan(a)) return false;
  if (relation == "==") return a == b;
  if (relation == "!=") return a != b;
  if (relation == "<=") return a <= b;
  if (relation == ">=") return a >= b;
  if (relation == "<") return a < b;
  return a > b;
}

bool is_monotone(const std::string& is) { return std::find(kMonotone.begin(), kMonotone.end(), is) != kMonotone.end(); }

// "<= 0.5" -> (("<=", 0.5)); "in [1, 2]" -> ((">=", 1), ("<=", 2)): all must hold.
std::vector<std::pair<std::string, double>> parsed_relations(const std::string& is) {
  for (const std::string relation : kRelations) {
    if (is.rfind(relation, 0) != 0) continue;
    if (const auto number = parsed_number(trimmed(is.substr(relation.size())))) return {{relation, *number}};
  }
  if (const std::size_t comma = is.find(',');
      is.rfind("in [", 0) == 0 && is.back() == ']' && comma != std::string::npos) {
    const auto low = parsed_number(trimmed(is.substr(4, comma - 4)));
    const auto high = parsed_number(trimmed(is.substr(comma + 1, is.size() - comma - 2)));
    if (low && high && *low <= *high) return {{">=", *low}, {"<=", *high}};
  }
  throw UsageError(fmt::format("'is' = \"{}\": expected a comparison with a number ({}), in [LOW, HIGH], or one of {}",
                               is, fmt::join(kRelations, " "), fmt::join(kMonotone, ", ")));
}

// The swept keys of a row but those named, as one text: rows with the same text belong together.
std::string group_of(const Row& row, const std::vector<std::string>& swept, const std::vector<std::string>& but) {
  std::string group;
  for (const std::string& key : swept) {
    if (std::find(but.begin(), but.end(), key) != but.end()) continue;
    const Value* value = row.find(key);
    group += key + "=" + (value == nullptr ? "" : to_text(*value)) + ";";
  }
  return group;
}

// A minimization that did not converge, or an integration that did not reach the end.
bool is_unconverged(const Row& row) {
  const auto is_false = [&row](const char* key) {
    const Value* value = row.find(key);
    return value != nullptr && std::holds_alternative<bool>(*value) && !std::get<bool>(*value);
  };
  return is_false("converged") || is_false("completed");
}

std::string range_text(const std::vector<double>& values) {
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  const std::string rows = values.size() == 1 ? "1 row" : fmt::format("{} rows", values.size());
  return *low == *high ? fmt::format("{:.4g} ({})", *low, rows)
                       : fmt::format("{:.4g} to {:.4g} ({})", *low, *high, rows);
}

// Whether a comparison ends inside a quoted value: then the " and " behind it is part of the value.
bool has_open_quote(const std::string& comparison) {
  const std::size_t open = comparison.find_first_of("\"'");
  return open != std::string::npos && (comparison.back() != comparison[open] || open + 1 == comparison.size());
}

}  // namespace

Condition::Condition(const std::string& text) : text_(trimmed(text)) {
  constexpr std::string_view kJoint = " and ";
  std::string rest = text_;
  while (!rest.empty()) {
    std::size_t joint = rest.find(kJoint);
    while (joint != std::string::npos && has_open_quote(trimmed(rest.substr(0, joint)))) {
      joint = rest.find(kJoint, joint + 1);
    }
    const std::string part = trimmed(rest.substr(0, joint));
    rest = joint == std::string::npos ? "" : rest.substr(joint + kJoint.size());
    Comparison comparison;
    const std::size_t at = part.find_first_of("=!<>");
    if (at != std::string::npos) {
      for (const std::string relation : kRelations) {
        if (part.compare(at, relation.size(), relation) == 0) {
          comparison.relation = relation;
          break;
        }
      }
    }
    if (comparison.relation.empty()) {
      throw UsageError(fmt::format("condition '{}': '{}' is no comparison; expected KEY {} VALUE", text_, part,
                                   fmt::join(kRelations, "|")));
    }
    comparison.key = trimmed(part.substr(0, at));
    comparison.value = parsed_value(trimmed(part.substr(at + comparison.relation.size())), text_);
    if (comparison.key.empty() || comparison.key.find_first_of(" \t") != std::string::npos) {
      throw UsageError(
          fmt::format("condition '{}': expected one key in front of '{}' in '{}'", text_, comparison.relation, part));
    }
    if (!std::holds_alternative<double>(comparison.value) && comparison.relation != "==" &&
        comparison.relation != "!=") {
      throw UsageError(fmt::format("condition '{}': texts and flags can only be compared by == and !=", text_));
    }
    comparisons_.push_back(comparison);
  }
}

std::vector<std::string> Condition::keys() const {
  std::vector<std::string> keys;
  for (const Comparison& comparison : comparisons_) keys.push_back(comparison.key);
  return keys;
}

bool Condition::holds(const Row& row) const {
  for (const Comparison& comparison : comparisons_) {
    const Value* value = row.find(comparison.key);
    if (value == nullptr) throw UsageError(fmt::format("condition '{}': rows have no key '{}'", text_, comparison.key));
    bool met = false;
    if (std::holds_alternative<std::string>(comparison.value) || std::holds_alternative<bool>(comparison.value)) {
      const bool equal = to_text(*value) == to_text(comparison.value);
      met = (comparison.relation == "==") == equal;
    } else if (std::holds_alternative<std::string>(*value)) {
      throw UsageError(
          fmt::format("condition '{}': '{}' is the text \"{}\", no number", text_, comparison.key, to_text(*value)));
    } else {
      met = compare(to_number(*value), comparison.relation, std::get<double>(comparison.value));
    }
    if (!met) return false;
  }
  return true;
}

Claim read_claim(const ConfigNode& node) {
  node.accept_keys(config_section("[[claim]]").names());
  Claim claim;
  claim.text = node.at("text").string();
  claim.published = node.string_or("published", "");
  claim.metric = node.at("metric").string();
  claim.is = trimmed(node.at("is").string());
  claim.relative_to = node.string_or("relative_to", "");
  claim.minus = node.string_or("minus", "");
  claim.along = node.string_or("along", "");
  claim.tolerance = node.number_or("tolerance", 1e-9);
  const std::string quantifier = node.string_or("quantifier", "all");
  if (quantifier != "all" && quantifier != "any" && quantifier != "median") {
    node.at("quantifier").fail("expected \"all\", \"any\" or \"median\"");
  }
  claim.any = quantifier == "any";
  claim.median = quantifier == "median";
  claim.share = node.number_or("share", 1.0);
  if (node.has("share")) {
    if (!(claim.share > 0.0 && claim.share <= 1.0)) node.at("share").fail("expected a number in (0, 1]");
    if (quantifier != "all") node.at("share").fail("only for quantifier = \"all\"");
  }
  if (node.has("where")) claim.where = node.at("where").located([&] { return Condition(node.at("where").string()); });
  for (const char* key : {"relative_to", "minus"}) {
    if (node.has(key)) node.at(key).located([&] { return Condition(node.at(key).string()); });
  }
  if (is_monotone(claim.is)) {
    if (claim.along.empty())
      node.fail(fmt::format("'is' = \"{}\" needs 'along', the key that orders the rows", claim.is));
    if (claim.any || claim.median) {
      node.at("quantifier").fail(fmt::format("'is' = \"{}\" is about all rows", claim.is));
    }
    if (node.has("share")) node.at("share").fail(fmt::format("'is' = \"{}\" is about all rows", claim.is));
  } else {
    node.at("is").located([&] { return parsed_relations(claim.is); });
    if (node.has("along")) node.at("along").fail(fmt::format("only for {}", fmt::join(kMonotone, ", ")));
  }
  if (node.has("relative_to") && node.has("minus")) node.fail("expected either 'relative_to' or 'minus'");
  if (!(claim.tolerance >= 0.0)) node.at("tolerance").fail("expected a number of at least 0");
  return claim;
}

Verdict decide(const Claim& claim, const std::vector<Row>& rows, const std::vector<std::string>& swept) {
  Verdict verdict;
  verdict.text = claim.text;
  verdict.published = claim.published;
  verdict.condition = claim.metric + " " + claim.is;
  if (!claim.along.empty()) verdict.condition += " along " + claim.along;
  if (!claim.relative_to.empty()) verdict.condition += ", relative to " + claim.relative_to;
  if (!claim.minus.empty()) verdict.condition += ", minus " + claim.minus;
  if (!claim.where.text().empty()) verdict.condition += ", where " + claim.where.text();
  if (claim.any) verdict.condition += ", for any row";
  if (claim.median) verdict.condition += ", for the median";
  if (claim.share < 1.0) verdict.condition += fmt::format(", for {:.0f} % of the rows", 100.0 * claim.share);
  try {
    const std::string& reference_text = claim.relative_to.empty() ? claim.minus : claim.relative_to;
    std::map<std::string, double> references;
    int unconverged = 0;  // rows that count, as themselves or as references
    const Condition reference(reference_text);
    const std::vector<std::string> reference_keys = reference.keys();
    if (!reference_text.empty()) {
      for (const Row& row : rows) {
        const Value* value = row.find(claim.metric);
        if (!reference.holds(row) || value == nullptr) continue;
        unconverged += is_unconverged(row);
        const std::string group = group_of(row, swept, reference_keys);
        if (!references.emplace(group, to_number(*value)).second) {
          verdict.reason = fmt::format("more than one row fulfils '{}' [{}]", reference_text, group);
          return verdict;
        }
      }
    }
    struct Point {
      std::string group;
      double along;
      double value;
    };
    std::vector<Point> points;
    for (const Row& row : rows) {
      if (!claim.where.holds(row)) continue;
      unconverged += is_unconverged(row);
      const Value* value = row.find(claim.metric);
      if (const Value* const failure = row.find("reason"); value == nullptr && failure != nullptr) {
        verdict.reason = fmt::format("'{}' is missing in a row that counts: {}: {}", claim.metric,
                                     to_text(*row.find("status")), to_text(*failure));
        return verdict;
      }
      double number = value == nullptr ? std::nan("") : to_number(*value);
      if (!reference_text.empty()) {
        const std::string group = group_of(row, swept, reference_keys);
        const auto found = references.find(group);
        if (found == references.end()) {
          verdict.reason = fmt::format("no row with '{}' fulfils '{}' [{}]", claim.metric, reference_text, group);
          return verdict;
        }
        number = claim.relative_to.empty() ? number - found->second : number / found->second;
      }
      if (!std::isfinite(number)) {
        verdict.reason = fmt::format("'{}' is not a number in a row that counts", claim.metric);
        return verdict;
      }
      double place = 0.0;
      if (!claim.along.empty()) {
        const Value* along = row.find(claim.along);
        place = along == nullptr ? std::nan("") : to_number(*along);
        if (std::isnan(place)) {
          verdict.reason = fmt::format("'{}' is not a number in a row that counts", claim.along);
          return verdict;
        }
      }
      points.push_back({group_of(row, swept, {claim.along}), place, number});
    }
    if (points.empty()) {
      verdict.reason = "no row matches";
      return verdict;
    }
    std::vector<double> values;
    for (const Point& point : points) values.push_back(point.value);
    verdict.ours = range_text(values);
    if (unconverged > 0) verdict.ours += fmt::format("; {} not converged", unconverged);
    if (claim.median) {
      std::sort(values.begin(), values.end());
      const std::size_t middle = values.size() / 2;
      values = {values.size() % 2 == 1 ? values[middle] : 0.5 * (values[middle - 1] + values[middle])};
      verdict.ours = fmt::format("median {:.4g}; {}", values.front(), verdict.ours);
    }
    bool holds = true;
    if (is_monotone(claim.is)) {
      std::map<std::string, int> sizes;
      for (const Point& point : points) ++sizes[point.group];
      for (const auto& [group, size] : sizes) {
        if (size < 2) {
          verdict.reason = fmt::format("fewer than two rows along '{}' [{}]", claim.along, group);
          return verdict;
        }
      }
      std::stable_sort(points.begin(), points.end(), [](const Point& a, const Point& b) {
        return a.group != b.group ? a.group < b.group : a.along < b.along;
      });
      for (std::size_t i = 1; i < points.size(); ++i) {
        if (points[i].group != points[i - 1].group) continue;
        const double slack = claim.tolerance * std::max(std::abs(points[i].value), std::abs(points[i - 1].value));
        const double change = points[i].value - points[i - 1].value;
        bool step = false;
        if (claim.is == "nonincreasing")
          step = change <= slack;
        else if (claim.is == "nondecreasing")
          step = change >= -slack;
        else if (claim.is == "increasing")
          step = change > slack;
        else
          step = change < -slack;
        if (!step) {
          holds = false;
          verdict.reason = fmt::format("{:.6g} is followed by {:.6g} at {} = {:.4g} [{}]", points[i - 1].value,
                                       points[i].value, claim.along, points[i].along, points[i].group);
        }
      }
    } else {
      const auto relations = parsed_relations(claim.is);
      std::size_t met = 0;
      for (const double value : values) {
        const auto broken = std::find_if(relations.begin(), relations.end(), [value](const auto& relation) {
          return !compare(value, relation.first, relation.second);
        });
        if (broken == relations.end()) {
          ++met;
        } else {
          verdict.reason = fmt::format("{:.6g} {} {:.6g} does not hold", value, broken->first, broken->second);
        }
      }
      const auto rows_that_count = static_cast<double>(values.size());
      holds = claim.any ? met > 0 : static_cast<double>(met) >= claim.share * rows_that_count * (1.0 - 1e-12);
      if (claim.any && !holds) verdict.reason = "holds for no row";
      if (claim.share < 1.0) {
        verdict.ours += fmt::format("; {:.0f} %", 100.0 * static_cast<double>(met) / rows_that_count);
        if (!holds) verdict.reason = fmt::format("holds for {} of {} rows", met, values.size());
      }
    }
    verdict.outcome = holds ? Verdict::Outcome::holds : Verdict::Outcome::fails;
    if (holds) verdict.reason.clear();
  } catch (const UsageError& error) {
    verdict.outcome = Verdict::Outcome::undecided;
    verdict.reason = error.what();
  }
  return verdict;
}

}  // namespace variform
