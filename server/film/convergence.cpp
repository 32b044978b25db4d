#include "server/film/convergence.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "contract/stopping_rule.h"

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

ConvergenceResult assess_convergence(const FrameStatistics& s, const StoppingStats& stopping,
                                     double error) {
  constexpr double kFewest = contract::StoppingRule::kMinEffectivePixels;
  ConvergenceResult claim;
  const auto doubt = [&](const std::string& reason) { claim.reasons.push_back(reason); };
  if (s.mean_luminance.value_or(0) <= 0) {
    doubt("the first pass of the frame is black: no error can be put in relation to it");
  }
  if (s.dropped_samples > 0) {
    doubt(absl::StrCat(s.dropped_samples, " samples were not finite and were left out"));
  }
  if (s.clamped_energy > 0) doubt("--clamp removed radiance");
  if (s.estimated.n_eff > 0 && s.estimated.n_eff < kFewest) {
    doubt(absl::StrFormat("the error sits in about %.3g pixels: too few to bound it",
                          s.estimated.n_eff));
  }
  if (stopping.concentrated_tiles > 0) {
    doubt(absl::StrCat(stopping.concentrated_tiles, " tiles have their error in fewer than ",
                       kFewest, " pixels each: too few to bound it"));
  }
  const bool is_doubtful = !claim.reasons.empty();
  const bool holds = s.estimated.error_upper95 <= error, is_capped = stopping.capped_tiles > 0;
  if (!holds) {
    std::string bound = absl::StrFormat("the error's upper bound is %.4g, asked for was %.4g",
                                        s.estimated.error_upper95, error);
    if (is_capped) {
      absl::StrAppend(&bound, "; ", stopping.capped_tiles,
                      " tiles have all the samples --max-spp allows");
    }
    doubt(bound);
  }
  if (is_doubtful) return claim;
  if (holds) {
    claim.certainty = Certainty::converged;
  } else if (is_capped) {
    claim.certainty = Certainty::capped;
  }
  return claim;
}

}  // namespace tessera::server
