// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "framework/experiment/pipeline.h"

namespace variform {

/// One pipeline, `trouble`: E = x^2 for model.x, on a mesh of one triangle; instead of that it may, by model.what,
/// "throw", "abort", "hang", "hog", "bad_alloc" or "vanish" (end without a result).
const Registry<PipelineEntry>& trouble_pipelines();

/// Takes memory until it is stopped, or the given MiB are taken, and keeps it for some seconds.
void take_memory(int mib, double seconds = 0.0);

}  // namespace variform
