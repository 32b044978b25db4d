#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "server/film/convergence.h"

namespace tessera::server {

/// The journal's record of a finished frame besides its files: FrameRecord::statistics_json.
struct FrameSummary {
  // Settings under which it was finished; they differ from the job's after an extension.
  std::int32_t spp = 0;
  std::optional<double> error;
  std::int64_t samples = 0, unit_count = 0;
  std::optional<Certainty> certainty;  // with a target error
  std::vector<std::string> warnings, reasons;
  std::optional<double> estimated_error;  // of the whole frame
  std::vector<std::string> doubts;        // why it may contain results of a faulty worker
  std::string entry_json;                 // element of the report's frames[]

  bool operator==(const FrameSummary&) const = default;
  /// Returns whether the frame was finished under these settings.
  bool fits(const contract::RenderSettings& settings) const;
};

std::string write_frame_summary(const FrameSummary& summary);
/// Returns an empty summary if `text` is not one.
FrameSummary read_frame_summary(const std::string& text);

}  // namespace tessera::server
