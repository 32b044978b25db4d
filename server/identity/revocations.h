#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <set>
#include <string>

#include "absl/base/thread_annotations.h"
#include "server/sync/mutex.h"

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
  void reload_if_changed() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const std::string path_;
  Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  std::chrono::steady_clock::time_point last_check_ ABSL_GUARDED_BY(mutex_){};
  struct Version {
    ino_t file = 0;
    off_t size = 0;
    std::int64_t modified_s = 0, modified_ns = 0;
    bool operator==(const Version&) const = default;
  };
  Version read_ ABSL_GUARDED_BY(mutex_);
  std::set<std::string> serials_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace tessera::server
