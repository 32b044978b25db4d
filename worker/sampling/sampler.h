#pragma once

#include <cstdint>

#include "contract/version.h"
#include "worker/math/vector.h"
#include "worker/sampling/hash.h"
#include "worker/sampling/sobol.h"

namespace tessera::render {

/// Kind of ray that Sampler::chance distinguishes.
enum class RayKind : std::uint8_t { path, shadow };

/// The random numbers of one sample of one pixel: a function of (seed, frame, pixel, sample index,
/// dimension) and of nothing else (docs/explanation/determinism.md#sample-streams).
///
/// Owen-scrambled Sobol' points by hashing, padded with sets of four dimensions that are shuffled
/// independently. Sample i is point i / R of replicate i mod R (R = contract::kReplicates); the
/// replicates of a pixel, like pixels, frames and sets, are scrambled independently. So every
/// 2^k consecutive points of a replicate that start at a multiple of 2^k are stratified.
///
/// Stateless: the same set always gives the same numbers. Values are multiples of 2^-24 in [0, 1).
/// Source: B. Burley, "Practical hash-based Owen scrambling", JCGT 9(4), 2020.
class Sampler {
 public:
  Sampler() = default;  // indeterminate until assigned
  /// `pixel_x` and `pixel_y` are coordinates in the full frame, also with a crop.
  Sampler(std::uint32_t seed, std::int32_t frame, std::int32_t pixel_x, std::int32_t pixel_y,
          std::int64_t sample_index) {
    const auto index = static_cast<std::uint32_t>(sample_index / contract::kReplicates);
    reversed_index_ = reverse_bits(index);
    const auto bits = [](std::int32_t v) { return static_cast<std::uint32_t>(v); };
    const std::uint64_t pixel =
        combine(combine(kDomain, pack(seed, bits(frame))), pack(bits(pixel_x), bits(pixel_y)));
    stream_ = combine(pixel, static_cast<std::uint64_t>(sample_index % contract::kReplicates));
    sample_ = combine(stream_, index);
  }

  /// All four dimensions of a set (dimensions.h).
  Vec4f get_4d(std::uint32_t set) const {
    const auto x = unit_floats(scrambled(set));
    return {x[0], x[1], x[2], x[3]};
  }

  /// The same in steps of 2^-32, in (0, 1), for sampling large tables.
  Vec4d get_4d_fine(std::uint32_t set) const {
    const Lanes4 x = scrambled(set);
    return {unit_double(x[0]), unit_double(x[1]), unit_double(x[2]), unit_double(x[3])};
  }

  /// Components x and y of the set.
  Vec2f get_2d(std::uint32_t set) const {
    const Lanes4 x = scrambled(set);
    return {unit_float(x[0]), unit_float(x[1])};
  }

  /// Component x of the set.
  float get_1d(std::uint32_t set) const { return unit_float(scrambled(set)[0]); }

  /// A number in [0, 1) for stochastic alpha at triangle (instance, primitive, triangle). Depends
  /// on the triangle and the bounce, not on the order in which triangles are visited.
  float chance(std::uint32_t bounce, RayKind kind, std::uint32_t instance, std::uint32_t primitive,
               std::uint32_t triangle) const {
    const std::uint64_t ray = combine(sample_, pack(bounce, static_cast<std::uint32_t>(kind)));
    return unit_float(combine(combine(ray, pack(instance, primitive)), triangle));
  }

  /// A hash of this sample and `purpose`, for decisions outside the sets.
  std::uint64_t hash(std::uint64_t purpose) const { return combine(~sample_, purpose); }

 private:
  static constexpr std::uint64_t kDomain = 0x7465737365726101ULL;

  Lanes4 scrambled(std::uint32_t set) const {
    const std::uint64_t seed = combine(stream_, set);
    const std::uint64_t more = mix(seed);
    const auto shuffle = static_cast<std::uint32_t>(seed);
    // An Owen scramble of the index shuffles the points, permuting aligned blocks.
    const std::uint32_t reversed = laine_karras(reversed_index_, shuffle);
    const Lanes4 seeds = {static_cast<std::uint32_t>(seed >> 32), static_cast<std::uint32_t>(more),
                          static_cast<std::uint32_t>(more >> 32),
                          static_cast<std::uint32_t>(mix(more) >> 16)};
    return reverse_bits(laine_karras(reversed_sobol(reversed), seeds));
  }

  std::uint64_t stream_;
  std::uint64_t sample_;
  std::uint32_t reversed_index_;
};

}  // namespace tessera::render
