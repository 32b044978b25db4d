#pragma once

#include <cstdint>
#include <list>
#include <map>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "server/film/frame_key.h"
#include "server/film/merge.h"
#include "server/sync/mutex.h"

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

  void move_to(Entries& to, Entries::iterator entry) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const std::int64_t budget_bytes_;
  mutable Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  std::int64_t used_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  Entries entries_ ABSL_GUARDED_BY(mutex_);
  std::map<TileKey, Entries::iterator> index_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace tessera::server
