#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <mutex>
#include <set>
#include <string>

namespace tessera::server {

/// The revoked certificates, by serial number: the first word of each line of a file to which
/// `tessera-server revoke` appends. The file is checked at most once per second and read again when
/// it has changed. A missing file revokes nothing; if it becomes unreadable, the last content
/// applies. Thread-safe.
class Revocations {
 public:
  explicit Revocations(std::string path) : path_(std::move(path)) {}
  bool contains(const std::string& serial);

 private:
  void reload_if_changed();

  const std::string path_;
  std::mutex mutex_;  // guards what follows
  std::chrono::steady_clock::time_point last_check_{};
  struct Version {
    ino_t file = 0;
    off_t size = 0;
    std::int64_t modified_s = 0, modified_ns = 0;
    bool operator==(const Version&) const = default;
  };
  Version read_;
  std::set<std::string> serials_;
};

}  // namespace tessera::server
