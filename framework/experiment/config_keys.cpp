// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/config_keys.h"

#include <fmt/format.h>

#include <algorithm>

#include "framework/base/error.h"

namespace variform {

std::vector<std::string> ConfigSection::names() const {
  std::vector<std::string> names;
  for (const ConfigKey& key : keys) names.push_back(key.name);
  return names;
}

const std::vector<ConfigSection>& config_sections() {
  static const std::vector<ConfigSection> sections = {
      {"[[constraint]]",
       "what is held and where",
       {{"kind", "hard, soft, identify or linear"},
        {"vertices", "numbers of vertices"},
        {"select", "vertices by place: a table, see below"},
        {"positions", "where they go, one point for each; without it and move: at rest"},
        {"move", "a vector that is added, or a table, see below"},
        {"velocity", "the same for velocities; a rotation is in degrees per unit of time"},
        {"relative", "true: coordinates in units of the bounding box"},
        {"weight", "soft: default 1e3 times the mean diagonal entry of the matrix"},
        {"weights", "linear: one for each vertex"},
        {"value", "linear: what the weighted sum is"}}},
      {"[[constraint]] select",
       "exactly one of",
       {{"box", "all inside, borders included: two corners"},
        {"near", "the vertex nearest to a point"},
        {"points", "the vertex nearest to each point"},
        {"circle", "all inside: centre and radius"},
        {"boundary", "true: all of the boundary"}}},
      {"[[constraint]] move, velocity",
       "a similarity",
       {{"translate", "vector"},
        {"rotate", "degrees"},
        {"axis", "of rotations in space"},
        {"about", "fixed point; default: the mean of the vertices"},
        {"scale", "factor of a move, rate of a velocity"}}},
      {"[sweep]",
       "one run per point; any other key is a key of a section of the pipeline, with a list of values or a range",
       {{"kind", "grid (default), zip, random or latin_hypercube"},
        {"samples", "random and latin_hypercube: number of points"},
        {"seed", "of all random numbers of the sweep; default 0"},
        {"seed_key", "key or list of keys that get a seed of their own in every point"}}},
      {"[sweep] range",
       "values of a key for random and latin_hypercube; a list of values is a choice between them",
       {{"min", "smallest value"},
        {"max", "largest value"},
        {"scale", "linear (default) or log"},
        {"integer", "true: integers only, both ends included"}}},
      {"[backends]",
       "a comparison: every point is solved by every variant, see `variform compare`",
       {{"repeats", "timed runs of each; default 5"},
        {"warm_up", "runs before that are not counted; default 1"},
        {"accuracy", "solved: energy at most this share above the lowest one found; default 1e-6"},
        {"reference", "variant whose solution the others are compared with; default: the one of the lowest energy"},
        {"variant", "an array of tables, see below"}}},
      {"[[backends.variant]]",
       "backends with options, in place of those in [solver]",
       {{"name", "in tables and plots; default: the backends' names"},
        {"linear", "linear backend"},
        {"linear_options", "its parameters"},
        {"nonlinear", "nonlinear backend"},
        {"nonlinear_options", "its parameters"}}},
      {"[bisect]",
       "smallest value of a key at which a condition on metrics holds",
       {{"key", "key of a section of the pipeline"},
        {"low", "smallest value"},
        {"high", "largest value"},
        {"tolerance", "width of the bracket; default 1e-3"},
        {"until", "condition"}}},
      {"[compare]",
       "differences between results at the same probe points",
       {{"reference", "condition on swept keys: the row that others of the group are compared with"}}},
      {"[[claim]]",
       "a statement that the rows decide",
       {{"text", "the statement"},
        {"published", "the source's number or words"},
        {"where", "condition: which rows"},
        {"metric", "metric"},
        {"is", "comparison with a number, in [LOW, HIGH], nonincreasing, nondecreasing, increasing or decreasing"},
        {"quantifier", "all (default) or any of the rows"},
        {"relative_to", "condition: divide by the metric of this row, other swept keys equal"},
        {"minus", "condition: subtract it instead"},
        {"along", "key that orders the rows, for the four monotone relations"},
        {"tolerance", "relative slack of monotone relations; default 1e-9"}}},
      {"[[plot]]",
       "a curve for each value of the series",
       {{"name", "of the file"},
        {"title", "above the plot"},
        {"x", "key of the abscissa"},
        {"y", "metric of the ordinate"},
        {"series", "key or list of keys"},
        {"where", "condition: which rows"},
        {"log_x", "true: logarithmic axis"},
        {"log_y", "true: logarithmic axis"}}},
      {"[output]",
       "what the report shows",
       {{"columns", "keys of the printed, Markdown and LaTeX tables"},
        {"figures", "names of figures of the pipeline, and history, curves"},
        {"rates", "table metric = size key: experimental orders of convergence"},
        {"pivot", "list of tables, see [[output.pivot]]"},
        {"max_panels", "of a figure; default 24"},
        {"max_frames", "of a point's animation in the report; default 60, fewer of many points"},
        {"panel_columns", "of a figure; 0: chosen"},
        {"colour", "logarithmic (default) or linear"},
        {"camera", "see [output.camera]"}}},
      {"[[output.pivot]]",
       "a table of one metric over two sets of keys",
       {{"rows", "key or list of keys"},
        {"columns", "key or list of keys"},
        {"value", "metric"},
        {"aggregate", "mean, median, min, max or count of the rows of a cell; default: the one row"}}},
      {"[output.camera]",
       "of figures in space",
       {{"direction", "from the object to the eye"},
        {"up", "direction"},
        {"zoom", "above 1 the rim is cut off"},
        {"projection", "orthographic (default) or perspective"}}}};
  return sections;
}

const ConfigSection& config_section(const std::string& header) {
  const auto& sections = config_sections();
  const auto found = std::find_if(sections.begin(), sections.end(),
                                  [&header](const ConfigSection& section) { return section.header == header; });
  if (found == sections.end()) throw UsageError(fmt::format("there is no config section {}", header));
  return *found;
}

}  // namespace variform
