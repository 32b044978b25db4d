#pragma once

#include <cstdint>
#include <vector>

namespace tessera::contract {

struct RenderSettings;

/// A pass of the schedule: samples [first_sample, first_sample + sample_count) of every pixel.
struct Pass {
  std::int32_t first_sample = 0, sample_count = 0;

  std::int32_t end() const { return first_sample + sample_count; }
  bool operator==(const Pass&) const = default;
};

/// Returns `spp` rounded up to a multiple of the replicates. Requires 1 <= spp <= kMaxSpp.
std::int32_t rounded_spp(std::int32_t spp);

inline constexpr std::int32_t kMaxSpp = 1 << 20;

/// Returns the passes of a fixed sample count: they end at 8 samples (a preview), 64, 512, then
/// every 512; the last is cut short. Blocks are rounded per pass, so the schedule affects pixels'
/// bits and depends on the settings only. Few passes keep the traffic below half a megabyte per
/// second and core (docs/explanation/scaling.md). Requires 1 <= spp <= kMaxSpp.
std::vector<Pass> fixed_schedule(std::int32_t spp);

/// Number of passes that every tile gets in a job with a target error.
inline constexpr std::int32_t kUnconditionalPasses = 2;

/// Returns the passes of a job with a target error: they end at 8 samples (a preview), 32, and then
/// double up to 512; from there on two passes double the total. Unneeded long passes are expensive,
/// short ones cost bandwidth. The last ends at `max_spp`. A tile may stop after any pass but the
/// first. Totals have few prime factors besides 2, because Sobol' points are best in powers of two.
std::vector<Pass> error_schedule(std::int32_t max_spp);

/// Returns the passes of a job with these settings.
std::vector<Pass> schedule(const RenderSettings& settings);

}  // namespace tessera::contract
