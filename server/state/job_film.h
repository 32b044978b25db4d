#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "contract/tile_grid.h"
#include "server/film/frame_summary.h"
#include "server/report/job_view.h"
#include "server/schedule/plan/job.h"
#include "server/state/block_index.h"
#include "server/store/store.h"

namespace tessera::server {

/// Images and progress of a job, apart from its schedule: plain data without a lock.
struct JobFilm {
  std::shared_ptr<const contract::TileGrid> grid;  // owners: the job and current users
  std::optional<BlockIndex> block_index;
  std::map<std::int32_t, FrameRecord> finished;  // without their statistics, which the store has
  std::set<std::int32_t> finishing;              // complete, image being written
  std::set<std::int32_t> suspect;  // may contain units of a faulty worker, which are dropped first
  /// Changes when committed units are dropped or the plan is replaced; films of frames that were
  /// opened before are then out of date.
  std::int64_t revision = 0;
  std::int64_t committed_samples = 0;
  std::int64_t samples_at_start = 0;  // committed before this process started
  // With a target error: samples of finished frames, and predictions for the others.
  std::int64_t finished_samples = 0;
  std::map<std::int32_t, std::int64_t> expected_samples;
  std::optional<Certainty> certainty;  // the worst of the finished frames

  // On disk: images of finished frames, and committed blocks, until the job is DONE. Those of units
  // that are rendered again count twice until the server restarts.
  std::int64_t image_bytes = 0, block_bytes = 0;

  std::vector<std::string> warnings;  // frames finished with units of a faulty worker

  double wall_at_start = 0;
  std::optional<double> estimated_error;
  std::int64_t create_time_us = 0, end_time_us = 0;
  /// FarmView::served_us() at its end.
  std::optional<std::int64_t> end_served_us;

  /// Returns the job's tiles, created if missing.
  const contract::TileGrid& open_grid(const Job& job);
  /// Returns the index of the job's committed blocks, created if missing.
  BlockIndex& open_block_index(Job& job);
  /// Returns the samples of a unit. Requires a pass of the job's plan.
  std::int64_t unit_samples(Job& job, const contract::Unit& unit);
  /// Counts a finished frame.
  void count_finished(const FrameRecord& record, const FrameSummary& summary);
  /// Forgets the progress and results of frames, for a job that starts over with other settings.
  void reset();
  /// Returns the samples of the whole job. With a target error they are predicted: frames not
  /// started count as the mean of the others.
  std::int64_t sample_count(const Job& job) const;
  /// Returns a snapshot for clients, without the reason why a job waits.
  JobView view(const Job& job, Time now) const;
  /// Returns the job's row.
  JobRecord record(const Job& job, Time now) const;
};

}  // namespace tessera::server
