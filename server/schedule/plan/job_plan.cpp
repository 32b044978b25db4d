#include "server/schedule/plan/job_plan.h"

#include <algorithm>
#include <iterator>
#include <limits>
#include <utility>

namespace tessera::server {

using contract::Unit;

JobPlan::JobPlan(std::vector<std::int32_t> frames, std::int32_t tile_count,
                 std::vector<contract::Pass> passes, bool is_adaptive)
    : shape_{std::move(frames), tile_count, std::move(passes), is_adaptive},
      unit_count_(static_cast<std::int64_t>(shape_.frames.size()) * shape_.tile_count *
                  shape_.first_passes()),
      finished_(shape_.frames.size(), false) {}

std::int32_t PlanShape::first_passes() const {
  const auto all = static_cast<std::int32_t>(passes.size());
  return is_adaptive ? std::min(contract::kUnconditionalPasses, all) : all;
}

InFlight* JobPlan::find_in_flight(const Unit& unit) {
  const auto found = in_flight_.find(unit);
  return found == in_flight_.end() ? nullptr : &found->second;
}

std::size_t JobPlan::index_of(std::int32_t frame) const {
  const auto found = std::lower_bound(shape_.frames.begin(), shape_.frames.end(), frame);
  if (found == shape_.frames.end() || *found != frame) return shape_.frames.size();
  return static_cast<std::size_t>(found - shape_.frames.begin());
}

bool JobPlan::contains(const Unit& unit) const {
  return unit.tile >= 0 && unit.tile < shape_.tile_count && unit.pass >= 0 &&
         unit.pass < static_cast<std::int32_t>(shape_.passes.size()) &&
         index_of(unit.frame) != shape_.frames.size();
}

bool JobPlan::is_finished(std::int32_t frame) const {
  const std::size_t index = index_of(frame);
  return index != shape_.frames.size() && finished_[index];
}

bool JobPlan::is_committed(const Unit& unit) const {
  const auto found = open_.find(unit.frame);
  if (found == open_.end()) return is_finished(unit.frame);
  const auto& bits = found->second.committed[static_cast<std::size_t>(unit.pass)];
  return !bits.empty() && bits[static_cast<std::size_t>(unit.tile)];
}

bool JobPlan::is_complete(std::int32_t frame) const {
  const auto found = open_.find(frame);
  if (found == open_.end()) return is_finished(frame);
  const FrameBits& bits = found->second;
  if (shape_.is_adaptive)
    return bits.final_count == shape_.tile_count && bits.count == bits.wanted_count;
  return bits.count == std::int64_t{shape_.tile_count} * shape_.first_passes();
}

bool JobPlan::is_taken(const Unit& unit) const {
  return is_committed(unit) || in_flight_.count(unit) > 0;
}

/// Returns whether the unit is planned and neither committed nor in flight.
bool JobPlan::is_waiting(const Unit& unit) const {
  if (unit.pass >= shape_.first_passes()) return returned_.count(position(unit)) > 0;
  return !is_taken(unit);
}

Unit JobPlan::at_cursor() const {
  return {shape_.frames[cursor_frame_], cursor_tile_, cursor_pass_};
}

void JobPlan::advance_cursor() {
  if (++cursor_tile_ < shape_.tile_count) return;
  cursor_tile_ = 0;
  if (++cursor_pass_ < shape_.first_passes()) return;
  cursor_pass_ = 0;
  ++cursor_frame_;
}

void JobPlan::skip_taken() {
  while (!cursor_at_end()) {
    if (finished_[cursor_frame_] || is_held_back(shape_.frames[cursor_frame_])) {
      ++cursor_frame_;
      cursor_pass_ = cursor_tile_ = 0;
    } else if (is_taken(at_cursor())) {
      advance_cursor();
    } else {
      return;
    }
  }
}

Run JobPlan::extend_run(const Unit& first, std::int32_t max_tiles,
                        const std::function<bool(const Unit&)>& may_take) const {
  Run run{first.frame, first.pass, first.tile, 1};
  while (run.tile_count < max_tiles && run.first_tile + run.tile_count < shape_.tile_count) {
    const Unit next{first.frame, run.first_tile + run.tile_count, first.pass};
    if (!is_waiting(next) || !may_take(next)) break;
    ++run.tile_count;
  }
  return run;
}

std::optional<Run> JobPlan::next_run(std::int32_t max_tiles,
                                     const std::function<bool(const Unit&)>& may_take) {
  constexpr auto kLast = std::numeric_limits<std::int32_t>::max();
  for (auto it = returned_.begin(); it != returned_.end();) {
    const auto& [frame, pass, tile] = *it;
    if (is_held_back(frame)) {
      it = returned_.upper_bound({frame, kLast, kLast});
      continue;
    }
    const Unit unit{frame, tile, pass};
    if (may_take(unit)) return extend_run(unit, max_tiles, may_take);
    ++it;
  }
  for (skip_taken(); !cursor_at_end(); skip_taken()) {
    const Unit unit = at_cursor();
    if (may_take(unit)) return extend_run(unit, max_tiles, may_take);
    returned_.insert(position(unit));  // for another worker
    advance_cursor();
  }
  return std::nullopt;
}

/// Returns the number of units of the frame that are neither committed nor in flight.
std::int64_t JobPlan::waiting_of(std::int32_t frame) const {
  if (is_finished(frame)) return 0;
  std::int64_t count = std::int64_t{shape_.tile_count} * shape_.first_passes();
  if (const auto found = open_.find(frame); found != open_.end()) {
    if (found->second.wanted_count > 0) count = found->second.wanted_count;
    count -= found->second.count;
  }
  constexpr auto kLast = std::numeric_limits<std::int32_t>::max();
  const auto first = in_flight_.lower_bound({frame, 0, 0});
  return count - std::distance(first, in_flight_.upper_bound({frame, kLast, kLast}));
}

/// Call after the units of a frame have changed. Cost: only for a frame that is held back.
void JobPlan::recount(std::int32_t frame) {
  const auto held = held_back_.find(frame);
  if (held == held_back_.end()) return;
  held_back_count_ -= held->second;
  held->second = waiting_of(frame);
  held_back_count_ += held->second;
}

void JobPlan::hold_back(std::int32_t frame, bool is_held_back) {
  if (is_held_back) {
    held_back_.try_emplace(frame, 0);
    return recount(frame);
  }
  const auto held = held_back_.find(frame);
  if (held == held_back_.end()) return;
  held_back_count_ -= held->second;
  held_back_.erase(held);
  const std::size_t index = index_of(frame);
  if (index > cursor_frame_) return;
  cursor_frame_ = index;  // it was passed over
  cursor_pass_ = cursor_tile_ = 0;
}

JobPlan::FrameBits& JobPlan::open_frame(std::int32_t frame) {
  FrameBits& bits = open_[frame];
  bits.committed.resize(shape_.passes.size());
  if (shape_.is_adaptive && bits.wanted.empty()) {
    bits.wanted.resize(static_cast<std::size_t>(shape_.tile_count), shape_.first_passes());
    bits.is_final.resize(static_cast<std::size_t>(shape_.tile_count), false);
    bits.wanted_count = std::int64_t{shape_.tile_count} * shape_.first_passes();
  }
  return bits;
}

void JobPlan::set_pass_target(std::int32_t frame, std::int32_t tile, std::int32_t pass_count,
                              bool is_final) {
  FrameBits& bits = open_frame(frame);
  std::int32_t& wanted = bits.wanted[static_cast<std::size_t>(tile)];
  for (; wanted < pass_count; ++wanted) {
    ++bits.wanted_count;
    ++unit_count_;
    const Unit unit{frame, tile, wanted};
    if (!is_taken(unit)) returned_.insert(position(unit));
  }
  if (is_final && !bits.is_final[static_cast<std::size_t>(tile)]) {
    bits.is_final[static_cast<std::size_t>(tile)] = true;
    ++bits.final_count;
  }
  recount(frame);
}

/// A unit with a valid seal was planned, even if the film has not repeated that since a restart.
void JobPlan::include_in_targets(const Unit& unit) {
  if (unit.pass >= shape_.first_passes())
    set_pass_target(unit.frame, unit.tile, unit.pass + 1, false);
}

void JobPlan::hold(const Unit& unit, const Holder& holder) {
  include_in_targets(unit);
  returned_.erase(position(unit));
  in_flight_[unit].holders.push_back(holder);
  recount(unit.frame);
}

std::optional<Holder> JobPlan::release(const Unit& unit, WorkerKey worker) {
  const auto found = in_flight_.find(unit);
  if (found == in_flight_.end()) return std::nullopt;
  auto& holders = found->second.holders;
  const auto holder = std::find_if(holders.begin(), holders.end(),
                                   [&](const Holder& h) { return h.worker == worker; });
  if (holder == holders.end()) return std::nullopt;
  const Holder released = *holder;
  holders.erase(holder);
  if (holders.empty()) {
    in_flight_.erase(found);
    returned_.insert(position(unit));
    recount(unit.frame);
  }
  return released;
}

std::vector<Holder> JobPlan::commit(const Unit& unit) {
  include_in_targets(unit);
  FrameBits& frame = open_frame(unit.frame);
  auto& bits = frame.committed[static_cast<std::size_t>(unit.pass)];
  if (bits.empty()) bits.resize(static_cast<std::size_t>(shape_.tile_count), false);
  bits[static_cast<std::size_t>(unit.tile)] = true;
  ++frame.count;
  ++committed_count_;
  returned_.erase(position(unit));
  std::vector<Holder> holders;
  if (const auto found = in_flight_.find(unit); found != in_flight_.end()) {
    holders = std::move(found->second.holders);
    in_flight_.erase(found);
  }
  recount(unit.frame);
  return holders;
}

void JobPlan::redo(const Unit& unit) {
  const auto found = open_.find(unit.frame);
  if (found == open_.end() || !is_committed(unit)) return;
  auto& bits = found->second.committed[static_cast<std::size_t>(unit.pass)];
  bits[static_cast<std::size_t>(unit.tile)] = false;
  --found->second.count;
  --committed_count_;
  returned_.insert(position(unit));
  recount(unit.frame);
}

std::vector<std::pair<Unit, Holder>> JobPlan::reset_pass_targets(std::int32_t frame) {
  std::vector<std::pair<Unit, Holder>> gone;
  const auto found = open_.find(frame);
  if (!shape_.is_adaptive || found == open_.end()) return gone;
  FrameBits& bits = found->second;
  const auto is_gone = [&](std::int32_t of_frame, std::int32_t pass) {
    return of_frame == frame && pass >= shape_.first_passes();
  };
  for (auto it = in_flight_.begin(); it != in_flight_.end();) {
    if (is_gone(it->first.frame, it->first.pass)) {
      for (const Holder& holder : it->second.holders) gone.emplace_back(it->first, holder);
      it = in_flight_.erase(it);
    } else {
      ++it;
    }
  }
  std::erase_if(returned_,
                [&](const Position& p) { return is_gone(std::get<0>(p), std::get<1>(p)); });
  for (auto pass = static_cast<std::size_t>(shape_.first_passes()); pass < bits.committed.size();
       ++pass) {
    const auto count = std::count(bits.committed[pass].begin(), bits.committed[pass].end(), true);
    bits.count -= count;
    committed_count_ -= count;
    bits.committed[pass].clear();
  }
  unit_count_ -= bits.wanted_count - std::int64_t{shape_.tile_count} * shape_.first_passes();
  bits.wanted.clear();
  bits.is_final.clear();
  bits.wanted_count = 0;
  bits.final_count = 0;
  open_frame(frame);
  recount(frame);
  return gone;
}

void JobPlan::finish(std::int32_t frame, std::optional<std::int64_t> unit_count) {
  const std::size_t index = index_of(frame);
  if (index == shape_.frames.size() || finished_[index]) return;
  const std::int64_t first = std::int64_t{shape_.tile_count} * shape_.first_passes();
  std::int64_t counted = 0, wanted = first;
  if (const auto found = open_.find(frame); found != open_.end()) {
    counted = found->second.count;
    if (shape_.is_adaptive && found->second.wanted_count > 0) wanted = found->second.wanted_count;
    open_.erase(found);
  }
  finished_[index] = true;
  ++finished_count_;
  const std::int64_t had = unit_count.value_or(wanted);
  unit_count_ += had - wanted;
  committed_count_ += had - counted;
  recount(frame);
}

/// Units that are committed or in flight were planned.
void JobPlan::plan_known_passes() {
  std::vector<Unit> units;
  for (const auto& [unit, in_flight] : in_flight_) units.push_back(unit);
  for (const auto& [number, frame] : open_) {
    for (std::size_t pass = 0; pass < frame.committed.size(); ++pass) {
      for (std::size_t tile = 0; tile < frame.committed[pass].size(); ++tile) {
        if (!frame.committed[pass][tile]) continue;
        units.push_back({number, static_cast<std::int32_t>(tile), static_cast<std::int32_t>(pass)});
      }
    }
  }
  for (const Unit& unit : units) include_in_targets(unit);
}

std::vector<std::pair<Unit, Holder>> JobPlan::extend(std::vector<contract::Pass> passes,
                                                     bool is_adaptive) {
  std::size_t same = 0;
  while (same < shape_.passes.size() && same < passes.size() && shape_.passes[same] == passes[same])
    ++same;
  shape_.passes = std::move(passes);
  shape_.is_adaptive = is_adaptive;
  unit_count_ =
      static_cast<std::int64_t>(shape_.frames.size()) * shape_.tile_count * shape_.first_passes();
  std::vector<std::pair<Unit, Holder>> gone;
  const auto is_gone = [&](std::int32_t pass) { return static_cast<std::size_t>(pass) >= same; };
  for (auto it = in_flight_.begin(); it != in_flight_.end();) {
    if (is_gone(it->first.pass)) {
      for (const Holder& holder : it->second.holders) gone.emplace_back(it->first, holder);
      it = in_flight_.erase(it);
    } else {
      ++it;
    }
  }
  committed_count_ = 0;
  for (auto& [number, frame] : open_) {
    FrameBits kept;
    kept.committed = std::move(frame.committed);
    kept.committed.resize(shape_.passes.size());
    for (std::size_t pass = 0; pass < shape_.passes.size(); ++pass) {
      auto& bits = kept.committed[pass];
      if (pass >= same) bits.clear();
      kept.count += std::count(bits.begin(), bits.end(), true);
    }
    committed_count_ += kept.count;
    frame = std::move(kept);
  }
  finished_.assign(shape_.frames.size(), false);
  finished_count_ = 0;
  returned_.clear();
  if (shape_.is_adaptive) plan_known_passes();
  cursor_frame_ = 0;
  cursor_pass_ = cursor_tile_ = 0;
  for (const auto& [frame, waiting] : held_back_) recount(frame);
  return gone;
}

}  // namespace tessera::server
