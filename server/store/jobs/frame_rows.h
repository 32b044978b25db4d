#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "server/store/files/durable_files.h"
#include "server/store/jobs/frame_store.h"
#include "server/store/sqlite/journal.h"

namespace tessera::server {

/// Frames as rows of the journal; their images are rows as well, or files.
class FrameRows final : public FrameStore {
 public:
  struct Options {
    std::int64_t max_row_bytes = 0;
    std::function<void(const std::string&)> warn;
  };

  /// `folder`: of the outputs of all jobs.
  FrameRows(DurableFiles& files, Journal& journal, std::string folder, Options options);

  /// Sums up the sizes of the files; deletes outputs of jobs that do not exist, and files that rows
  /// have replaced.
  absl::Status clean_up();

  absl::StatusOr<std::string> output_folder(const std::string& job_id) override;
  std::int64_t max_row_bytes() const override { return options_.max_row_bytes; }
  absl::Status finish(const std::string& job_id, const FrameRecord& frame) override;
  absl::Status finish_small(const std::string& job_id, const FrameRecord& frame,
                            const std::string& image) override;
  absl::Status update_statistics(const std::string& job_id, std::int32_t frame,
                                 const std::string& statistics_json) override;
  absl::StatusOr<std::vector<FrameRecord>> list(const std::string& job_id) const override;
  absl::StatusOr<std::optional<std::string>> row_image(const std::string& job_id,
                                                       std::int32_t frame) const override;

  /// Size of the images that are files.
  std::int64_t file_bytes() const { return file_bytes_; }
  /// Returns the size of a job's files. `job`: JobKey::sequence. On the writing thread.
  absl::StatusOr<std::int64_t> file_bytes_of(std::int64_t job) const;
  /// Deletes the outputs of a job whose rows are deleted; `bytes`: size of its files.
  void remove_files(const std::string& job_id, std::int64_t bytes);

 private:
  /// The image of a finished frame.
  struct Image {
    std::string_view row;         // without a file
    std::string path;             // of the file, or of one that the row replaces
    std::int64_t file_bytes = 0;  // 0: it is a row
  };

  absl::StatusOr<std::string> output_path(const std::string& job_id,
                                          const FrameRecord& frame) const;
  absl::StatusOr<std::int64_t> sync_output(const std::string& job_id, const std::string& path);
  absl::Status write_frame(std::int64_t job, const FrameRecord& frame, const Image& image);

  DurableFiles& files_;
  Journal& journal_;
  const std::string folder_;
  const Options options_;
  std::atomic<std::int64_t> file_bytes_ = 0;
};

}  // namespace tessera::server
