#include "server/frames/finished_frame.h"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "contract/pass_schedule.h"
#include "server/film/frame_summary.h"
#include "server/film/frame_writer.h"

namespace tessera::server {
namespace {

/// Size without compression up to which an image is encoded in memory and may become a row.
constexpr std::int64_t kMaxRawBytes = 1 << 20;

std::string frame_file_name(std::int32_t frame) {
  return absl::StrFormat("frame.%04d.exr", frame);
}

/// Returns error against cost after each pass that has units.
std::vector<CurvePoint> curve_of(const FilmCache& film, const FrameKey& key,
                                 const std::vector<BlockIndex::PassProgress>& progress,
                                 double luminance) {
  std::vector<CurvePoint> curve;
  CurvePoint point;
  for (std::size_t pass = 0; pass < progress.size() && progress[pass].committed > 0; ++pass) {
    const auto stats = film.after_pass(key, static_cast<std::int32_t>(pass));
    point.cpu_seconds += progress[pass].cpu_seconds;
    point.wall_seconds = std::max(point.wall_seconds, progress[pass].wall_seconds);
    point.samples = stats.samples;
    point.relmse = stats.estimate.relmse;
    point.error = luminance > 0 ? std::optional(stats.estimate.error) : std::nullopt;
    point.truth = stats.truth;
    curve.push_back(point);
  }
  return curve;
}

FrameSpec frame_spec(const FilmCache& film, const FrameKey& key, const JobSpec& spec,
                     double luminance) {
  return {spec.settings,         key.frame, spec.id, spec.name, luminance, film.stopping(key).looks,
          film.max_samples(key), false};
}

absl::Status write_file(const std::string& path, const std::string& bytes) {
  errno = 0;
  std::FILE* const file = std::fopen(path.c_str(), "wb");
  bool is_written =
      file != nullptr && std::fwrite(bytes.data(), 1, bytes.size(), file) == bytes.size();
  if (file != nullptr && std::fclose(file) != 0) is_written = false;
  return is_written ? absl::OkStatus() : absl::ErrnoToStatus(errno == 0 ? EIO : errno, path);
}

/// Writes the image: a small one to FrameResult::image, another to the file `name`.
absl::StatusOr<FrameResult> draw(FilmCache& film, Store& store, const FrameKey& key,
                                 const FrameSpec& frame, const std::string& name) {
  const TileReader read_tile = [&](std::int32_t tile) { return film.take_tile(key, tile); };
  const auto new_path = [&]() -> absl::StatusOr<std::string> {
    const auto folder = store.frames().output_folder(key.job_id);
    if (!folder.ok()) return folder.status();
    return absl::StrCat(*folder, "/", name);
  };
  if (raw_frame_bytes(frame.settings) > kMaxRawBytes) {
    const auto path = new_path();
    return path.ok() ? write_frame(frame, read_tile, *path) : path.status();
  }
  auto result = encode_frame(frame, read_tile);
  if (!result.ok() || result->file_bytes <= store.frames().max_row_bytes()) return result;
  const auto path = new_path();
  if (!path.ok()) return path.status();
  absl::Status written = write_file(*path, std::exchange(result->image, ""));
  if (!written.ok()) return written;
  return result;
}

}  // namespace

std::int64_t writing_bytes(const contract::RenderSettings& settings) {
  return raw_frame_bytes(settings) > kMaxRawBytes ? write_memory_bytes(settings) : 0;
}

absl::StatusOr<FinishedFrame> write_finished_frame(
    FilmCache& film, Store& store, const FrameKey& key, const JobSpec& spec,
    const std::vector<BlockIndex::PassProgress>& progress) {
  const auto luminance = film.mean_luminance(key);
  if (!luminance.ok()) return luminance.status();
  const StoppingStats stopping = film.stopping(key);
  const FrameSpec frame = frame_spec(film, key, spec, *luminance);
  const std::string name = frame_file_name(key.frame);
  auto result = draw(film, store, key, frame, name);
  if (!result.ok()) return result.status();
  const std::vector<CurvePoint> curve = curve_of(film, key, progress, *luminance);
  FinishedFrame finished;
  finished.image = std::move(result->image);
  FrameRecord& record = finished.record;
  record.frame = key.frame;
  record.file = name;
  record.file_sha256 = result->file_sha256;
  record.pixels_sha256 = result->pixels_sha256;
  record.image_bytes = result->file_bytes;
  FrameSummary& summary = finished.summary;
  for (std::size_t pass = 0; pass < curve.size(); ++pass) {
    summary.unit_count += progress[pass].committed;
  }
  summary.spp = contract::rounded_spp(spec.settings.spp);
  summary.error = spec.settings.error;
  summary.samples = result->statistics.samples;
  const ErrorEstimate estimate = film.running_estimate(key);
  if (estimate.pixels > 0) summary.estimated_error = estimate.error;
  summary.warnings = frame_warnings(result->statistics);
  std::string status = "DONE";
  if (summary.error) {
    ConvergenceResult convergence = assess_convergence(result->statistics, stopping, spec.settings);
    summary.certainty = convergence.certainty;
    summary.reasons = std::move(convergence.reasons);
    status = certainty_name(convergence.certainty);
  }
  summary.entry_json = frame_entry_json(*result, name, status, curve);
  record.statistics_json = write_frame_summary(summary);
  return finished;
}

absl::Status take_denoised_look(FilmCache& film, const FrameKey& key, const JobSpec& spec) {
  const auto luminance = film.mean_luminance(key);
  if (!luminance.ok()) return luminance.status();
  const auto statistics = measure_denoised(frame_spec(film, key, spec, *luminance),
                                           [&](std::int32_t tile) { return film.tile(key, tile); });
  if (!statistics.ok()) return statistics.status();
  const ClaimedError claimed(*statistics);
  film.end_look(key,
                {statistics->denoised->error, claimed.error_upper95, claimed.is_concentrated()});
  return absl::OkStatus();
}

}  // namespace tessera::server
