// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "framework/experiment/pipeline.h"

namespace variform {

/// All pipelines, by the names that configs use.
const Registry<PipelineEntry>& pipelines();

}  // namespace variform
