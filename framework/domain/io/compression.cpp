// SPDX-License-Identifier: BSD-3-Clause
#include "framework/domain/io/compression.h"

#include <zlib.h>

#include <algorithm>
#include <memory>
#include <vector>

namespace variform::io {

bool decompress(std::string_view data, Compression compression, std::string& out, std::size_t max_size) {
  constexpr int kGzipFlag = 16;
  constexpr std::size_t kMaxInput = std::size_t{1} << 30;
  std::vector<char> buffer(std::size_t{1} << 16);

  z_stream stream{};
  if (inflateInit2(&stream, MAX_WBITS + (compression == Compression::gzip ? kGzipFlag : 0)) != Z_OK) return false;
  const std::unique_ptr<z_stream, int (*)(z_stream*)> guard(&stream, &inflateEnd);

  int status = Z_OK;
  while (true) {
    if (stream.avail_in == 0) {
      const std::string_view input = data.substr(0, kMaxInput);
      data.remove_prefix(input.size());
      // zlib does not write to its input; its interface only lacks the const.
      stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(input.data()));
      stream.avail_in = static_cast<uInt>(input.size());
    }
    stream.next_out = reinterpret_cast<Bytef*>(buffer.data());
    stream.avail_out = static_cast<uInt>(buffer.size());
    status = inflate(&stream, Z_NO_FLUSH);
    if (status != Z_OK && status != Z_STREAM_END) return false;  // Z_BUF_ERROR: the input ended too early

    const std::size_t size = buffer.size() - stream.avail_out;
    if (size > max_size - std::min(out.size(), max_size)) return false;
    out.append(buffer.data(), size);

    if (status == Z_STREAM_END) {
      if (stream.avail_in == 0 && data.empty()) return true;
      if (compression != Compression::gzip || inflateReset(&stream) != Z_OK) return false;
    }
  }
}

}  // namespace variform::io
