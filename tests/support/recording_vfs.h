#pragma once

#include <functional>
#include <memory>
#include <string>

#include "tests/support/disk_model.h"

namespace tessera::testing {

/// Hears what is about to be done; false makes it fail, if it is a sync or a write.
using DiskReport = std::function<bool(DiskEvent)>;

/// An SQLite VFS over the default one that reports what is done to the disk, as full paths.
///
/// Syncs are reported and not passed on. SQLite's Unix VFS syncs the folder of a journal or log
/// together with the first sync of the file after each opening; that is reported too.
class RecordingVfs {
 public:
  explicit RecordingVfs(DiskReport report);
  ~RecordingVfs();
  RecordingVfs(const RecordingVfs&) = delete;
  RecordingVfs& operator=(const RecordingVfs&) = delete;

  /// Its name within SQLite, unique in the process.
  const std::string& name() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace tessera::testing
