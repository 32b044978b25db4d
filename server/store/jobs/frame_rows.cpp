#include "server/store/jobs/frame_rows.h"

#include <map>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/store/files/names.h"
#include "server/store/jobs/job_keys.h"
#include "server/store/sqlite/digests.h"

namespace tessera::server {

FrameRows::FrameRows(DurableFiles& files, Journal& journal, std::string folder, Options options)
    : files_(files), journal_(journal), folder_(std::move(folder)), options_(std::move(options)) {}

absl::Status FrameRows::clean_up() {
  std::set<std::string> live_jobs;
  absl::Status status = journal_.read([&](Database& rows) {
    absl::Status listed = rows.each("SELECT id FROM jobs WHERE removed=0", {},
                                    [&](const SqlRow& row) { live_jobs.insert(row.text(0)); });
    if (!listed.ok()) return listed;
    return rows.each("SELECT TOTAL(bytes) FROM frames", {},
                     [&](const SqlRow& row) { file_bytes_ += row.integer(0); });
  });
  if (!status.ok()) return status;
  std::multimap<std::string, std::string> in_rows;  // files by job that rows have replaced
  status = journal_.read([&](Database& rows) {
    return rows.each("SELECT id, file FROM frames JOIN jobs ON job=sequence WHERE bytes=0", {},
                     [&](const SqlRow& row) { in_rows.emplace(row.text(0), row.text(1)); });
  });
  if (!status.ok()) return status;
  const auto names = files_.filesystem().list(folder_);
  if (!names.ok()) return names.status();
  for (const std::string& name : *names) {
    const auto [first, last] = in_rows.equal_range(name);
    for (auto file = first; file != last; ++file) {
      const absl::Status gone =
          files_.filesystem().remove(absl::StrCat(folder_, "/", name, "/", file->second));
      if (!gone.ok()) options_.warn(absl::StrCat("skipped: ", std::string(gone.message())));
    }
    if (live_jobs.count(name) != 0) continue;
    const absl::Status gone = files_.remove_folder(absl::StrCat(folder_, "/", name));
    if (!gone.ok()) options_.warn(absl::StrCat("skipped: ", std::string(gone.message())));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::string> FrameRows::output_folder(const std::string& job_id) {
  if (!is_plain_name(job_id)) {
    return absl::InvalidArgumentError(absl::StrCat("\"", job_id, "\" is not a valid job ID"));
  }
  const std::string folder = absl::StrCat(folder_, "/", job_id);
  if (absl::Status made = files_.filesystem().make_folder(folder); !made.ok()) return made;
  return folder;
}

absl::Status FrameRows::finish(const std::string& job_id, const FrameRecord& frame) {
  if (absl::Status healthy = files_.check_healthy(); !healthy.ok()) return healthy;
  const auto job = find_job(journal_, job_id);
  if (!job.ok()) return job.status();
  const auto path = output_path(job_id, frame);
  if (!path.ok()) return path.status();
  const auto bytes = sync_output(job_id, *path);
  if (!bytes.ok()) return bytes.status();
  return write_frame(job->sequence, frame, {"", *path, *bytes});
}

absl::Status FrameRows::finish_small(const std::string& job_id, const FrameRecord& frame,
                                     const std::string& image) {
  const auto job = find_job(journal_, job_id);
  if (!job.ok()) return job.status();
  const auto path = output_path(job_id, frame);
  if (!path.ok()) return path.status();
  return write_frame(job->sequence, frame, {image, *path, 0});
}

/// Returns the path of a frame's file.
absl::StatusOr<std::string> FrameRows::output_path(const std::string& job_id,
                                                   const FrameRecord& frame) const {
  if (!is_plain_name(frame.file)) {
    return absl::InvalidArgumentError(
        absl::StrCat("\"", frame.file, "\" is not a valid output name"));
  }
  return absl::StrCat(folder_, "/", job_id, "/", frame.file);
}

/// Makes a file durable and returns its size.
absl::StatusOr<std::int64_t> FrameRows::sync_output(const std::string& job_id,
                                                    const std::string& path) {
  const auto output = files_.filesystem().open_existing(path);
  if (!output.ok()) return output.status();
  absl::Status status = files_.ensure_folder(folder_, job_id);
  if (status.ok()) status = files_.sync(**output);
  if (status.ok()) status = files_.sync_folder(absl::StrCat(folder_, "/", job_id));
  if (!status.ok()) return status;
  return (*output)->size();
}

absl::Status FrameRows::write_frame(std::int64_t job, const FrameRecord& frame,
                                    const Image& image) {
  const bool is_file = image.file_bytes > 0;
  std::int64_t replaced = 0;  // size of an earlier file
  absl::Status status = journal_.write([&](Database& rows) {
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
  journal_.after_write([this, path = image.path, is_lost = !is_file && replaced > 0,
                        gained = image.file_bytes - replaced] {
    file_bytes_ += gained;
    if (is_lost) files_.note_deletion(files_.filesystem().remove(path));
  });
  return absl::OkStatus();
}

absl::Status FrameRows::update_statistics(const std::string& job_id, std::int32_t frame,
                                          const std::string& statistics_json) {
  const auto job = find_job(journal_, job_id);
  if (!job.ok()) return job.status();
  return journal_.write([&](Database& rows) {
    absl::Status updated = rows.run("UPDATE frames SET statistics_json=? WHERE job=? AND frame=?",
                                    {statistics_json, job->sequence, frame});
    if (!updated.ok() || rows.changes() > 0) return updated;
    return absl::NotFoundError(absl::StrCat("no finished frame ", frame, " of job ", job_id));
  });
}

absl::StatusOr<std::optional<std::string>> FrameRows::row_image(const std::string& job_id,
                                                                std::int32_t frame) const {
  std::optional<std::string> image;
  absl::Status status = journal_.read([&](Database& rows) {
    return rows.each(
        "SELECT image FROM images WHERE job=(SELECT sequence FROM jobs WHERE id=?) AND frame=?",
        {job_id, frame}, [&](const SqlRow& row) { image = row.text(0); });
  });
  if (!status.ok()) return status;
  return image;
}

absl::StatusOr<std::vector<FrameRecord>> FrameRows::list(const std::string& job_id) const {
  std::vector<FrameRecord> frames;
  absl::Status damage;
  const absl::Status status = journal_.read([&](Database& rows) {
    return rows.each(
        "SELECT frame, file, file_sha256, pixels_sha256, statistics_json FROM frames "
        "WHERE job=(SELECT sequence FROM jobs WHERE id=?) ORDER BY frame",
        {job_id}, [&](const SqlRow& row) {
          FrameRecord& frame = frames.emplace_back();
          frame.frame = static_cast<std::int32_t>(row.integer(0));
          frame.file = row.text(1);
          damage.Update(read_digest(row.bytes(2), frame.file_sha256));
          damage.Update(read_digest(row.bytes(3), frame.pixels_sha256));
          frame.statistics_json = row.text(4);
        });
  });
  if (!status.ok()) return status;
  if (!damage.ok()) return damage;
  return frames;
}

absl::StatusOr<std::int64_t> FrameRows::file_bytes_of(std::int64_t job) const {
  return sum_bytes(journal_, "SELECT TOTAL(bytes) FROM frames WHERE job=?", job);
}

void FrameRows::remove_files(const std::string& job_id, std::int64_t bytes) {
  file_bytes_ -= bytes;
  files_.note_deletion(files_.remove_folder(absl::StrCat(folder_, "/", job_id)));
}

}  // namespace tessera::server
