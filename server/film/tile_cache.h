#pragma once

#include <cstdint>
#include <list>
#include <map>
#include <mutex>
#include <optional>
#include <utility>

#include "server/film/frame_key.h"
#include "server/film/merge.h"

namespace tessera::server {

/// Sums of tiles within a budget of memory: the least recently used ones are dropped. A thread that
/// works on a tile takes it out, and its memory does not count until it is put back. Thread-safe.
class TileCache {
 public:
  explicit TileCache(std::int64_t budget_bytes) : budget_bytes_(budget_bytes) {}

  /// Takes a tile out. Returns nullopt if it is not in the cache.
  std::optional<TileSum> take(const FrameKey& key, std::int32_t tile);
  /// Adds a tile as the most recently used one. It is kept whatever the budget.
  void put(const FrameKey& key, std::int32_t tile, TileSum sum);
  /// Drops all tiles of a frame.
  void drop(const FrameKey& key);
  /// Memory of the tiles in the cache.
  std::int64_t used_bytes() const;

 private:
  using TileKey = std::pair<FrameKey, std::int32_t>;
  struct Entry {
    TileKey key;
    TileSum sum;
  };
  using Entries = std::list<Entry>;  // most recently used first

  void move_to(Entries& to, Entries::iterator entry);

  const std::int64_t budget_bytes_;
  mutable std::mutex mutex_;
  std::int64_t used_bytes_ = 0;
  Entries entries_;
  std::map<TileKey, Entries::iterator> index_;
};

}  // namespace tessera::server
