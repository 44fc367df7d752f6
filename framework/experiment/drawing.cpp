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
std::string legend(const std::vector<const MeshFigure*>& panels) {
  const auto any = [&panels](auto member) {
    return std::any_of(panels.begin(), panels.end(), [member](const MeshFigure* f) { return !(f->*member).empty(); });
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
  std::vector<const MeshFigure*> shown;
  for (const MeshFigure& panel : panels) shown.push_back(&panel);
  record.figures.push_back({caption + legend(shown), "figures/" + name});
  const double check_size = common_check_size(panels);
  for (MeshFigure& panel : panels) {
    if (!panel.is_spatial()) continue;
    if (panel.check_size == 0.0) panel.check_size = check_size;
    record.spatial.push_back(std::move(panel));
  }
}

// A picture of every frame of the trajectories whose figures have a name, on one scale.
void draw_animation(const Plan& plan, const std::string& name, std::vector<Point>& points, const fs::path& folder,
                    Record& record) {
  std::vector<Vector> values;
  std::vector<const MeshFigure*> all;
  const auto has_it = [&name](const Trajectory& trajectory) {
    if (trajectory.frames.empty()) return false;
    const MeshFigure& figure = trajectory.frames.front().figure;
    return figure.name == name && figure.mesh.cell_count() > 0;
  };
  for (const Point& point : points) {
    if (!has_it(point.result.trajectory)) continue;
    for (const Trajectory::Frame& frame : point.result.trajectory.frames) {
      all.push_back(&frame.figure);
      if (frame.figure.uv.size() == 0) values.push_back(frame.figure.cell_values);
    }
  }
  if (all.empty()) return;
  const std::string given = all.front()->scale.label;
  const ColourScale scale = common_scale(values, plan.logarithmic, given.empty() ? "cell energy" : given);
  Animation animation{.caption = all.front()->caption};
  if (animation.caption.empty()) animation.caption = fmt::format("Figure '{}' in time.", name);
  animation.caption += legend(all);
  std::error_code failed;
  fs::remove_all(folder / "figures" / name, failed);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!has_it(points[i].result.trajectory)) continue;
    // Rows and points that were interrupted have other numbers: the series has the point's own.
    const std::string series = to_text(*points[i].result.metrics.find("series"));
    const std::string place = fmt::format("figures/{}/{}", name, fs::path(series).stem().string());
    fs::create_directories(folder / place, failed);
    if (failed) throw DataError(fmt::format("{}: cannot be created: {}", (folder / place).string(), failed.message()));
    Animation::Point shown{.title = group_text(record.rows[i], plan.swept_keys(), kTitleDigits)};
    std::vector<MeshFigure> figures;
    std::vector<fs::path> files;
    for (Trajectory::Frame& frame : points[i].result.trajectory.frames) {
      shown.times.push_back(frame.time);
      shown.files.push_back(fmt::format("{}/frame-{:04}.png", place, files.size()));
      files.push_back(folder / shown.files.back());
      figures.push_back(std::move(frame.figure));
      figures.back().title.clear();  // of changing length, it would move the picture
      figures.back().scale = scale;
    }
    draw_frames(figures, files, plan.camera);
    animation.points.push_back(std::move(shown));
  }
  record.animations.push_back(std::move(animation));
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

// What grows from rest begins with rounding errors, which a logarithmic axis would be about.
bool begins_with_rounding(const std::vector<Curve>& curves) {
  constexpr double kRounding = 1e-10;
  for (const Curve& curve : curves) {
    const auto [low, high] = std::minmax_element(curve.y.begin(), curve.y.end());
    if (low != curve.y.end() && *low < kRounding * *high) return true;
  }
  return false;
}

// File names have no other characters.
std::string as_file_name(std::string text) {
  for (char& c : text) {
    if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '-';
  }
  return text;
}

// One plot for each value over time, a curve for each point.
void draw_curves(const Plan& plan, const std::vector<Point>& points, const fs::path& folder, Record& record) {
  std::vector<LinePlot> plots;
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (const Curve& curve : points[i].result.trajectory.curves) {
      auto plot = std::find_if(plots.begin(), plots.end(), [&](const LinePlot& p) { return p.y_label == curve.label; });
      if (plot == plots.end()) {
        plot =
            plots.insert(plots.end(), {.title = curve.label + " over time", .x_label = "time", .y_label = curve.label});
      }
      const std::string group = group_text(record.rows[i], plan.swept_keys(), kTitleDigits);
      plot->curves.push_back({group.empty() ? curve.label : group, curve.x, curve.y});
    }
  }
  for (std::size_t i = 0; i < plots.size(); ++i) {
    const std::vector<Curve>& curves = plots[i].curves;
    plots[i].log_y = is_logarithmic(curves, &Curve::y, false) && !begins_with_rounding(curves);
    add_plot(plots[i], fmt::format("curve-{}-{}", i + 1, as_file_name(plots[i].y_label)), folder, record);
  }
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
    if (!wanted(name)) continue;
    draw_figure(plan, name, points, folder, record);
    draw_animation(plan, name, points, folder, record);
  }
  if (wanted("curves")) draw_curves(plan, points, folder, record);
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
