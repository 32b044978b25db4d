#include "server/film/tile_cache.h"

#include <iterator>

namespace tessera::server {

std::optional<TileSum> TileCache::take(const FrameKey& key, std::int32_t tile) {
  const MutexLock lock(mutex_);
  const auto found = index_.find({key, tile});
  if (found == index_.end()) return std::nullopt;
  Entries taken;
  move_to(taken, found->second);
  return std::move(taken.front().sum);
}

void TileCache::put(const FrameKey& key, std::int32_t tile, TileSum sum) {
  Entries dropped;  // freed without the lock
  const std::int64_t bytes = sum.bytes();
  const MutexLock lock(mutex_);
  const TileKey tile_key(key, tile);
  if (const auto found = index_.find(tile_key); found != index_.end()) {
    move_to(dropped, found->second);
  }
  while (used_bytes_ + bytes > budget_bytes_ && !entries_.empty()) {
    move_to(dropped, std::prev(entries_.end()));
  }
  entries_.push_front({tile_key, std::move(sum)});
  index_[tile_key] = entries_.begin();
  used_bytes_ += bytes;
}

void TileCache::drop(const FrameKey& key) {
  Entries dropped;
  const MutexLock lock(mutex_);
  for (auto it = index_.lower_bound({key, 0}); it != index_.end() && it->first.first == key;) {
    const auto entry = it->second;
    ++it;
    move_to(dropped, entry);
  }
}

std::int64_t TileCache::used_bytes() const {
  const MutexLock lock(mutex_);
  return used_bytes_;
}

void TileCache::move_to(Entries& to, Entries::iterator entry) {
  used_bytes_ -= entry->sum.bytes();
  index_.erase(entry->key);
  to.splice(to.begin(), entries_, entry);
}

}  // namespace tessera::server
