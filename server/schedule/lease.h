#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "contract/unit.h"

namespace tessera::server {

/// Tells a lease from every other, over restarts: the store's boot count and a counter.
struct Attempt {
  std::int64_t boot = 0, counter = 0;
  auto operator<=>(const Attempt&) const = default;
};

/// The right to render tiles [first_tile, first_tile + tile_count) of one pass of one frame.
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

/// HMAC-SHA-256 under the store's key over every field of the lease and the worker's id. A lease
/// with the right seal was given by this store to this worker, so leases need no journal.
std::string seal_of(const Lease& lease, std::string_view worker_id, std::string_view store_key);

/// Whether the lease carries its seal. Constant time in the seal.
bool seal_holds(const Lease& lease, std::string_view worker_id, std::string_view store_key);

}  // namespace tessera::server
