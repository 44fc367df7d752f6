// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <vector>

#include "framework/experiment/plan.h"
#include "framework/experiment/points.h"
#include "framework/experiment/record.h"

namespace variform {

/// Draws the figures, histories, searches and plots of a run into folder/figures and tells the record of them; what
/// cannot be drawn becomes a warning. points: those of the record's rows, in their order; their figures are moved away.
void draw_figures(const Plan& plan, std::vector<Point>& points, const std::filesystem::path& folder, Record& record);

/// Draws a plot as folder/figures/name and tells the record of it.
void add_plot(const LinePlot& plot, const std::string& name, const std::filesystem::path& folder, Record& record);

}  // namespace variform
