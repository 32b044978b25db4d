#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/render_settings.h"
#include "server/film/film_cache.h"
#include "server/film/frame_summary.h"
#include "server/schedule/plan/job_spec.h"
#include "server/state/block_index.h"
#include "server/store/store.h"

namespace tessera::server {

/// A complete frame, which the store has yet to record.
struct FinishedFrame {
  FrameRecord record;
  FrameSummary summary;
  std::string image;  // a small image, for a row; empty: it is a file
};

/// Returns the memory of a task that writes or denoises a frame; 0 if that is little.
std::int64_t writing_bytes(const contract::RenderSettings& settings);

/// Writes the image of a complete frame: to memory if it is small, else to the job's output folder.
/// `progress`: of the frame's passes. Reads blocks as needed.
///
/// Errors: as FilmCache::mean_luminance() and those of writing a file.
absl::StatusOr<FinishedFrame> write_finished_frame(
    FilmCache& film, Store& store, const FrameKey& key, const JobSpec& spec,
    const std::vector<BlockIndex::PassProgress>& progress);

/// Takes the look that is due: denoises the frame and reports its error and bound to the film.
/// Errors: as FilmCache::tile().
absl::Status take_denoised_look(FilmCache& film, const FrameKey& key, const JobSpec& spec);

}  // namespace tessera::server
