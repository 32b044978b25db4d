#include "server/state/block_index.h"

#include <algorithm>

namespace tessera::server {

void BlockIndex::add(const UnitRecord& record, double wall_seconds) {
  Frame& frame = frames_[record.unit.frame];
  frame.locations.resize(static_cast<std::size_t>(pass_count_));
  frame.progress.resize(static_cast<std::size_t>(pass_count_));
  const auto pass = static_cast<std::size_t>(record.unit.pass);
  auto& locations = frame.locations[pass];
  if (locations.empty()) locations.resize(static_cast<std::size_t>(tile_count_));
  const auto [worker, is_new] =
      worker_index_.try_emplace(record.worker_id, static_cast<std::int32_t>(workers_.size()));
  if (is_new) workers_.push_back(record.worker_id);
  locations[static_cast<std::size_t>(record.unit.tile)] = {
      record.sha256,
      record.segment,
      record.offset,
      static_cast<std::int32_t>(record.size_bytes),
      static_cast<std::int32_t>(record.stored_bytes),
      worker->second};
  PassProgress& progress = frame.progress[pass];
  ++progress.committed;
  progress.cpu_seconds += record.cpu_seconds;
  progress.wall_seconds = std::max(progress.wall_seconds, wall_seconds);
}

void BlockIndex::remove(const contract::Unit& unit) {
  if (find(unit) == nullptr) return;
  Frame& frame = frames_.at(unit.frame);
  const auto pass = static_cast<std::size_t>(unit.pass);
  frame.locations[pass][static_cast<std::size_t>(unit.tile)].segment = kNotCommitted;
  --frame.progress[pass].committed;
}

const BlockIndex::BlockLocation* BlockIndex::find(const contract::Unit& unit) const {
  const auto frame = frames_.find(unit.frame);
  if (frame == frames_.end()) return nullptr;
  const auto& locations = frame->second.locations[static_cast<std::size_t>(unit.pass)];
  if (locations.empty()) return nullptr;
  const BlockLocation& location = locations[static_cast<std::size_t>(unit.tile)];
  return location.segment == kNotCommitted ? nullptr : &location;
}

std::optional<UnitRecord> BlockIndex::record(const contract::Unit& unit) const {
  const BlockLocation* location = find(unit);
  if (location == nullptr) return std::nullopt;
  UnitRecord record;
  record.unit = unit;
  record.sha256 = location->sha256;
  record.segment = location->segment;
  record.offset = location->offset;
  record.size_bytes = location->size_bytes;
  record.stored_bytes = location->stored_bytes;
  return record;
}

std::vector<BlockIndex::PassProgress> BlockIndex::progress(std::int32_t frame) const {
  const auto found = frames_.find(frame);
  return found == frames_.end() ? std::vector<PassProgress>() : found->second.progress;
}

std::vector<contract::Unit> BlockIndex::units(std::int32_t frame) const {
  std::vector<contract::Unit> units;
  const auto found = frames_.find(frame);
  if (found == frames_.end()) return units;
  for (std::int32_t pass = 0; pass < pass_count_; ++pass) {
    const auto& locations = found->second.locations[static_cast<std::size_t>(pass)];
    for (std::size_t tile = 0; tile < locations.size(); ++tile) {
      if (locations[tile].segment == kNotCommitted) continue;
      units.push_back({frame, static_cast<std::int32_t>(tile), pass});
    }
  }
  return units;
}

}  // namespace tessera::server
