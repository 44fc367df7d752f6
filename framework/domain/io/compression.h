// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <limits>
#include <string>
#include <string_view>

namespace variform::io {

enum class Compression { gzip, zlib };

/// Unpacks all of data (gzip: any number of members one after the other) and appends it to out, whose size grows to at
/// most max_size. False when the data is damaged, truncated or too large when unpacked.
bool decompress(std::string_view data, Compression compression, std::string& out,
                std::size_t max_size = std::numeric_limits<std::size_t>::max());

}  // namespace variform::io
