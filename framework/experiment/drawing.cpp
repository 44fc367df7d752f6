// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/drawing.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <limits>
#include <tuple>

#include "framework/base/error.h"

namespace variform {
namespace {

namespace fs = std::filesystem;

constexpr int kTitleDigits = 6;  // sampled values have many

LinePlot line_plot(const PlotRequest& request, const std::vector<Row>& rows) {
  LinePlot plot{request.title, request.x, request.y, request.log_x, request.log_y, {}};
  for (const Row& row : rows) {
    if (!succeeded(row) || !request.where.holds(row)) continue;
    const Value* x = row.find(request.x);
    const Value* y = row.find(request.y);
    if (x == nullptr || y == nullptr) continue;
    const std::string label = group_text(row, request.series);
    auto curve = std::find_if(plot.curves.begin(), plot.curves.end(), [&](const Curve& c) { return c.label == label; });
    if (curve == plot.curves.end()) curve = plot.curves.insert(plot.curves.end(), Curve{label, {}, {}});
    curve->x.push_back(to_number(*x));
    curve->y.push_back(to_number(*y));
  }
  for (Curve& curve : plot.curves) {
    std::vector<std::pair<double, double>> points;
    for (std::size_t i = 0; i < curve.x.size(); ++i) points.emplace_back(curve.x[i], curve.y[i]);
    std::stable_sort(points.begin(), points.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    for (std::size_t i = 0; i < points.size(); ++i) std::tie(curve.x[i], curve.y[i]) = points[i];
  }
  return plot;
}

// What a reader needs to know of the marks that occur in a picture.
std::string legend(const std::vector<MeshFigure>& panels) {
  const auto any = [&panels](auto member) {
    return std::any_of(panels.begin(), panels.end(), [member](const MeshFigure& f) { return !(f.*member).empty(); });
  };
  std::vector<std::string> parts;
  if (any(&MeshFigure::fixed_vertices)) parts.emplace_back("squares: fixed vertices");
  if (any(&MeshFigure::moved_vertices)) parts.emplace_back("discs: moved ones");
  if (any(&MeshFigure::soft_vertices)) parts.emplace_back("open circles: soft constraints");
  if (any(&MeshFigure::flipped_cells)) parts.emplace_back("red outlines: flipped cells");
  if (parts.empty()) return {};
  std::string text = fmt::format(" {}.", fmt::join(parts, "; "));
  text[1] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[1])));
  return text;
}

// One picture of the figures of a name, a panel for each point.
void draw_figure(const Plan& plan, const std::string& name, std::vector<Point>& points, const fs::path& folder,
                 Record& record) {
  std::vector<MeshFigure> panels;
  std::vector<Vector> values;
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (MeshFigure& figure : points[i].result.figures) {
      if (figure.name != name) continue;
      if (static_cast<int>(panels.size()) >= plan.max_panels) {
        record.warnings.push_back(
            fmt::format("the figure '{}' shows the first {} results only (output.max_panels)", name, plan.max_panels));
        i = points.size() - 1;
        break;
      }
      panels.push_back(std::move(figure));
      MeshFigure& panel = panels.back();
      panel.title = group_text(record.rows[i], plan.swept_keys(), kTitleDigits);
      const auto flipped = panel.flipped_cells.size();
      if (flipped > 0) panel.title += fmt::format("{}{} flipped", panel.title.empty() ? "" : ", ", flipped);
      if (panel.uv.size() == 0) values.push_back(panel.cell_values);
    }
  }
  if (panels.empty()) return;
  const std::string given = panels.front().scale.label;
  const ColourScale scale = common_scale(values, plan.logarithmic, given.empty() ? "cell energy" : given);
  for (MeshFigure& panel : panels) panel.scale = scale;
  draw_meshes(panels, folder / "figures" / name, plan.panel_columns, plan.camera);
  std::string caption = panels.front().caption;
  if (caption.empty()) {
    caption = panels.front().uv.size() > 0 ? fmt::format("Figure '{}': image of a checkerboard.", name)
                                           : fmt::format("Figure '{}'; cells are coloured by: {}.", name, scale.label);
  }
  record.figures.push_back({caption + legend(panels), "figures/" + name});
  const double check_size = common_check_size(panels);
  for (MeshFigure& panel : panels) {
    if (!panel.is_spatial()) continue;
    if (panel.check_size == 0.0) panel.check_size = check_size;
    record.spatial.push_back(std::move(panel));
  }
}

// Steps over two decades and more are seen on a logarithmic axis only. Values that are not positive have no place
// there; of the searched key, that is the lower end 0.
bool is_logarithmic(const std::vector<Curve>& curves, std::vector<double> Curve::*values, bool zeros) {
  double low = std::numeric_limits<double>::infinity();
  double high = 0.0;
  for (const Curve& curve : curves) {
    for (const double value : curve.*values) {
      if (value < 0.0 || (value == 0.0 && !zeros)) return false;
      if (!(value > 0.0) || !std::isfinite(value)) continue;
      low = std::min(low, value);
      high = std::max(high, value);
    }
  }
  return high >= 100.0 * low;
}

void draw_searches(const fs::path& folder, Record& record) {
  struct Group {
    const Trials* first;
    std::string metric;
    LinePlot plot;
  };
  std::vector<Group> groups;
  for (const auto& [point, trials] : record.searches) {
    const std::string& x = trials.against.empty() ? trials.key : trials.against;
    for (const std::string& metric : trials.metrics) {
      auto group = std::find_if(groups.begin(), groups.end(), [&trials = trials, &metric](const Group& g) {
        return g.first->aim == trials.aim && g.metric == metric;
      });
      if (group == groups.end()) {
        LinePlot plot{.title = "Search: " + trials.aim, .x_label = x, .y_label = metric};
        group = groups.insert(groups.end(), Group{&trials, metric, std::move(plot)});
      }
      std::vector<std::pair<double, double>> points;
      for (const Row& row : trials.rows) {
        const Value* const at = row.find(x);
        const Value* const value = row.find(metric);
        if (at == nullptr || value == nullptr) continue;
        points.emplace_back(to_number(*at), to_number(*value));
        const double tried = to_number(*row.find(trials.key));
        const bool is_mark =
            trials.against.empty() ? tried == trials.low || tried == trials.high : tried == trials.value;
        if (trials.found && is_mark) group->plot.marks.push_back(to_number(*at));
      }
      std::stable_sort(points.begin(), points.end());
      Curve curve{.label = point.empty() ? metric : point};
      for (const auto& [at, value] : points) {
        curve.x.push_back(at);
        curve.y.push_back(value);
      }
      group->plot.curves.push_back(std::move(curve));
    }
  }
  for (std::size_t i = 0; i < groups.size(); ++i) {
    LinePlot& plot = groups[i].plot;
    plot.log_x = is_logarithmic(plot.curves, &Curve::x, true);
    plot.log_y = is_logarithmic(plot.curves, &Curve::y, false);
    add_plot(plot, fmt::format("search-{}", i + 1), folder, record);
    if (plot.marks.empty() || record.figures.empty()) continue;
    std::string& caption = record.figures.back().caption;
    if (caption == plot.title) {
      caption += groups[i].first->against.empty() ? ". Dashed: ends of the bracket." : ". Dashed: the corner.";
    }
  }
}

}  // namespace

void add_plot(const LinePlot& plot, const std::string& name, const fs::path& folder, Record& record) {
  if (const auto missing = draw_plot(plot, folder / "figures" / name))
    record.warnings.push_back(*missing);
  else
    record.figures.push_back({plot.title, "figures/" + name});
}

void draw_figures(const Plan& plan, std::vector<Point>& points, const fs::path& folder, Record& record) {
  const auto wanted = [&](const std::string& name) {
    return std::find(plan.figures.begin(), plan.figures.end(), name) != plan.figures.end();
  };
  const std::vector<std::string> swept = plan.swept_keys();
  for (const std::string& name : plan.pipeline->figures) {
    if (wanted(name)) draw_figure(plan, name, points, folder, record);
  }
  if (wanted("history")) {
    LinePlot plot{"Convergence", "iteration", "E (regularized energy); relative step", false, true, {}};
    for (std::size_t i = 0; i < points.size(); ++i) {
      for (const Curve& curve : points[i].result.history) {
        const std::string group = group_text(record.rows[i], swept, kTitleDigits);
        plot.curves.push_back({group.empty() ? curve.label : curve.label + ", " + group, curve.x, curve.y});
      }
    }
    if (!plot.curves.empty()) add_plot(plot, "history", folder, record);
  }
  draw_searches(folder, record);
  for (const PlotRequest& request : plan.plots) {
    try {
      const LinePlot plot = line_plot(request, record.rows);
      if (plot.curves.empty())
        record.warnings.push_back(
            fmt::format("plot '{}': no row has both '{}' and '{}'", request.name, request.x, request.y));
      else
        add_plot(plot, request.name, folder, record);
    } catch (const UsageError& error) {  // a condition that rows cannot decide must not cost the results
      record.warnings.push_back(fmt::format("plot '{}': {}", request.name, error.what()));
    }
  }
}

}  // namespace variform
