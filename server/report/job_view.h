#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "contract/digest.h"
#include "server/film/convergence.h"
#include "server/schedule/plan/job.h"
#include "server/store/store.h"

namespace tessera::server {

/// Why a job is paused; numbers as in v1.Job.PauseCause.
enum class PauseCause : std::int32_t { none = 0, user = 1, store_full = 2, failures = 3 };

/// A snapshot of a job for clients.
struct JobView {
  JobKey key = 0;
  std::shared_ptr<const JobSpec> spec;  // owners: the coordinator and this copy
  JobState state = JobState::queued;
  std::string reason;
  /// Set for a job that has failed, or that failures have paused.
  absl::StatusCode failure_code = absl::StatusCode::kOk;
  std::vector<FailedAttempt> failed_attempts;
  PauseCause pause_cause = PauseCause::none;
  std::int64_t create_time_us = 0, end_time_us = 0;  // wall clock; 0: not ended
  std::int64_t unit_count = 0, committed_unit_count = 0, leased_unit_count = 0;
  std::int32_t frame_count = 0, finished_frame_count = 0;
  std::int64_t committed_sample_count = 0, sample_count = 0;
  std::int32_t worker_count = 0;
  double cpu_seconds = 0;
  std::optional<double> estimated_error;
  std::optional<Certainty> certainty;  // with a target error, once done
  double elapsed_seconds = 0;
  std::optional<double> remaining_seconds;
};

/// Data of a job's report.
struct JobReport {
  JobView view;
  JobCounters counters;
  std::map<std::string, Contribution> contributions;                     // by worker id
  std::map<std::string, std::pair<std::string, std::int32_t>> machines;  // worker ID → ISA, threads
  std::vector<FrameRecord> frames;    // finished frames, in order
  std::vector<std::string> warnings;  // frames that may contain results of a faulty worker
};

/// An image file to send to a client.
struct FrameFile {
  std::string path;
  std::string bytes;          // the contents, if there is no path
  bool is_temporary = false;  // to be removed after sending
  std::int64_t size_bytes = 0;
  contract::Digest file_sha256;
  std::optional<contract::Digest> pixels_sha256;  // absent for a partial frame
  std::vector<contract::PixelRect> missing_tiles;
};

enum class FrameFormat : std::uint8_t { exr, png, jpeg };

struct FrameQuery {
  std::string job_id;
  std::int32_t frame = 0;
  FrameFormat format = FrameFormat::exr;
  double exposure_ev = 0;
  bool allow_partial = false;
};

}  // namespace tessera::server
