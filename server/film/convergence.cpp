#include "server/film/convergence.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "contract/stopping/pass_rule.h"

namespace tessera::server {

const char* certainty_name(Certainty certainty) {
  switch (certainty) {
    case Certainty::converged:
      return "CONVERGED";
    case Certainty::capped:
      return "CAPPED";
    case Certainty::uncertain:
      break;
  }
  return "UNCERTAIN";
}

std::optional<Certainty> parse_certainty(const std::string& name) {
  for (const Certainty each : {Certainty::converged, Certainty::capped, Certainty::uncertain}) {
    if (name == certainty_name(each)) return each;
  }
  return std::nullopt;
}

ClaimedError::ClaimedError(const FrameStatistics& statistics)
    : error_upper95(statistics.estimated.error_upper95), n_eff(statistics.estimated.n_eff) {
  if (!statistics.denoised) return;
  error_upper95 = statistics.denoised->error_upper95;
  n_eff = std::min(n_eff, statistics.denoised->n_eff);
}

bool ClaimedError::is_concentrated() const {
  return n_eff > 0 && n_eff < contract::PassRule::kMinEffectivePixels;
}

ConvergenceResult assess_convergence(const FrameStatistics& s, const StoppingStats& stopping,
                                     const contract::RenderSettings& settings) {
  ConvergenceResult result;
  const auto add_reason = [&](const std::string& reason) { result.reasons.push_back(reason); };
  if (s.mean_luminance.value_or(0) <= 0) {
    add_reason("the frame's first pass is black, so its relative error is undefined");
  }
  if (s.dropped_samples > 0) {
    add_reason(absl::StrCat(s.dropped_samples, " samples were not finite and were dropped"));
  }
  if (s.clamped_energy > 0) add_reason("--clamp removed radiance");
  const ClaimedError claimed(s);
  const double error = *settings.error;
  const bool holds = claimed.error_upper95 <= error, is_capped = stopping.capped_tiles > 0;
  if (claimed.is_concentrated() && !holds) {
    std::string reason = absl::StrFormat(
        "the error is concentrated in few pixels (effectively %.3g), so its bound is wide",
        claimed.n_eff);
    if (stopping.is_futile) {
      absl::StrAppend(&reason, "; the samples left up to --max-spp would not meet the target");
    }
    if (!settings.is_guided()) {
      absl::StrAppend(&reason,
                      "; without --no-guiding there is less noise where light comes through glass "
                      "or narrow openings");
    }
    add_reason(reason);
  }
  const bool is_uncertain = !result.reasons.empty();
  if (!holds) {
    std::string bound = absl::StrFormat("the 95 %% error bound is %.4g, above the target %.4g",
                                        claimed.error_upper95, error);
    if (is_capped) {
      absl::StrAppend(&bound, "; tiles that reached --max-spp: ", stopping.capped_tiles);
    }
    add_reason(bound);
  }
  if (is_uncertain) return result;
  if (holds) {
    result.certainty = Certainty::converged;
  } else if (is_capped) {
    result.certainty = Certainty::capped;
  }
  return result;
}

}  // namespace tessera::server
