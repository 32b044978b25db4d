#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "contract/unit.h"
#include "server/store/store.h"

namespace tessera::server {

/// Location and cost of the committed blocks of a job's open frames: enough to read them back and
/// to recognise duplicates. 64 bytes per unit, released with the frame.
class BlockIndex {
 public:
  static constexpr std::int64_t kNotCommitted = -2;  // in place of a segment
  struct BlockLocation {
    contract::Digest sha256;
    std::int64_t segment = kNotCommitted, offset = 0;
    std::int32_t size_bytes = 0, stored_bytes = 0;
    std::int32_t worker = 0;  // index into workers_
  };
  /// Progress of a pass of a frame.
  struct PassProgress {
    std::int32_t committed = 0;
    double cpu_seconds = 0;
    double wall_seconds = 0;  // the job's running time when the latest unit was committed
  };

  BlockIndex(std::int32_t tile_count, std::int32_t pass_count)
      : tile_count_(tile_count), pass_count_(pass_count) {}

  /// Adds a committed unit. Requires tile and pass in range.
  void add(const UnitRecord& record, double wall_seconds);
  /// Removes a unit that was dropped from the store. Harmless for a unit that is not in the index.
  void remove(const contract::Unit& unit);
  /// Returns nullptr if the unit is not in the index.
  const BlockLocation* find(const contract::Unit& unit) const;
  /// Returns the record that UnitStore::read_block needs; nullopt if the unit is not in the index.
  std::optional<UnitRecord> record(const contract::Unit& unit) const;
  /// Returns the progress by pass; empty if nothing of the frame is committed.
  std::vector<PassProgress> progress(std::int32_t frame) const;
  /// Returns the worker that delivered the block at `location`.
  const std::string& worker(const BlockLocation& location) const {
    return workers_[static_cast<std::size_t>(location.worker)];
  }
  /// Returns all committed units of the frame, by pass, then tile.
  std::vector<contract::Unit> units(std::int32_t frame) const;
  bool has(std::int32_t frame) const { return frames_.count(frame) > 0; }
  void erase(std::int32_t frame) { frames_.erase(frame); }

 private:
  struct Frame {
    std::vector<std::vector<BlockLocation>> locations;  // [pass][tile]; empty: no unit of the pass
    std::vector<PassProgress> progress;
  };

  std::int32_t tile_count_, pass_count_;
  std::map<std::int32_t, Frame> frames_;
  std::vector<std::string> workers_;  // IDs
  std::map<std::string, std::int32_t> worker_index_;
};

}  // namespace tessera::server
