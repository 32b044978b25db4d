#include "contract/pass_schedule.h"

#include <algorithm>

#include "contract/render_settings.h"
#include "contract/version.h"

namespace tessera::contract {
namespace {

constexpr std::int32_t kFirstPassSamples = 8;
constexpr std::int32_t kFewestSamples = 32;        // before a tile may stop by its error
constexpr std::int32_t kGrowth = 8;                // each pass brings the total to kGrowth times
constexpr std::int32_t kLargestPassSamples = 512;  // bounds what a lost unit costs
constexpr std::int32_t kLargestDoubled = 512;  // by error: later totals are 2ⁿ and 1.5 · 2ⁿ

/// Samples after the pass that follows on `done` in a job asked for by its error.
std::int32_t next_total(std::int32_t done) {
  if (done == 0) return kFirstPassSamples;
  if (done == kFirstPassSamples) return kFewestSamples;
  if (done < kLargestDoubled) return 2 * done;
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
        done == 0 ? kFirstPassSamples : std::min((kGrowth - 1) * done, kLargestPassSamples);
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
