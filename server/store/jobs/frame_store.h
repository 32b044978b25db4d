#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/digest.h"

namespace tessera::server {

/// A finished frame: its image is durable; its blocks may be deleted.
struct FrameRecord {
  std::int32_t frame = 0;
  std::string file;  // name within the job's output directory
  contract::Digest file_sha256, pixels_sha256;
  std::string statistics_json;   // a FrameSummary
  std::int64_t image_bytes = 0;  // of a frame that is being finished; not read back
};

/// The finished frames of jobs with their images. One thread at a time may call writing functions,
/// that of Store; any thread may call reading functions.
class FrameStore {
 public:
  virtual ~FrameStore() = default;

  /// Returns the directory for outputs of a job, created if missing. Any thread. Errors:
  /// InvalidArgument, not a valid job ID.
  virtual absl::StatusOr<std::string> output_folder(const std::string& job_id) = 0;
  /// Size up to which an image is a row, 0: none. Any thread.
  virtual std::int64_t max_row_bytes() const = 0;

  /// Records a finished frame whose file is complete in the output directory; durable on return.
  /// Syncs file and directory first. Replaces an earlier record of the frame.
  ///
  /// Errors: NotFound, no such job or file; InvalidArgument, `file` is not a plain file name.
  virtual absl::Status finish(const std::string& job_id, const FrameRecord& frame) = 0;
  /// The same for a small image, which becomes a row without a file. Errors: as finish().
  virtual absl::Status finish_small(const std::string& job_id, const FrameRecord& frame,
                                    const std::string& image) = 0;
  /// Rewrites the statistics of a finished frame. Errors: NotFound.
  virtual absl::Status update_statistics(const std::string& job_id, std::int32_t frame,
                                         const std::string& statistics_json) = 0;

  /// Returns the finished frames of a job in order. An unknown job has none.
  virtual absl::StatusOr<std::vector<FrameRecord>> list(const std::string& job_id) const = 0;
  /// Returns the image of a finished frame that is stored in a row; nothing if it is a file in the
  /// output directory. Any thread.
  virtual absl::StatusOr<std::optional<std::string>> row_image(const std::string& job_id,
                                                               std::int32_t frame) const = 0;
};

}  // namespace tessera::server
