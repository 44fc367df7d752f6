// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/folder_lock.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <regex>
#include <string>
#include <system_error>
#include <vector>

#include "framework/base/error.h"

namespace variform {

namespace fs = std::filesystem;

FolderLock::FolderLock(const fs::path& folder) {
  const fs::path file = folder / ".lock";
  descriptor_ = open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (descriptor_ < 0) throw DataError(fmt::format("{}: cannot be made: {}", file.string(), std::strerror(errno)));
  if (flock(descriptor_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
    std::array<char, 32> text{};
    const ssize_t count = pread(descriptor_, text.data(), text.size() - 1, 0);
    close(descriptor_);
    const std::string holder = count > 0 ? fmt::format(" (process {})", text.data()) : std::string();
    throw UsageError(fmt::format("{}: another run{} is writing to this folder", folder.string(), holder));
  }
  // On file systems without locks there is none to be kept. The number is for messages alone.
  const std::string holder = fmt::format("{}", getpid());
  if (ftruncate(descriptor_, 0) != 0 || pwrite(descriptor_, holder.data(), holder.size(), 0) < 0) return;
}

FolderLock::~FolderLock() { close(descriptor_); }

void remove_unfinished_files(const fs::path& folder) {
  static const std::regex unfinished(R"(.*\.[0-9a-f]{8}\.tmp)");
  std::error_code ignored;
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder, ignored)) {
    if (std::regex_match(entry.path().filename().string(), unfinished)) files.push_back(entry.path());
  }
  for (const fs::path& file : files) fs::remove(file, ignored);
}

}  // namespace variform
