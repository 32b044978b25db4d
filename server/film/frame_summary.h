#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "server/film/convergence.h"

namespace tessera::server {

/// What the journal keeps of a finished frame beside its files: FrameRecord::statistics_json.
struct FrameSummary {
  // What it was finished for: a frame finished before its job was extended is told by these.
  std::int32_t spp = 0;
  std::optional<double> error;
  std::int64_t samples = 0, unit_count = 0;
  std::optional<Certainty> certainty;  // of an error asked for
  std::vector<std::string> warnings, reasons;
  std::string entry_json;  // of the report's frames[]

  bool operator==(const FrameSummary&) const = default;
  /// Whether the frame is what these settings ask for.
  bool fits(const contract::RenderSettings& settings) const;
};

std::string write_frame_summary(const FrameSummary& summary);
/// A note of nothing if `text` is none.
FrameSummary read_frame_summary(const std::string& text);

}  // namespace tessera::server
