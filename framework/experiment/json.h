// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nlohmann/json.hpp>

#include <string>

#include "framework/experiment/table.h"

namespace variform {

/// NaN and infinities become null, as does an empty value.
nlohmann::ordered_json to_json(const Value& value);

/// A flat object.
nlohmann::ordered_json to_json(const Row& row);

/// Text of a document; bytes that are no UTF-8 are replaced. indent -1: all on one line.
std::string to_text(const nlohmann::ordered_json& json, int indent);

}  // namespace variform
