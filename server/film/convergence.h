#pragma once

#include <optional>
#include <string>
#include <vector>

#include "server/film/frame_writer.h"

namespace tessera::server {

/// How the tiles of a frame asked for by its error came to an end (contract::StoppingRule).
struct StoppingStats {
  int looks = 1;
  std::int32_t capped_tiles = 0, concentrated_tiles = 0;
};

/// What can be claimed of a frame that was asked for by its error (design.md, section 5), from the
/// best to the worst; the numbers are those of v1.Job.Certainty.
enum class Certainty : std::uint8_t { converged = 1, capped = 2, uncertain = 3 };

/// CONVERGED, CAPPED or UNCERTAIN.
const char* certainty_name(Certainty certainty);
/// The opposite; nullopt for any other text.
std::optional<Certainty> parse_certainty(const std::string& name);

struct ConvergenceResult {
  Certainty certainty = Certainty::uncertain;
  std::vector<std::string> reasons;  // for people; empty if converged
};

/// Judges a finished frame: CONVERGED only if the bound is at most `error` and nothing voids it.
ConvergenceResult assess_convergence(const FrameStatistics& statistics,
                                     const StoppingStats& stopping, double error);

}  // namespace tessera::server
