#pragma once

#include <cstdint>

/// Assignment of sample dimensions, in sets of four, to the decisions of a path. A set is one
/// shuffled and scrambled 4-D Sobol' sequence, independent of every other set; its components x and
/// y alone are a (0, 2)-sequence, so they are used for two-dimensional domains. Part of the render
/// contract.
namespace tessera::render::dimensions {

/// Camera. x, y: position in the pixel filter; z: time, if anything moves; w: wavelength.
inline constexpr std::uint32_t kFilter = 0;
/// Camera. x, y: point on the lens.
inline constexpr std::uint32_t kLens = 1;

inline constexpr std::uint32_t kFirstBounceSet = 2;
inline constexpr std::uint32_t kSetsPerBounce = 4;

/// Scattering event `bounce` (0 is the first hit). x, y: direction; z: lobe; w: roulette.
constexpr std::uint32_t bsdf(std::uint32_t bounce) {
  return kFirstBounceSet + bounce * kSetsPerBounce;
}
/// Light sampling at that event. x, y: point on the light; z: choice of the light; w: distance in a
/// light that has a volume.
constexpr std::uint32_t light(std::uint32_t bounce) {
  return bsdf(bounce) + 1;
}
/// Media, on the segment before that event. x: free-flight distance; y: colour channel; z: distance
/// near a light; w: choice of that light.
constexpr std::uint32_t medium(std::uint32_t bounce) {
  return bsdf(bounce) + 2;
}
/// As light(), for the point near a light.
constexpr std::uint32_t light_in_medium(std::uint32_t bounce) {
  return bsdf(bounce) + 3;
}

/// Purpose of Sampler::hash: whether a path that reached max_depth is traced further.
inline constexpr std::uint32_t kTraceOn = 0xffffffff;

}  // namespace tessera::render::dimensions
