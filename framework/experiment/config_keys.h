// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace variform {

/// A key of a config with what it means, in one line.
struct ConfigKey {
  std::string name;
  std::string doc;
};

/// A section of a config that is not of one pipeline: what reading accepts and `variform list` prints.
struct ConfigSection {
  std::string header;  ///< as it stands in a config, for example "[[claim]]"
  std::string doc;
  std::vector<ConfigKey> keys;

  std::vector<std::string> names() const;
};

/// All of them.
const std::vector<ConfigSection>& config_sections();

/// The one with this header, which is there.
const ConfigSection& config_section(const std::string& header);

}  // namespace variform
