// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/json.h"

#include <cmath>
#include <type_traits>

namespace variform {

using Json = nlohmann::ordered_json;

Json to_json(const Value& value) {
  return std::visit(
      [](const auto& alternative) -> Json {
        using Type = std::decay_t<decltype(alternative)>;
        if constexpr (std::is_same_v<Type, std::monostate>) {
          return nullptr;
        } else if constexpr (std::is_same_v<Type, double>) {
          return std::isfinite(alternative) ? Json(alternative) : Json(nullptr);
        } else {
          return alternative;
        }
      },
      value);
}

Json to_json(const Row& row) {
  Json object = Json::object();
  for (const auto& [key, value] : row.entries()) object[key] = to_json(value);
  return object;
}

std::string to_text(const Json& json, int indent) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

}  // namespace variform
