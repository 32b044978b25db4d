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
#include "server/schedule/job_spec.h"
#include "server/schedule/lease.h"

namespace tessera::server {

/// A connected or remembered worker, by number.
using WorkerKey = std::int64_t;

/// One worker's hold on a unit that is being rendered.
struct Holder {
  WorkerKey worker = 0;
  Attempt attempt;
  std::optional<Time> started;      // when a heartbeat first named it
  bool revoking = false;            // asked to hand it back
  double expected_seconds = 0;      // what fair share counts it as
  std::optional<Time> leased = {};  // absent: adopted from another process of the server, or audit
};

/// A unit that somebody holds.
struct InFlight {
  std::vector<Holder> holders;  // more than one: a speculative copy, or an adopted one
  bool copied = false;          // a speculative copy was made; there is never a second
};

/// Tiles [first_tile, first_tile + tile_count) of one pass of one frame.
struct Run {
  std::int32_t frame = 0, pass = 0, first_tile = 0, tile_count = 0;
};

/// Which units of a job are waiting, held by workers, or committed.
///
/// Units are leased frame by frame, within a frame pass by pass, within a pass along the curve, so
/// that all of pass 0 is leased before pass 1. Units that come back go first. In a plan on demand
/// only passes 0 and 1 are wanted from the start, the others as want() says. What is kept in
/// memory grows with the units in flight, and by one bit per unit of the frames that are open;
/// frames not begun are a cursor, finished frames one bit. Pure; the caller serialises.
class JobPlan {
 public:
  /// Requires sorted frames without repeats, tile_count >= 1, at least one pass.
  JobPlan(std::vector<std::int32_t> frames, std::int32_t tile_count,
          std::vector<contract::Pass> passes, bool is_adaptive = false);

  /// Passes that every tile wants from the start.
  std::int32_t first_passes() const;
  /// Units wanted so far.
  std::int64_t unit_count() const { return unit_count_; }
  std::int64_t committed_count() const { return committed_count_; }
  bool is_adaptive() const { return is_adaptive_; }
  std::int64_t in_flight_count() const { return static_cast<std::int64_t>(in_flight_.size()); }
  /// Units neither committed nor held by anybody.
  std::int64_t waiting_count() const { return unit_count() - committed_count_ - in_flight_count(); }
  std::int32_t frame_count() const { return static_cast<std::int32_t>(frames_.size()); }
  std::int32_t finished_frame_count() const { return finished_count_; }
  std::int32_t tile_count() const { return tile_count_; }
  const std::vector<std::int32_t>& frames() const { return frames_; }
  const std::vector<contract::Pass>& passes() const { return passes_; }
  const std::map<contract::Unit, InFlight>& in_flight() const { return in_flight_; }
  InFlight* find_in_flight(const contract::Unit& unit);

  /// Whether the unit exists in this job.
  bool contains(const contract::Unit& unit) const;
  bool is_finished(std::int32_t frame) const;
  /// Whether the unit is committed; true for every unit of a finished frame.
  bool is_committed(const contract::Unit& unit) const;
  /// Whether every unit of the frame is committed and, on demand, every tile's count is final.
  bool is_complete(std::int32_t frame) const;
  /// On demand: the tile wants `pass_count` passes, and if `is_final`, never more. Harmless to
  /// repeat. Requires a tile of a frame not finished.
  void set_pass_target(std::int32_t frame, std::int32_t tile, std::int32_t pass_count,
                       bool is_final);

  /// The next run of waiting units of which `may_take` accepts each, at most `most` units long.
  /// Takes nothing: call hold() for each. nullopt when there is none.
  std::optional<Run> next_run(std::int32_t most,
                              const std::function<bool(const contract::Unit&)>& may_take);
  /// Adds a holder. Requires a contained unit that is not committed; it is wanted, since it was
  /// leased once.
  void hold(const contract::Unit& unit, const Holder& holder);
  /// Takes a worker's hold away; the unit waits again if nobody else holds it. Returns the hold, or
  /// nullopt if it had none.
  std::optional<Holder> release(const contract::Unit& unit, WorkerKey worker);

  /// Marks the unit committed and returns who held it. Requires a contained unit not yet committed.
  std::vector<Holder> commit(const contract::Unit& unit);
  /// A committed unit of a frame not finished waits again: its block was found damaged.
  void redo(const contract::Unit& unit);
  /// On demand: takes back what was wanted of a frame beyond the first passes, whose blocks the
  /// caller drops: it was decided on false results. Returns the holds of units that are gone.
  std::vector<std::pair<contract::Unit, Holder>> reset_pass_targets(std::int32_t frame);
  /// The frame's output is durable; its units need no state any more. `unit_count`: how many it
  /// had, where this plan has not seen them.
  void finish(std::int32_t frame, std::optional<std::int64_t> unit_count = std::nullopt);

  /// Goes on to another schedule: longer, or (on demand or not) of another kind. Passes that are in
  /// both stay committed; the bits of the others are forgotten, and so are finished frames and what
  /// was wanted: commit() and want() them again. Returns the holds of units that are gone.
  std::vector<std::pair<contract::Unit, Holder>> extend(std::vector<contract::Pass> passes,
                                                        bool is_adaptive);

 private:
  using Position = std::tuple<std::int32_t, std::int32_t, std::int32_t>;  // frame, pass, tile
  struct FrameBits {
    std::vector<std::vector<bool>> committed;  // [pass][tile]; a pass is empty until its first
    std::int64_t count = 0;
    // On demand only; empty until something is wanted beyond the first passes.
    std::vector<std::int32_t> wanted;  // passes, by tile
    std::vector<bool> is_final;        // by tile
    std::int64_t wanted_count = 0;     // units
    std::int32_t final_count = 0;      // tiles
  };

  static Position position(const contract::Unit& unit) {
    return {unit.frame, unit.pass, unit.tile};
  }
  std::size_t index_of(std::int32_t frame) const;
  bool is_taken(const contract::Unit& unit) const;
  bool is_waiting(const contract::Unit& unit) const;
  FrameBits& open_frame(std::int32_t frame);
  void include_in_targets(const contract::Unit& unit);
  void plan_known_passes();
  contract::Unit at_cursor() const;
  bool cursor_at_end() const { return cursor_frame_ == frames_.size(); }
  void skip_taken();
  void advance_cursor();
  Run extend_run(const contract::Unit& first, std::int32_t most,
                 const std::function<bool(const contract::Unit&)>& may_take) const;

  std::vector<std::int32_t> frames_;
  std::int32_t tile_count_;
  std::vector<contract::Pass> passes_;
  bool is_adaptive_;
  std::int64_t unit_count_;
  std::vector<bool> finished_;  // by index of the frame
  std::int32_t finished_count_ = 0;
  std::map<std::int32_t, FrameBits> open_;  // frames with committed units, by number
  std::map<contract::Unit, InFlight> in_flight_;
  std::set<Position> returned_;  // waiting units behind the cursor, or beyond the first passes
  std::size_t cursor_frame_ = 0;
  std::int32_t cursor_pass_ = 0, cursor_tile_ = 0;  // everything before it has been looked at
  std::int64_t committed_count_ = 0;
};

}  // namespace tessera::server
