#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "server/store/files/filesystem.h"

namespace tessera::server {

/// A file without content that occupies disk space, given up when the disk is full so that rows can
/// still be written: to start, and to remove jobs.
class Ballast {
 public:
  Ballast(Filesystem& filesystem, std::string path, std::int64_t bytes)
      : filesystem_(filesystem), path_(std::move(path)), bytes_(bytes) {}

  /// Takes the space if there is plenty. Without it the store works, but a full disk may have to be
  /// cleared by hand.
  void set_up() {
    if (filesystem_.size_of(path_).value_or(0) == bytes_) return;
    if (!filesystem_.reserve(path_, bytes_).ok()) give_up();
  }
  /// Frees the space; returns whether there was any.
  bool give_up() {
    const bool is_there = filesystem_.size_of(path_).value_or(0) > 0;
    return filesystem_.remove(path_).ok() && is_there;
  }

 private:
  Filesystem& filesystem_;
  const std::string path_;
  const std::int64_t bytes_;
};

}  // namespace tessera::server
