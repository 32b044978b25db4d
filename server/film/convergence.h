#pragma once

#include <optional>
#include <string>
#include <vector>

#include "contract/render_settings.h"
#include "server/film/frame_writer.h"

namespace tessera::server {

/// How the tiles of a frame with a target error stopped (contract::PassRule).
struct StoppingStats {
  int looks = 1;
  std::int32_t capped_tiles = 0;
  bool is_futile = false;  // stopped because the samples left could not meet the target
};

/// Outcome of a frame with a target error (docs/explanation/error-estimation.md), best first;
/// numbers as in v1.Job.Certainty.
enum class Certainty : std::uint8_t { converged = 1, capped = 2, uncertain = 3 };

/// Returns CONVERGED, CAPPED or UNCERTAIN.
const char* certainty_name(Certainty certainty);
/// Parses such a name; nullopt for any other text.
std::optional<Certainty> parse_certainty(const std::string& name);

struct ConvergenceResult {
  Certainty certainty = Certainty::uncertain;
  std::vector<std::string> reasons;  // in words; empty if converged
};

/// The figures that a frame's claim is based on: those of the denoised image if there is one.
struct ClaimedError {
  double error_upper95 = 0;
  double n_eff = 0;  // the smaller one of the raw and the denoised image; 0 without error

  explicit ClaimedError(const FrameStatistics& statistics);
  /// Whether so few pixels carry the error that its bound is wide.
  bool is_concentrated() const;
};

/// Assesses a finished frame: CONVERGED only if the bound is at most `settings.error` and nothing
/// invalidates it. Requires: settings.error.
ConvergenceResult assess_convergence(const FrameStatistics& statistics,
                                     const StoppingStats& stopping,
                                     const contract::RenderSettings& settings);

}  // namespace tessera::server
