#include <nlohmann/json.hpp>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "server/film/frame_writer.h"

namespace tessera::server {
namespace {

using nlohmann::ordered_json;

constexpr double kWarningFraction = 0.01;  // fraction of the light cut by --max-depth that warrants
                                           // a warning

/// With more tiles they would dominate the report.
constexpr std::size_t kMaxTilesTold = 16'384;

ordered_json tiles_json(const std::vector<TileStats>& tiles) {
  if (tiles.size() > kMaxTilesTold) return nullptr;
  ordered_json errors = ordered_json::array(), samples = ordered_json::array();
  for (const TileStats& tile : tiles) {
    double rounded = 0;  // to significant digits
    (void)absl::SimpleAtod(absl::StrFormat("%.4g", tile.error), &rounded);
    errors.push_back(rounded);
    samples.push_back(tile.sample_count);
  }
  return {{"error", errors}, {"spp", samples}};
}

ordered_json number_or_null(const std::optional<double>& value) {
  return value ? ordered_json(*value) : ordered_json(nullptr);
}

ordered_json truth_json(const std::optional<TrueErrorStats>& truth) {
  if (!truth) return nullptr;
  return {{"rmse", truth->rmse},
          {"relmse", truth->relmse},
          {"error", number_or_null(truth->error)},
          {"flip", nullptr}};
}

ordered_json denoised_json(const FrameStatistics& statistics, bool has_scale) {
  if (!statistics.denoised) return nullptr;
  const DenoisedStatistics& d = *statistics.denoised;
  const auto if_scaled = [&](double value) {
    return has_scale ? ordered_json(value) : ordered_json(nullptr);
  };
  return {{"error_denoised", if_scaled(d.error)},
          {"error_denoised_upper95", if_scaled(d.error_upper95)},
          {"n_eff", if_scaled(d.n_eff)},
          {"raw_tile_share", d.raw_tile_share},
          {"raw_pixels_sha256", d.raw_pixels_sha256.hex()}};
}

}  // namespace

std::string frame_entry_json(const FrameResult& result, const std::string& file,
                             const std::string& status, const std::vector<CurvePoint>& curve) {
  const FrameStatistics& s = result.statistics;
  // Without m, or with m = 0, the relative error is undefined
  // (docs/explanation/error-estimation.md).
  const bool has_scale = s.mean_luminance.value_or(0) > 0 && s.estimated.pixels > 0;
  const auto if_scaled = [&](double value) {
    return has_scale ? ordered_json(value) : ordered_json(nullptr);
  };
  ordered_json points = ordered_json::array();
  for (const CurvePoint& point : curve) {
    points.push_back({{"cpu_seconds", point.cpu_seconds},
                      {"wall_seconds", point.wall_seconds},
                      {"samples", point.samples},
                      {"relmse", point.relmse},
                      {"error", number_or_null(point.error)},
                      {"error_true", point.truth ? number_or_null(point.truth->error) : nullptr}});
  }
  const ordered_json entry = {{"frame", s.frame},
                              {"file", file},
                              {"width", s.width},
                              {"height", s.height},
                              {"pixels_sha256", result.pixels_sha256.hex()},
                              {"file_sha256", result.file_sha256.hex()},
                              {"spp_mean", s.spp_mean},
                              {"spp_max", s.spp_max},
                              {"samples", s.samples},
                              {"status", status},
                              {"mean_luminance", number_or_null(s.mean_luminance)},
                              {"estimated",
                               {{"rmse", s.estimated.rmse},
                                {"relmse", s.estimated.relmse},
                                {"error", if_scaled(s.estimated.error)},
                                {"error_upper95", if_scaled(s.estimated.error_upper95)},
                                {"n_eff", if_scaled(s.estimated.n_eff)}}},
                              {"denoised", denoised_json(s, has_scale)},
                              {"true", curve.empty() ? nullptr : truth_json(curve.back().truth)},
                              {"heavy_tail_share", if_scaled(s.heavy_tail_share)},
                              {"unseen_event_bound", s.unseen_event_bound},
                              {"dropped_samples", s.dropped_samples},
                              {"clamped_energy", s.clamped_energy},
                              {"truncated_energy", s.truncated_energy},
                              {"transparency_limit_count", s.transparency_limit_count},
                              {"half_overflow_count", s.half_overflow_count},
                              {"tiles", has_scale ? tiles_json(s.tiles) : nullptr},
                              {"curve", points}};
  return entry.dump();
}

std::vector<std::string> frame_warnings(const FrameStatistics& s) {
  std::vector<std::string> warnings;
  if (s.dropped_samples > 0) {
    warnings.push_back(absl::StrCat(s.dropped_samples,
                                    " samples were not finite and were dropped; the error "
                                    "estimate excludes them"));
  }
  if (s.clamped_energy > 0) {
    warnings.push_back(absl::StrCat("--clamp removed a total radiance of ", s.clamped_energy,
                                    "; the error estimate excludes this loss"));
  }
  // Treats the mean over channels as the luminance, which is accurate enough for a warning.
  const double light = 3 * static_cast<double>(s.samples) * s.mean_luminance.value_or(0);
  if (s.truncated_energy > kWarningFraction * light) {
    warnings.push_back(absl::StrFormat(
        "--max-depth removed about %.2g %% of the light; the error estimate excludes this loss",
        100 * s.truncated_energy / (light + s.truncated_energy)));
  }
  if (s.transparency_limit_count > 0) {
    warnings.push_back(absl::StrCat(s.transparency_limit_count,
                                    " paths were cut after 1,024 transparent surfaces"));
  }
  if (s.half_overflow_count > 0) {
    warnings.push_back(absl::StrCat("--half clamped ", s.half_overflow_count, " values to 65504"));
  }
  return warnings;
}

}  // namespace tessera::server
