#pragma once

#include <cstdint>

#include "worker/geometry/ray.h"
#include "worker/math/vector.h"
#include "worker/media/media.h"
#include "worker/shading/bsdf/bsdf.h"
#include "worker/shading/surface/surface.h"

namespace tessera::render {

/// Ways in which a path gains radiance.
enum class RadianceSource : std::uint8_t {
  unlit,            // colour of an unlit surface, KHR_materials_unlit
  emission,         // of the surface that the path hits
  environment,      // environment map or background colour, on a miss
  direct,           // a sampled light that is scattered at the vertex
  medium_light,     // a sampled light that is scattered in a medium
  medium_emission,  // of the medium that the path crosses
};

/// Receives the events of one path, for debugging. Observation does not change the path. The
/// references are valid during the call. Radiance is linear and includes the throughput.
class PathObserver {
 public:
  PathObserver() = default;
  PathObserver(const PathObserver&) = delete;
  PathObserver& operator=(const PathObserver&) = delete;
  virtual ~PathObserver() = default;

  struct Vertex {
    std::int32_t depth;         // scattering events before
    const Ray& ray;             // ray that hit the surface
    const Hit& hit;             // hit.t is relative to `ray`
    const ShadingPoint& point;  // the surface
    const Bsdf& bsdf;           // its scattering for this ray
    Vec3f position;             // recentred world, metres
    Vec3f throughput;           // of the path on arrival
  };
  /// A second path begins that looks for a small image of a light only (LightSpots), `offset`
  /// pixels from the pixel's centre.
  virtual void on_second_path(const Vec2f& /*offset*/) {}
  /// The path is at a surface that it shades.
  virtual void on_vertex(const Vertex& vertex) = 0;
  /// The path hit nothing.
  virtual void on_miss(const Ray& ray, const Vec3f& throughput) = 0;
  /// The path gained `radiance`, which includes the MIS weight `mis_weight`.
  virtual void on_radiance(RadianceSource source, const Vec3f& radiance, float mis_weight) = 0;
  /// The path passed a surface without scattering.
  virtual void on_pass(const Vec3f& throughput) = 0;
  /// The path collided in a medium at `position`.
  virtual void on_medium(const MediumView& medium, const Vec3f& position,
                         const Vec3f& throughput) = 0;
  /// The path sampled the BSDF; `throughput` includes the weight of the sample.
  virtual void on_scatter(const BsdfSample& sample, const Vec3f& throughput) = 0;
  /// Russian roulette with probability `survival`; `throughput` is that of a surviving path.
  virtual void on_roulette(float survival, bool survived, const Vec3f& throughput) = 0;
  /// The path reached the maximum depth. If `continued`, what follows is only an estimate of the
  /// truncated radiance and not part of the image.
  virtual void on_max_depth(bool continued) = 0;
};

}  // namespace tessera::render
