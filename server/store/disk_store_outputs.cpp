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
  if (!is_plain_name(frame.file)) {
    return absl::InvalidArgumentError(
        absl::StrCat("\"", frame.file, "\" is not a valid output name"));
  }
  const std::string path = absl::StrCat(folder_, "/outputs/", job_id, "/", frame.file);
  auto output = files_.filesystem().open_existing(path);
  if (!output.ok()) return output.status();
  std::int64_t bytes = (*output)->size();
  std::string image;
  const bool is_small = bytes <= options_.row_image_bytes;
  if (is_small) {
    image.resize(static_cast<std::size_t>(bytes));
    if (absl::Status read = (*output)->read_at(0, image); !read.ok()) return read;
    bytes = 0;
  } else if (absl::Status synced = sync_output(job_id, **output); !synced.ok()) {
    return synced;
  }
  std::int64_t replaced = 0;
  absl::Status status = journal_->write([&](Database& rows) {
    absl::Status written =
        rows.each("SELECT bytes FROM frames WHERE job=? AND frame=?", {job->sequence, frame.frame},
                  [&](const SqlRow& row) { replaced = row.integer(0); });
    written.Update(rows.run(
        "INSERT OR REPLACE INTO frames(job, frame, file, bytes, file_sha256, pixels_sha256, "
        "statistics_json) VALUES(?, ?, ?, ?, ?, ?, ?)",
        {job->sequence, frame.frame, frame.file, bytes, blob_of(frame.file_sha256),
         blob_of(frame.pixels_sha256), frame.statistics_json}));
    written.Update(
        is_small
            ? rows.run("INSERT OR REPLACE INTO images(job, frame, image) VALUES(?, ?, ?)",
                       {job->sequence, frame.frame, Blob{image}})
            : rows.run("DELETE FROM images WHERE job=? AND frame=?", {job->sequence, frame.frame}));
    return written;
  });
  if (!status.ok()) return status;
  return after_write([this, is_small, path, gained = bytes - replaced] {
    content_bytes_ += gained;
    return is_small ? files_.filesystem().remove(path) : absl::OkStatus();
  });
}

absl::Status DiskStore::sync_output(const std::string& job_id, File& output) {
  const std::string outputs = absl::StrCat(folder_, "/outputs");
  if (absl::Status made = files_.ensure_folder(outputs, job_id); !made.ok()) return made;
  if (absl::Status synced = files_.sync(output); !synced.ok()) return synced;
  return files_.sync_folder(absl::StrCat(outputs, "/", job_id));
}

absl::Status DiskStore::update_statistics(const std::string& job_id, std::int32_t frame,
                                          const std::string& statistics_json) {
  const auto job = find_job(job_id);
  if (!job.ok()) return job.status();
  return journal_->write([&](Database& rows) {
    const absl::Status updated =
        rows.run("UPDATE frames SET statistics_json=? WHERE job=? AND frame=?",
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
