#include "server/frames/frame_images.h"

#include <algorithm>
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

/// Returns the memory of a frame's PNG or JPEG file; 0 if that is little.
std::int64_t conversion_bytes(const contract::RenderSettings& settings) {
  constexpr std::int64_t kPixelBytes = 4, kLittle = 1 << 20;
  const contract::PixelRect window = settings.window();
  const std::int64_t bytes = std::int64_t{window.width} * window.height * kPixelBytes;
  return bytes > kLittle ? bytes : 0;
}

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

void FrameImages::fetch_frame(const FrameQuery& query, OnFile done) {
  finisher_.tasks().post({query.job_id, query.frame},
                         [this, query, done = std::move(done)] { start(query, done); });
}

/// Checks the query, then answers it in the frame's next task, whose memory is known now.
void FrameImages::start(const FrameQuery& query, const OnFile& done) {
  const auto source = find_source(query);
  if (!source.ok()) return done(source.status());
  const contract::RenderSettings& settings = source->spec->settings;
  const std::int64_t written = source->finished ? 0 : writing_bytes(settings);
  const std::int64_t converted = query.format == FrameFormat::exr ? 0 : conversion_bytes(settings);
  finisher_.tasks().post_next(
      {query.job_id, query.frame},
      [this, query, done, source = *source] { done(make_file(query, source)); },
      std::max(written, converted));
}

absl::StatusOr<FrameImages::Source> FrameImages::find_source(const FrameQuery& query) {
  Source source;
  {
    FarmChange change(farm_);
    Job* job = change.find_job(query.job_id);
    if (job == nullptr) return absl::NotFoundError(absl::StrCat("no job \"", query.job_id, "\""));
    source.spec = job->spec;
    const auto& frames = change.film(*job).finished;
    if (const auto found = frames.find(query.frame); found != frames.end()) {
      source.finished = found->second;
    } else if (!job->open_plan().contains({query.frame, 0, 0})) {
      return absl::NotFoundError(absl::StrCat("job ", query.job_id, " has no frame ", query.frame));
    }
  }
  if (!source.finished && !query.allow_partial) {
    return absl::FailedPreconditionError(
        absl::StrCat("frame ", query.frame, " of job ", query.job_id, " is not finished"));
  }
  return source;
}

absl::StatusOr<FrameFile> FrameImages::make_file(const FrameQuery& query, const Source& source) {
  auto file =
      source.finished ? find_finished(query, *source.finished) : write_partial(query, *source.spec);
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
  if (!was_open) finisher_.films().close(key);
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
