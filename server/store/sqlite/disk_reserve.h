#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "absl/status/status.h"
#include "server/store/files/ballast.h"
#include "server/store/files/filesystem.h"
#include "server/store/sqlite/journal.h"

namespace tessera::server {

/// Space that is given up when the disk is full: to start, and to write what leads to free space.
class DiskReserve {
 public:
  /// `bytes`: size of the space for writing. That for starting is a quarter of it.
  DiskReserve(Filesystem& filesystem, const std::string& folder, std::int64_t bytes);

  /// Takes the space if there is plenty.
  void set_up();
  /// Frees space to start; returns whether there was any.
  bool give_up_to_start();

  /// Runs Journal::write_together(). If it includes a write_at_any_cost() and the disk is full, it
  /// runs once more, without the space.
  absl::Status write_together(Journal& journal, const std::function<void()>& body);
  /// Runs Journal::write(); on a full disk once more without the space, with others of the same
  /// write_together().
  absl::Status write_at_any_cost(Journal& journal,
                                 const std::function<absl::Status(Database&)>& body);

 private:
  Ballast ballast_;           // for removing jobs
  Ballast start_ballast_;     // for starting: results fill what that leaves before a job is removed
  bool at_any_cost_ = false;  // write_together() includes a write_at_any_cost()
};

}  // namespace tessera::server
