#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "server/frames/frame_finisher.h"
#include "server/report/job_view.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"

namespace tessera::server {

/// Image files for clients: finished frames, frames so far, and other formats. In tasks of the
/// frame.
class FrameImages {
 public:
  FrameImages(FarmState& farm, Store& store, FrameFinisher& finisher)
      : farm_(farm), store_(store), finisher_(finisher) {}

  using OnFile = std::function<void(absl::StatusOr<FrameFile>)>;

  /// Finds or creates a frame's image file on a film thread, then calls `done`. The caller removes
  /// a temporary file. Errors: as FetchFrame.
  void fetch_frame(const FrameQuery& query, OnFile done);

 private:
  /// The job of a query and, if it is finished, the frame.
  struct Source {
    std::shared_ptr<const JobSpec> spec;
    std::optional<FrameRecord> finished;
  };
  void start(const FrameQuery& query, const OnFile& done);
  absl::StatusOr<Source> find_source(const FrameQuery& query);
  absl::StatusOr<FrameFile> make_file(const FrameQuery& query, const Source& source);
  absl::StatusOr<FrameFile> find_finished(const FrameQuery& query, const FrameRecord& finished);
  std::string new_temporary_path(const std::string& folder);
  absl::StatusOr<FrameFile> write_partial(const FrameQuery& query, const JobSpec& spec);

  FarmState& farm_;
  Store& store_;
  FrameFinisher& finisher_;
  std::atomic<std::int64_t> partial_count_ = 0;
};

}  // namespace tessera::server
