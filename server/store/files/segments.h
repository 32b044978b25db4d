#pragma once

#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "server/store/files/durable_files.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// Position of a block: DIRECTORY/JOB/NUMBER.seg from `offset`.
struct SegmentPosition {
  std::int64_t segment = 0;
  std::int64_t offset = 0;
};

/// Append-only files of film blocks, a directory per job.
///
/// Bytes of a segment to which no row points were never committed. Nothing is appended after them:
/// after a restart, and after a failed write, a job continues in a new segment. One thread may
/// append, release and remove; any thread may read.
class Segments {
 public:
  /// `segment_bytes`: size at which a new segment is started.
  Segments(DurableFiles& files, std::string folder, std::int64_t segment_bytes);

  /// Appends blocks of one job and syncs once; sets one position per block. The first segment of a
  /// job in this process gets number `next_segment`, which must be unused. After an error the job
  /// continues in a new segment.
  absl::Status append(const std::string& job_id, std::int64_t next_segment,
                      std::span<const std::string_view> blocks,
                      std::span<SegmentPosition> positions);
  /// Errors: NotFound, the segment does not exist; OutOfRange, it is too short.
  absl::StatusOr<std::string> read(const std::string& job_id, SegmentPosition position,
                                   std::int64_t size_bytes) const;

  /// Deletes a job's segments below `first_kept`.
  absl::Status release(const std::string& job_id, std::int64_t first_kept);
  /// Deletes all segments of a job.
  absl::Status remove_job(const std::string& job_id);
  /// Deletes segments for which `is_known` returns false. Skips what cannot be a segment, or cannot
  /// be deleted, with a warning.
  absl::Status remove_orphans(
      const std::function<bool(const std::string& job_id, std::int64_t segment)>& is_known,
      const std::function<void(const std::string&)>& warn);

 private:
  /// The segment to which a job appends.
  struct Tail {
    std::int64_t segment = 0;
    std::unique_ptr<File> file;  // null: closed to save descriptors, or abandoned
    std::int64_t bytes = 0;
    bool abandoned = false;  // a write failed, so its end is unknown
  };
  /// A file kept open for reading; shared by the cache and current readers.
  struct OpenSegment {
    std::string path;
    std::shared_ptr<const File> file;
  };

  std::string job_folder(const std::string& job_id) const;
  std::string path(const std::string& job_id, std::int64_t segment) const;
  absl::StatusOr<Tail*> tail_for(const std::string& job_id, std::int64_t next_segment);
  absl::Status begin_segment(const std::string& job_id, std::int64_t segment, Tail& tail);
  absl::Status write_all(Tail& tail, std::span<const std::string_view> blocks,
                         std::span<SegmentPosition> positions);
  absl::StatusOr<std::shared_ptr<const File>> open_for_reading(const std::string& path) const;
  void forget_readers(const std::string& path_prefix);

  DurableFiles& files_;
  std::string folder_;
  std::int64_t segment_bytes_;
  std::map<std::string, Tail> tails_;
  mutable Mutex readers_mutex_ ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  mutable std::list<OpenSegment> readers_ ABSL_GUARDED_BY(readers_mutex_);  // latest first
};

}  // namespace tessera::server
