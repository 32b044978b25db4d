#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>

namespace tessera {

/// A private folder of mode 0700, deleted afterwards. In memory where possible: no test here
/// depends on a real disk, and a busy one would cost time.
class ScratchFolder {
 public:
  ScratchFolder() : path_("/dev/shm/tessera-XXXXXX") {
    if (::mkdtemp(path_.data()) != nullptr) return;
    path_ = ::testing::TempDir() + "tessera-XXXXXX";
    if (::mkdtemp(path_.data()) == nullptr) std::abort();
  }
  ~ScratchFolder() { std::filesystem::remove_all(path_); }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

}  // namespace tessera
