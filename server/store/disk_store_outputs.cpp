// Finished images of a store: rows of frames, files, and small images in rows.
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/store/disk_store.h"
#include "server/store/files/names.h"

namespace tessera::server {

absl::StatusOr<std::string> DiskStore::output_folder(const std::string& job_id) {
  if (!is_plain_name(job_id)) {
    return absl::InvalidArgumentError(absl::StrCat("\"", job_id, "\" is not a valid job ID"));
  }
  const std::string folder = absl::StrCat(folder_, "/outputs/", job_id);
  if (absl::Status made = files_.filesystem().make_folder(folder); !made.ok()) return made;
  return folder;
}

absl::Status DiskStore::finish_frame(const std::string& job_id, const FrameRecord& frame) {
  if (absl::Status healthy = files_.check_healthy(); !healthy.ok()) return healthy;
  const auto job = find_job(job_id);
  if (!job.ok()) return job.status();
  const auto path = output_path(job_id, frame);
  if (!path.ok()) return path.status();
  const auto bytes = sync_output(job_id, *path);
  if (!bytes.ok()) return bytes.status();
  return write_frame(job->sequence, frame, {"", *path, *bytes});
}

absl::Status DiskStore::finish_small_frame(const std::string& job_id, const FrameRecord& frame,
                                           const std::string& image) {
  const auto job = find_job(job_id);
  if (!job.ok()) return job.status();
  const auto path = output_path(job_id, frame);
  if (!path.ok()) return path.status();
  return write_frame(job->sequence, frame, {image, *path, 0});
}

/// Returns the path of a frame's file.
absl::StatusOr<std::string> DiskStore::output_path(const std::string& job_id,
                                                   const FrameRecord& frame) const {
  if (!is_plain_name(frame.file)) {
    return absl::InvalidArgumentError(
        absl::StrCat("\"", frame.file, "\" is not a valid output name"));
  }
  return absl::StrCat(folder_, "/outputs/", job_id, "/", frame.file);
}

/// Makes a file durable and returns its size.
absl::StatusOr<std::int64_t> DiskStore::sync_output(const std::string& job_id,
                                                    const std::string& path) {
  const auto output = files_.filesystem().open_existing(path);
  if (!output.ok()) return output.status();
  const std::string outputs = absl::StrCat(folder_, "/outputs");
  absl::Status status = files_.ensure_folder(outputs, job_id);
  if (status.ok()) status = files_.sync(**output);
  if (status.ok()) status = files_.sync_folder(absl::StrCat(outputs, "/", job_id));
  if (!status.ok()) return status;
  return (*output)->size();
}

absl::Status DiskStore::write_frame(std::int64_t job, const FrameRecord& frame,
                                    const Image& image) {
  const bool is_file = image.file_bytes > 0;
  std::int64_t replaced = 0;  // size of an earlier file
  absl::Status status = journal_->write([&](Database& rows) {
    absl::Status written =
        rows.each("SELECT bytes FROM frames WHERE job=? AND frame=?", {job, frame.frame},
                  [&](const SqlRow& row) { replaced = row.integer(0); });
    written.Update(rows.run(
        "INSERT OR REPLACE INTO frames(job, frame, file, bytes, file_sha256, pixels_sha256, "
        "statistics_json) VALUES(?, ?, ?, ?, ?, ?, ?)",
        {job, frame.frame, frame.file, image.file_bytes, blob_of(frame.file_sha256),
         blob_of(frame.pixels_sha256), frame.statistics_json}));
    written.Update(
        is_file ? rows.run("DELETE FROM images WHERE job=? AND frame=?", {job, frame.frame})
                : rows.run("INSERT OR REPLACE INTO images(job, frame, image) VALUES(?, ?, ?)",
                           {job, frame.frame, Blob{image.row}}));
    return written;
  });
  if (!status.ok()) return status;
  return journal_->after_write([this, path = image.path, is_lost = !is_file && replaced > 0,
                                gained = image.file_bytes - replaced] {
    content_bytes_ += gained;
    return is_lost ? files_.filesystem().remove(path) : absl::OkStatus();
  });
}

absl::Status DiskStore::update_statistics(const std::string& job_id, std::int32_t frame,
                                          const std::string& statistics_json) {
  const auto job = find_job(job_id);
  if (!job.ok()) return job.status();
  return journal_->write([&](Database& rows) {
    absl::Status updated = rows.run("UPDATE frames SET statistics_json=? WHERE job=? AND frame=?",
                                    {statistics_json, job->sequence, frame});
    if (!updated.ok() || rows.changes() > 0) return updated;
    return absl::NotFoundError(absl::StrCat("no finished frame ", frame, " of job ", job_id));
  });
}

absl::StatusOr<std::optional<std::string>> DiskStore::row_image(const std::string& job_id,
                                                                std::int32_t frame) const {
  std::optional<std::string> image;
  absl::Status status = journal_->read([&](Database& rows) {
    return rows.each(
        "SELECT image FROM images WHERE job=(SELECT sequence FROM jobs WHERE id=?) AND frame=?",
        {job_id, frame}, [&](const SqlRow& row) { image = row.text(0); });
  });
  if (!status.ok()) return status;
  return image;
}

}  // namespace tessera::server
