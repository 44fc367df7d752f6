// SPDX-License-Identifier: BSD-3-Clause
#include "experiments/pipelines.h"

// One line per pipeline; experiments/<chapter>/<name>.cpp defines PipelineEntry describe_<name>().
#define VARIFORM_PIPELINES(X) \
  X(deform)                   \
  X(parametrize)              \
  X(vector_field)             \
  X(continuous_deformation)   \
  X(modes)                    \
  X(field_energy)

namespace variform {

#define VARIFORM_DECLARE(name) PipelineEntry describe_##name();
VARIFORM_PIPELINES(VARIFORM_DECLARE)
#undef VARIFORM_DECLARE

const Registry<PipelineEntry>& pipelines() {
#define VARIFORM_CALL(name) describe_##name(),
  static const Registry<PipelineEntry> registry("pipeline", {VARIFORM_PIPELINES(VARIFORM_CALL)});
#undef VARIFORM_CALL
  return registry;
}

}  // namespace variform
