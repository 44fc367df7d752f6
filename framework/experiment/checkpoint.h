// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "framework/experiment/pipeline.h"

namespace variform {

/// Writes a finished point to a file, with the text of its config as key; complete or not at all.
void save_point(const std::filesystem::path& file, const std::string& config_text, const PointResult& result);

/// Reads it back if the file exists, is whole, and was made from the same config; the result carries no
/// meshes and fields, of frames neither.
std::optional<PointResult> load_point(const std::filesystem::path& file, const std::string& config_text);

}  // namespace variform
