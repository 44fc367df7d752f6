// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

namespace variform {

/// Keeps a second run out of a folder as long as it lives, by an advisory lock on the file `.lock` in it, which ends
/// with the process, however that ends. The folder is there.
class FolderLock {
 public:
  /// Throws UsageError naming the process that holds the lock, DataError when the file cannot be made.
  explicit FolderLock(const std::filesystem::path& folder);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int descriptor_;
};

/// Removes what writers that were killed left in a folder: files that write_file had not finished.
void remove_unfinished_files(const std::filesystem::path& folder);

}  // namespace variform
