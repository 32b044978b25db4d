#pragma once

#include <string>
#include <vector>

#include "tests/support/disk/disk_model.h"

namespace tessera::server {

/// Returns for each event of a store's disk the place in the program that caused the sync, named by
/// the synced file without ids; empty for other events.
std::vector<std::string> sync_sites(const std::vector<testing::DiskEvent>& events);

}  // namespace tessera::server
