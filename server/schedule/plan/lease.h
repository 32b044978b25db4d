#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "contract/unit.h"

namespace tessera::server {

/// Identifies a lease across restarts: the store's boot count and a counter.
struct Attempt {
  std::int64_t boot = 0, counter = 0;
  auto operator<=>(const Attempt&) const = default;
};

/// Permission to render tiles [first_tile, first_tile + tile_count) of one pass of one frame.
struct Lease {
  std::string job_id;
  std::int32_t frame = 0, pass = 0, first_tile = 0, tile_count = 0;
  std::int32_t first_sample = 0, sample_count = 0;
  Attempt attempt;
  std::string seal;

  bool covers(const contract::Unit& unit) const {
    return unit.frame == frame && unit.pass == pass && unit.tile >= first_tile &&
           unit.tile - first_tile < tile_count;
  }
};

/// Returns the HMAC-SHA-256, with the store's key, of all fields of the lease and the worker's ID.
/// A valid seal proves that this store granted the lease to this worker, so leases need no journal.
std::string make_seal(const Lease& lease, std::string_view worker_id, std::string_view store_key);

/// Returns whether the lease's seal is valid. Constant time in the seal.
bool is_seal_valid(const Lease& lease, std::string_view worker_id, std::string_view store_key);

}  // namespace tessera::server
