#pragma once

#include <functional>
#include <memory>
#include <string>

#include "tests/support/disk/disk_model.h"

namespace tessera::testing {

/// Called before each operation; returning false makes a sync or a write fail.
using DiskReport = std::function<bool(DiskEvent)>;

/// An SQLite VFS over the default one that reports operations on the disk, with full paths.
///
/// Syncs are reported but not executed. SQLite's Unix VFS syncs the folder of a journal or log with
/// the first sync of the file after each opening; that is reported too.
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
