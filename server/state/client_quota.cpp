#include "server/state/client_quota.h"

#include <algorithm>

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

constexpr double kGiga = 1e9;

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

const QuotaKind& quota_kind(double ClientQuota::*member) {
  return *std::find_if(kQuotaKinds.begin(), kQuotaKinds.end(),
                       [&](const QuotaKind& kind) { return kind.member == member; });
}

double ClientQuotas::largest(double ClientQuota::*member) const {
  double largest = defaults.*member;
  for (const auto& [client, quota] : by_client) {
    if (largest == 0 || quota.*member == 0) return 0;
    largest = std::max(largest, quota.*member);
  }
  return largest;
}

absl::Status over_quota(const std::string& client, const QuotaKind& kind, double used,
                        double limit) {
  return absl::ResourceExhaustedError(absl::StrFormat(
      "quota %s: client %s is limited to %.10g %s and would use %.10g; %s, or ask the operator to "
      "raise --client-%s",
      kind.name, client, limit, kind.what, used, kind.advice, kind.name));
}

void OwnerUse::add(const JobSpec& spec) {
  const JobSize size = max_job_size(spec);
  ++jobs;
  store_bytes += static_cast<double>(size.store_bytes);
  samples += size.samples;
}

OwnerUse& OwnerUse::operator+=(const OwnerUse& other) {
  jobs += other.jobs;
  store_bytes += other.store_bytes;
  samples += other.samples;
  kept_bytes += other.kept_bytes;
  return *this;
}

double OwnerUse::of(const QuotaKind& kind) const {
  if (kind.member == &ClientQuota::jobs) return static_cast<double>(jobs);
  if (kind.member == &ClientQuota::gigasamples) return samples / kGiga;
  if (kind.member == &ClientQuota::gb) return store_bytes / kGiga;
  if (kind.member == &ClientQuota::stored_gb) return (store_bytes + kept_bytes) / kGiga;
  return 0;
}

absl::Status check_quota(const ClientQuota& quota, OwnerUse use, const JobSpec& spec,
                         const QuotaKind** refused) {
  use.add(spec);
  for (const QuotaKind& kind : kQuotaKinds) {
    const double limit = quota.*kind.member;
    if (limit == 0 || use.of(kind) <= limit) continue;
    if (refused != nullptr) *refused = &kind;
    return over_quota(spec.owner, kind, use.of(kind), limit);
  }
  return absl::OkStatus();
}

}  // namespace tessera::server
