// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <system_error>

#include "framework/domain/mesh_io.h"
#include "framework/experiment/fingerprint.h"
#include "framework/experiment/pipeline.h"

namespace variform {
namespace {

namespace fs = std::filesystem;

// Two lines say what follows: for which key, how long, and its fingerprint.
std::string header(const std::string& key, std::string_view bytes) {
  return fmt::format("variform unfinished point\n{} {:016x} {} {:016x}\n", key.size(), fingerprint(key), bytes.size(),
                     fingerprint(bytes));
}

fs::path progress_file(fs::path file) { return file.replace_extension(Workspace::kProgress); }

}  // namespace

Workspace::Workspace(fs::path file, std::string key, bool resume)
    : file_(std::move(file)), key_(std::move(key)), resume_(resume) {}

void Workspace::save(const std::string& bytes) const {
  if (!file_.empty()) write_file(file_, header(key_, bytes) + bytes);
}

std::optional<std::string> Workspace::load() const {
  if (file_.empty() || !resume_) return std::nullopt;
  std::ifstream stream(file_, std::ios::binary);
  if (!stream) return std::nullopt;
  std::string content((std::istreambuf_iterator<char>(stream)), std::istreambuf_iterator<char>());
  std::size_t begin = content.find('\n');
  if (begin != std::string::npos) begin = content.find('\n', begin + 1);
  if (begin == std::string::npos) return std::nullopt;
  ++begin;
  if (std::string_view(content).substr(0, begin) != header(key_, std::string_view(content).substr(begin))) {
    return std::nullopt;
  }
  content.erase(0, begin);
  return content;
}

void Workspace::clear() const {
  if (file_.empty()) return;
  std::error_code ignored;
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(file_.parent_path(), ignored)) {
    const std::string name = entry.path().filename().string();
    const bool is_own = entry.path().filename() == file_.filename();
    const bool is_part = name.starts_with(file_.stem().string() + ".") && name.ends_with(file_.extension().string());
    if (is_own || is_part) files.push_back(entry.path());
  }
  if (!is_part_) files.push_back(progress_file(file_));
  for (const fs::path& file : files) fs::remove(file, ignored);
}

void Workspace::progress(double fraction) const {
  if (file_.empty() || is_part_) return;
  write_file(progress_file(file_), fmt::format("{}", std::clamp(fraction, 0.0, 1.0)));
}

double Workspace::progress_of(const fs::path& file) {
  std::ifstream stream(progress_file(file));
  double fraction = 0.0;
  return stream >> fraction ? fraction : 0.0;
}

Workspace Workspace::part(const std::string& key) const {
  if (file_.empty()) return {};
  const std::string name =
      fmt::format("{}.{:016x}{}", file_.stem().string(), fingerprint(key), file_.extension().string());
  Workspace part(file_.parent_path() / name, key_ + "\n# part\n" + key, resume_);
  part.is_part_ = true;
  return part;
}

}  // namespace variform
