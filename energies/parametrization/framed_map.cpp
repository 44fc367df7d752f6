// SPDX-License-Identifier: BSD-3-Clause
#include "energies/parametrization/framed_map.h"

namespace variform {

std::vector<Parameter> MapGauge::parameters() {
  return {{.name = "gauge",
           .value = std::string("world"),
           .doc = "where residuals of neighbours are compared; raw depends on the frames (errata C8)",
           .choices = {"world", "transport", "raw"}},
          {.name = "frames",
           .value = std::string("minimal_rotation"),
           .doc = "tangent frames; no effect but for gauge = \"raw\"",
           .choices = {"minimal_rotation", "edge_aligned", "random"}},
          {.name = "seed", .value = std::int64_t{1}, .doc = "of random frames", .min = 0.0}};
}

MapGauge::MapGauge(const Parameters& p)
    : lifted(p.string("gauge") == "world"),
      gauge(p.string("gauge") == "transport" ? Gauge::cell_frame : Gauge::world),
      choice(p.string("frames") == "random"         ? FrameChoice::random
             : p.string("frames") == "edge_aligned" ? FrameChoice::edge_aligned
                                                    : FrameChoice::minimal_rotation),
      seed(static_cast<std::uint64_t>(p.integer("seed"))) {}

}  // namespace variform
