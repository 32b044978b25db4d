#pragma once

#include <cstdint>

/// Which set of four sample dimensions serves what. A set is one shuffled and scrambled 4-D
/// Sobol' sequence, independent of every other set; its components x and y alone are a
/// (0, 2)-sequence, so they take what is two-dimensional. Part of the render contract.
namespace tessera::render::dimensions {

/// Camera: x, y position in the pixel filter; z time, if anything moves; w wavelength.
inline constexpr std::uint32_t kFilter = 0;
/// Camera: x, y point of the lens.
inline constexpr std::uint32_t kLens = 1;

inline constexpr std::uint32_t kFirstBounceSet = 2;
inline constexpr std::uint32_t kSetsPerBounce = 4;

/// Scattering event `bounce` (0 is the first hit). x, y: direction; z: lobe; w: roulette.
constexpr std::uint32_t bsdf(std::uint32_t bounce) {
  return kFirstBounceSet + bounce * kSetsPerBounce;
}
/// x, y: place on the light; z: which light; w: spare (a mixture inside the light).
constexpr std::uint32_t light(std::uint32_t bounce) {
  return bsdf(bounce) + 1;
}
/// Media, on the way to that event. x: how far; y: by which channel; z: place near a light; w: near
/// which.
constexpr std::uint32_t medium(std::uint32_t bounce) {
  return bsdf(bounce) + 2;
}
/// As light(), for the place near a light.
constexpr std::uint32_t light_in_medium(std::uint32_t bounce) {
  return bsdf(bounce) + 3;
}

/// For Sampler::hash: whether a path that is cut is traced on.
inline constexpr std::uint32_t kTraceOn = 0xffffffff;

}  // namespace tessera::render::dimensions
