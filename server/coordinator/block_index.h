#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "contract/unit.h"
#include "server/store/store.h"

namespace tessera::server {

/// Where the committed blocks of a job's open frames lie, and what they cost: enough to read them
/// back and to tell whether a repeated block is the same. 64 bytes a unit, freed with its frame.
class BlockIndex {
 public:
  struct BlockLocation {
    contract::Digest sha256;
    std::int64_t segment = -1, offset = 0;  // segment -1: not committed
    std::int32_t size_bytes = 0, stored_bytes = 0;
    std::int32_t worker = 0;  // index into workers_
  };
  /// Progress of one pass of a frame.
  struct PassProgress {
    std::int32_t committed = 0;
    double cpu_seconds = 0;
    double wall_seconds = 0;  // of the job, when its last unit was committed so far
  };

  BlockIndex(std::int32_t tile_count, std::int32_t pass_count)
      : tile_count_(tile_count), pass_count_(pass_count) {}

  /// Notes a committed unit. Requires tile and pass in range.
  void add(const UnitRecord& record, double wall_seconds);
  /// Forgets a unit that was dropped from the store. Harmless if it is not here.
  void remove(const contract::Unit& unit);
  /// nullptr if the unit is not here.
  const BlockLocation* find(const contract::Unit& unit) const;
  /// What Store::read_block needs of a committed unit; nullopt if it is not here.
  std::optional<UnitRecord> record(const contract::Unit& unit) const;
  /// By pass; empty if nothing of the frame is committed.
  std::vector<PassProgress> progress(std::int32_t frame) const;
  /// Who delivered a unit that is here.
  const std::string& worker(const BlockLocation& location) const {
    return workers_[static_cast<std::size_t>(location.worker)];
  }
  /// Every committed unit of the frame, by pass, then tile.
  std::vector<contract::Unit> units(std::int32_t frame) const;
  bool has(std::int32_t frame) const { return frames_.count(frame) > 0; }
  void erase(std::int32_t frame) { frames_.erase(frame); }

 private:
  struct Frame {
    std::vector<std::vector<BlockLocation>>
        locations;  // [pass][tile]; a pass is empty until its first
    std::vector<PassProgress> progress;
  };

  std::int32_t tile_count_, pass_count_;
  std::map<std::int32_t, Frame> frames_;
  std::vector<std::string> workers_;  // ids
  std::map<std::string, std::int32_t> worker_index_;
};

}  // namespace tessera::server
