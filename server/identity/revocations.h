#pragma once

#include <sys/types.h>

#include <cstdint>
#include <set>
#include <string>

#include "absl/base/thread_annotations.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// The revoked certificates, by serial number: the first word of each line of a file to which
/// `tessera-server revoke` appends. A missing file revokes nothing; if it becomes unreadable, the
/// last content applies.
class Revocations {
 public:
  /// Reads the file.
  explicit Revocations(std::string path);

  /// Any thread; does not read the file.
  bool contains(const std::string& serial) const;
  /// Reads the file again if it has changed. One thread.
  void update();

 private:
  struct Version {
    ino_t file = 0;
    off_t size = 0;
    std::int64_t modified_s = 0, modified_ns = 0;
    bool operator==(const Version&) const = default;
  };

  const std::string path_;
  Version read_;
  mutable Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  std::set<std::string> serials_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace tessera::server
