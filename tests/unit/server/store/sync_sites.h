#pragma once

#include <string>
#include <vector>

#include "tests/support/disk_model.h"

namespace tessera::server {

/// For each event of a store's disk the place in the program that the sync comes from, named by
/// what it syncs with ids left out; empty for events that are no sync.
std::vector<std::string> sync_sites(const std::vector<testing::DiskEvent>& events);

}  // namespace tessera::server
