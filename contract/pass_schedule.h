#pragma once

#include <cstdint>
#include <vector>

namespace tessera::contract {

struct RenderSettings;

/// One pass of the schedule: samples [first_sample, first_sample + sample_count) of every pixel.
struct Pass {
  std::int32_t first_sample = 0, sample_count = 0;

  std::int32_t end() const { return first_sample + sample_count; }
  bool operator==(const Pass&) const = default;
};

/// `spp` rounded up to whole rounds of the replicates. Requires 1 <= spp <= kMaxSpp.
std::int32_t rounded_spp(std::int32_t spp);

inline constexpr std::int32_t kMaxSpp = 1 << 20;

/// The passes of a fixed sample count: 8 for a preview, then up to 64, then up to 512 in all, then
/// 512 at a time; the last is cut. A function of the sample setting alone: blocks are rounded per
/// pass, so this decides bits. Few passes keep a job under half a megabyte shipped per core second
/// (farm.md, section 10). Requires 1 <= spp <= kMaxSpp.
std::vector<Pass> fixed_schedule(std::int32_t spp);

/// Passes every tile wants in a job asked for by its error, before anything is decided.
inline constexpr std::int32_t kUnconditionalPasses = 2;

/// The passes a tile may want in a job asked for by its error: 8 for a preview, up to 32, then each
/// doubles the total up to 512, and two double it from there: a long pass too many is dear, a short
/// one costs bytes on the wire. Up to `max_spp`; the last is cut. A tile may stop after any but the
/// first. Totals have few factors other than 2, since Sobol' points are best in powers of it.
std::vector<Pass> error_schedule(std::int32_t max_spp);

/// The passes of a job.
std::vector<Pass> schedule(const RenderSettings& settings);

}  // namespace tessera::contract
