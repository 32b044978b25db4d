#include "server/frames/frame_images.h"

#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/film/frame_writer.h"
#include "server/film/image_export.h"

namespace tessera::server {
namespace {

/// Converts an image file; a temporary one is removed.
absl::StatusOr<FrameFile> converted(FrameFile file, const FrameQuery& query) {
  const auto format = query.format == FrameFormat::png ? ExportFormat::png : ExportFormat::jpeg;
  auto image = export_image(file.path, format, query.exposure_ev);
  std::error_code ignored;
  if (file.is_temporary) std::filesystem::remove(file.path, ignored);
  if (!image.ok()) return image.status();
  file.path.clear();
  file.is_temporary = false;
  file.size_bytes = static_cast<std::int64_t>(image->size());
  file.file_sha256 = contract::sha256(*image);
  file.bytes = *std::move(image);
  return file;
}

}  // namespace

void FrameImages::fetch_frame(const FrameQuery& query,
                              std::function<void(absl::StatusOr<FrameFile>)> done) {
  finisher_.tasks().post([this, query, done = std::move(done)] { done(make_file(query)); });
}

absl::StatusOr<FrameFile> FrameImages::make_file(const FrameQuery& query) {
  std::shared_ptr<const JobSpec> spec;
  std::optional<FrameRecord> finished;
  {
    FarmChange change(farm_);
    Job* job = change.find_job(query.job_id);
    if (job == nullptr) return absl::NotFoundError(absl::StrCat("no job \"", query.job_id, "\""));
    spec = job->spec;
    const auto& frames = change.film(*job).finished;
    if (const auto found = frames.find(query.frame); found != frames.end()) {
      finished = found->second;
    } else if (!job->open_plan().contains({query.frame, 0, 0})) {
      return absl::NotFoundError(absl::StrCat("job ", query.job_id, " has no frame ", query.frame));
    }
  }
  if (!finished && !query.allow_partial) {
    return absl::FailedPreconditionError(
        absl::StrCat("frame ", query.frame, " of job ", query.job_id, " is not finished"));
  }
  auto file = finished ? find_finished(query, *finished) : write_partial(query, *spec);
  if (!file.ok() || query.format == FrameFormat::exr) return file;
  return converted(*std::move(file), query);
}

/// A small image is in memory, for another format in a temporary file.
absl::StatusOr<FrameFile> FrameImages::find_finished(const FrameQuery& query,
                                                     const FrameRecord& finished) {
  auto image = store_.frames().row_image(query.job_id, query.frame);
  if (!image.ok()) return image.status();
  FrameFile file;
  file.file_sha256 = finished.file_sha256;
  file.pixels_sha256 = finished.pixels_sha256;
  if (*image && query.format == FrameFormat::exr) {
    file.bytes = *std::move(*image);
    file.size_bytes = static_cast<std::int64_t>(file.bytes.size());
    return file;
  }
  const auto folder = store_.frames().output_folder(query.job_id);
  if (!folder.ok()) return folder.status();
  if (*image) {
    file.path = new_temporary_path(*folder);
    file.is_temporary = true;
    std::ofstream out(file.path, std::ios::binary);
    out << **image;
    out.close();
    if (!out) return absl::UnavailableError(absl::StrCat("cannot write ", file.path));
  } else {
    file.path = absl::StrCat(*folder, "/", finished.file);
  }
  std::error_code error;
  file.size_bytes = static_cast<std::int64_t>(std::filesystem::file_size(file.path, error));
  if (error) return absl::NotFoundError(absl::StrCat(file.path, ": ", error.message()));
  return file;
}

std::string FrameImages::new_temporary_path(const std::string& folder) {
  return absl::StrCat(folder, "/partial.", ++partial_count_, ".exr");
}

absl::StatusOr<FrameFile> FrameImages::write_partial(const FrameQuery& query, const JobSpec& spec) {
  const FrameKey key{query.job_id, query.frame};
  {
    FarmChange change(farm_);
    Job* job = change.find_job(query.job_id);
    if (job == nullptr || !change.film(*job).open_block_index(*job).has(query.frame)) {
      return absl::FailedPreconditionError(
          absl::StrCat("no unit of frame ", query.frame, " is committed yet"));
    }
  }
  FilmCache& film = finisher_.films().cache();
  const bool was_open = film.is_open(key);
  finisher_.open(key);
  const auto folder = store_.frames().output_folder(query.job_id);
  if (!folder.ok()) return folder.status();
  const std::string path = new_temporary_path(*folder);
  const auto luminance = film.mean_luminance(key);
  const FrameSpec frame{spec.settings,
                        query.frame,
                        spec.id,
                        spec.name,
                        luminance.ok() ? std::optional(*luminance) : std::nullopt,
                        film.stopping(key).looks,
                        film.max_samples(key),
                        true};
  const auto result = write_frame(
      frame, [&](std::int32_t tile) { return film.tile(key, tile); }, path);
  if (!was_open) film.close_frame(key);
  if (!result.ok()) return result.status();
  FrameFile file;
  file.path = path;
  file.is_temporary = true;
  file.size_bytes = result->file_bytes;
  file.file_sha256 = result->file_sha256;
  file.missing_tiles = result->missing_tiles;
  return file;
}

}  // namespace tessera::server
