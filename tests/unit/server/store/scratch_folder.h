#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>

namespace tessera::server {

/// A folder that is gone afterwards. In memory where there is such a place: here the model decides
/// what is durable, and a busy disk would only cost time.
class ScratchFolder {
 public:
  ScratchFolder() : path_("/dev/shm/store-XXXXXX") {
    if (::mkdtemp(path_.data()) != nullptr) return;
    path_ = ::testing::TempDir() + "store-XXXXXX";
    if (::mkdtemp(path_.data()) == nullptr) std::abort();
  }
  ~ScratchFolder() { std::filesystem::remove_all(path_); }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

}  // namespace tessera::server
