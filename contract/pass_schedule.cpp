#include "contract/pass_schedule.h"

#include <algorithm>

#include "contract/render_settings.h"
#include "contract/version.h"

namespace tessera::contract {
namespace {

constexpr std::int32_t kFirstPassSamples = 8;
constexpr std::int32_t kMinAdaptiveSamples = 32;  // before a tile may stop
constexpr std::int32_t kGrowth = 8;               // ratio of the totals of successive passes
constexpr std::int32_t kMaxPassSamples = 512;     // bounds the work lost with a unit
constexpr std::int32_t kMaxDoubledTotal = 512;  // beyond it, adaptive totals are 2ⁿ and 1.5 · 2ⁿ

/// Returns the total after the pass that follows a total of `done`, in a job with a target error.
std::int32_t next_total(std::int32_t done) {
  if (done == 0) return kFirstPassSamples;
  if (done == kFirstPassSamples) return kMinAdaptiveSamples;
  if (done < kMaxDoubledTotal) return 2 * done;
  const bool is_power_of_two = (done & (done - 1)) == 0;
  return is_power_of_two ? done / 2 * 3 : done / 3 * 4;
}

}  // namespace

std::int32_t rounded_spp(std::int32_t spp) {
  return (spp + kReplicates - 1) / kReplicates * kReplicates;
}

std::vector<Pass> fixed_schedule(std::int32_t spp) {
  const std::int32_t total = rounded_spp(spp);
  std::vector<Pass> passes;
  std::int32_t done = 0;
  while (done < total) {
    const std::int32_t wanted =
        done == 0 ? kFirstPassSamples : std::min((kGrowth - 1) * done, kMaxPassSamples);
    const std::int32_t count = std::min(wanted, total - done);
    passes.push_back({done, count});
    done += count;
  }
  return passes;
}

std::vector<Pass> error_schedule(std::int32_t max_spp) {
  const std::int32_t cap = rounded_spp(max_spp);
  std::vector<Pass> passes;
  std::int32_t done = 0;
  while (done < cap) {
    passes.push_back({done, std::min(next_total(done), cap) - done});
    done += passes.back().sample_count;
  }
  return passes;
}

std::vector<Pass> schedule(const RenderSettings& settings) {
  return settings.error ? error_schedule(settings.spp) : fixed_schedule(settings.spp);
}

std::vector<std::int32_t> frame_list(const std::vector<FrameRange>& ranges) {
  std::vector<std::int32_t> frames;
  for (const FrameRange& range : ranges) {
    for (std::int64_t frame = range.first; frame <= range.last; frame += range.step) {
      frames.push_back(static_cast<std::int32_t>(frame));
    }
  }
  std::sort(frames.begin(), frames.end());
  frames.erase(std::unique(frames.begin(), frames.end()), frames.end());
  return frames;
}

std::int64_t frame_count(const std::vector<FrameRange>& ranges) {
  std::int64_t count = 0;
  for (const FrameRange& range : ranges) {
    count += (std::int64_t{range.last} - range.first) / range.step + 1;
  }
  return count;
}

}  // namespace tessera::contract
