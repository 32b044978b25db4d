#include "server/state/client_quota.h"

#include "absl/strings/str_format.h"
#include "contract/film_block.h"
#include "contract/pass_schedule.h"
#include "contract/tile_grid.h"

namespace tessera::server {
namespace {

/// Returns the maximum bytes of film blocks of a frame. A block's size is linear in its pixels.
std::int64_t frame_store_bytes(const contract::RenderSettings& settings) {
  const contract::PixelRect window = settings.window();
  const std::int64_t pixels = std::int64_t{window.width} * window.height;
  const std::int64_t tiles = contract::tile_count(settings);
  std::int64_t bytes = 0;
  const std::size_t passes = contract::schedule(settings).size();
  for (std::size_t pass = 0; pass < passes; ++pass) {
    const std::int64_t one = contract::film_block_bytes({1, 1, settings.aovs, pass == 0});
    const std::int64_t two = contract::film_block_bytes({2, 1, settings.aovs, pass == 0});
    bytes += (two - one) * pixels + (2 * one - two) * tiles;
  }
  return bytes;
}

absl::Status exceeded(const char* what, double sum, double limit) {
  return absl::ResourceExhaustedError(absl::StrFormat(
      "quota exceeded: your unfinished jobs would total %g %s; the limit is %g", sum, what, limit));
}

}  // namespace

JobSize max_job_size(const JobSpec& spec) {
  constexpr std::int64_t kImageBytesPerPixel = 96;  // all layers, 24 floats, uncompressed
  constexpr std::int64_t kMaxBytes = std::int64_t{1} << 62;
  const contract::PixelRect window = spec.settings.window();
  const std::int64_t pixels = std::int64_t{window.width} * window.height;
  const auto frames = static_cast<std::int64_t>(contract::frame_count(spec.settings.frames));
  const std::int64_t frame = frame_store_bytes(spec.settings) + kImageBytesPerPixel * pixels;
  const double product = static_cast<double>(frame) * static_cast<double>(frames);
  return {product > 4e18 ? kMaxBytes : frame * frames,
          static_cast<double>(pixels) * static_cast<double>(frames) * spec.settings.spp};
}

void OwnerUse::add(const JobSpec& spec) {
  const JobSize size = max_job_size(spec);
  ++jobs;
  store_bytes += static_cast<double>(size.store_bytes);
  samples += size.samples;
}

absl::Status check_quota(const ClientQuota& quota, OwnerUse use, const JobSpec& spec) {
  use.add(spec);
  if (quota.jobs > 0 && use.jobs > quota.jobs) {
    return exceeded("jobs", static_cast<double>(use.jobs), static_cast<double>(quota.jobs));
  }
  if (quota.samples > 0 && use.samples > quota.samples) {
    return exceeded("samples (pixels x samples per pixel)", use.samples, quota.samples);
  }
  if (quota.store_bytes > 0 && use.store_bytes > static_cast<double>(quota.store_bytes)) {
    return exceeded("bytes of store", use.store_bytes, static_cast<double>(quota.store_bytes));
  }
  return absl::OkStatus();
}

}  // namespace tessera::server
