#pragma once

#include <vector>

#include "absl/status/statusor.h"
#include "server/film/film_cache.h"
#include "server/schedule/plan/job_spec.h"
#include "server/state/block_index.h"
#include "server/store/store.h"

namespace tessera::server {

/// Writes the image of a complete frame to the job's output folder and returns the frame's row,
/// with its statistics. `progress`: of the frame's passes. Reads blocks as needed.
///
/// Errors: as FilmCache::mean_luminance() and those of writing a file.
absl::StatusOr<FrameRecord> write_finished_frame(
    FilmCache& film, Store& store, const FrameKey& key, const JobSpec& spec,
    const std::vector<BlockIndex::PassProgress>& progress);

/// Takes the look that is due: denoises the frame and reports whether it meets its bound.
/// Errors: as FilmCache::tile().
absl::Status take_denoised_look(FilmCache& film, const FrameKey& key, const JobSpec& spec);

}  // namespace tessera::server
