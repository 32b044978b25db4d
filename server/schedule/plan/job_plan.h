#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <tuple>
#include <vector>

#include "contract/pass_schedule.h"
#include "contract/unit.h"
#include "server/schedule/plan/job_spec.h"
#include "server/schedule/plan/lease.h"

namespace tessera::server {

/// Number of a worker that is connected or was recently.
using WorkerKey = std::int64_t;

/// A worker's lease on a unit in flight.
struct Holder {
  WorkerKey worker = 0;
  Attempt attempt;
  std::optional<Time> started;      // when a heartbeat first named it
  bool revoking = false;            // revocation sent
  double expected_seconds = 0;      // CPU time charged to fair share
  std::optional<Time> leased = {};  // absent: an audit, or adopted from another process of the
                                    // server
  Time charged = {};                // when expected_seconds was charged
};

/// A unit that is leased to at least one worker.
struct InFlight {
  std::vector<Holder> holders;  // more than one: a speculative copy or an adopted lease
  bool copied = false;          // a speculative copy was made; there is at most one
};

/// Tiles [first_tile, first_tile + tile_count) of one pass of one frame.
struct Run {
  std::int32_t frame = 0, pass = 0, first_tile = 0, tile_count = 0;
};

/// Frames, tiles and passes of a job.
struct PlanShape {
  std::vector<std::int32_t> frames;  // sorted, without duplicates
  std::int32_t tile_count = 0;
  std::vector<contract::Pass> passes;
  bool is_adaptive = false;

  std::int32_t frame_count() const { return static_cast<std::int32_t>(frames.size()); }
  /// Number of passes planned for every tile from the start.
  std::int32_t first_passes() const;
};

/// How many units of a job there are.
struct UnitCounts {
  std::int64_t planned = 0;  // so far
  std::int64_t committed = 0;
  std::int64_t in_flight = 0;
  std::int64_t waiting = 0;  // neither committed nor in flight nor of a frame that is held back
};

/// Tracks which units of a job are waiting, in flight or committed.
///
/// Units are leased frame by frame, within a frame pass by pass, and within a pass along the curve,
/// so that all of pass 0 is leased before pass 1. Returned units go first. In an adaptive plan only
/// passes 0 and 1 are planned from the start; set_pass_target() adds others. Memory grows with the
/// units in flight and by one bit per unit of open frames; frames not started are a cursor,
/// finished frames one bit. Pure; the caller serialises calls.
class JobPlan {
 public:
  /// Requires sorted frames without duplicates, tile_count >= 1, at least one pass.
  JobPlan(std::vector<std::int32_t> frames, std::int32_t tile_count,
          std::vector<contract::Pass> passes, bool is_adaptive = false);

  const PlanShape& shape() const { return shape_; }
  UnitCounts counts() const {
    const auto in_flight_count = static_cast<std::int64_t>(in_flight_.size());
    return {unit_count_, committed_count_, in_flight_count,
            unit_count_ - committed_count_ - in_flight_count - held_back_count_};
  }
  std::int32_t finished_frame_count() const { return finished_count_; }
  const std::map<contract::Unit, InFlight>& in_flight() const { return in_flight_; }
  InFlight* find_in_flight(const contract::Unit& unit);

  /// Returns whether the unit exists in this job.
  bool contains(const contract::Unit& unit) const;
  bool is_finished(std::int32_t frame) const;
  /// Returns whether the unit is committed; true for all units of a finished frame.
  bool is_committed(const contract::Unit& unit) const;
  /// Returns whether all units of the frame are committed and, in an adaptive plan, all targets are
  /// final.
  bool is_complete(std::int32_t frame) const;
  /// Adaptive plans: plans `pass_count` passes for the tile; with `is_final` never more.
  /// Idempotent. Requires a tile of an unfinished frame.
  void set_pass_target(std::int32_t frame, std::int32_t tile, std::int32_t pass_count,
                       bool is_final);

  /// Keeps the units of a frame from being leased, or lets them be leased again. Units in flight
  /// still commit. Requires a frame of the job.
  void hold_back(std::int32_t frame, bool is_held_back);
  bool is_held_back(std::int32_t frame) const { return held_back_.count(frame) > 0; }

  /// Returns the next run of at most `max_tiles` waiting units that `may_take` accepts, nullopt if
  /// there is none. Does not change the plan: call hold() for each unit.
  std::optional<Run> next_run(std::int32_t max_tiles,
                              const std::function<bool(const contract::Unit&)>& may_take);
  /// Adds a holder. Requires a contained unit that is not committed. Its pass counts as planned,
  /// since it was leased once.
  void hold(const contract::Unit& unit, const Holder& holder);
  /// Removes a worker's hold; the unit waits again if nobody else holds it. Returns the hold,
  /// nullopt if there was none.
  std::optional<Holder> release(const contract::Unit& unit, WorkerKey worker);

  /// Marks the unit committed and returns its holders. Requires a contained unit that is not
  /// committed.
  std::vector<Holder> commit(const contract::Unit& unit);
  /// Makes a committed unit of an unfinished frame wait again because its block is damaged or
  /// dropped.
  void redo(const contract::Unit& unit);
  /// Adaptive plans: withdraws a frame's pass targets beyond the initial passes because they came
  /// from invalid results; the caller drops the blocks. Returns the removed units' holders.
  std::vector<std::pair<contract::Unit, Holder>> reset_pass_targets(std::int32_t frame);
  /// Marks a frame finished and releases its state. `unit_count`: the number of its units, if this
  /// plan has not seen them.
  void finish(std::int32_t frame, std::optional<std::int64_t> unit_count = std::nullopt);

  /// Changes the schedule, also between fixed and adaptive. Passes in both schedules stay
  /// committed; other bits, finished frames and pass targets are forgotten: commit() and
  /// set_pass_target() them again. Returns the removed units' holders.
  std::vector<std::pair<contract::Unit, Holder>> extend(std::vector<contract::Pass> passes,
                                                        bool is_adaptive);

 private:
  using Position = std::tuple<std::int32_t, std::int32_t, std::int32_t>;  // frame, pass, tile
  // State of a frame with committed units.
  struct FrameBits {
    std::vector<std::vector<bool>> committed;  // [pass][tile]; empty: no unit of the pass
    std::int64_t count = 0;
    // Adaptive plans; empty until a target exceeds the initial passes.
    std::vector<std::int32_t> wanted;  // target, by tile
    std::vector<bool> is_final;        // by tile
    std::int64_t wanted_count = 0;     // units
    std::int32_t final_count = 0;      // tiles
  };

  static Position position(const contract::Unit& unit) {
    return {unit.frame, unit.pass, unit.tile};
  }
  std::size_t index_of(std::int32_t frame) const;
  std::int64_t waiting_of(std::int32_t frame) const;
  void recount(std::int32_t frame);
  bool is_taken(const contract::Unit& unit) const;
  bool is_waiting(const contract::Unit& unit) const;
  FrameBits& open_frame(std::int32_t frame);
  void include_in_targets(const contract::Unit& unit);
  void plan_known_passes();
  contract::Unit at_cursor() const;
  bool cursor_at_end() const { return cursor_frame_ == shape_.frames.size(); }
  void skip_taken();
  void advance_cursor();
  Run extend_run(const contract::Unit& first, std::int32_t max_tiles,
                 const std::function<bool(const contract::Unit&)>& may_take) const;

  PlanShape shape_;
  std::int64_t unit_count_;
  std::vector<bool> finished_;  // by index of the frame
  std::int32_t finished_count_ = 0;
  std::map<std::int32_t, FrameBits> open_;  // frames with committed units, by number
  std::map<contract::Unit, InFlight> in_flight_;
  std::set<Position> returned_;  // waiting units behind the cursor or beyond the initial passes
  std::size_t cursor_frame_ = 0;
  std::int32_t cursor_pass_ = 0, cursor_tile_ = 0;  // everything before the cursor has been visited
  std::int64_t committed_count_ = 0;
  std::map<std::int32_t, std::int64_t> held_back_;  // frames, and their units that would wait
  std::int64_t held_back_count_ = 0;                // the sum
};

}  // namespace tessera::server
