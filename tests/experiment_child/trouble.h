// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "framework/experiment/pipeline.h"

namespace variform {

/// One pipeline, `trouble`: E = x^2 for model.x, on a mesh of one triangle; instead of that it may, by model.what,
/// "throw", "abort", "hang", "hog", "bad_alloc" or "vanish" (end without a result). "flow": E = steps x for
/// model.steps, and a trajectory of steps + 1 triangles of side 1 + x t, t = 0, 0.1, ...; each step is saved to the
/// workspace, and the metric `drawn` is the step that the run started from. A flow that starts from 0 ends before a
/// step as kill_at, hang_at, fail_at, no_memory_at or odd_at say.
const Registry<PipelineEntry>& trouble_pipelines();

/// Takes memory until it is stopped, or the given MiB are taken, and keeps it for some seconds.
void take_memory(int mib, double seconds = 0.0);

}  // namespace variform
