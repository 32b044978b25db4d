#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "worker/accel/scene_accel.h"
#include "worker/guide/photon.h"
#include "worker/guide/photon_source.h"
#include "worker/guide/visible_region.h"
#include "worker/light/light_sampler.h"
#include "worker/shading/surface/shading_scene.h"
#include "worker/shading/surface/surface.h"

namespace tessera::render {

/// The scene and the settings with which the photons of a frame are traced.
struct PhotonScene {
  const Scene& scene;
  const ShadingScene& shading;
  const SceneAccel& accel;
  const LightSampler& lights;
  std::int32_t max_depth = 16;  // scattering events of a path
  std::uint32_t seed = 0;
  std::int32_t frame = 0;
  bool moves = false;  // something moves during the exposure
  /// Photons are kept only near places where paths along these rays scatter; all are kept if there
  /// are none. Unit directions.
  std::span<const Ray> camera_rays = {};
  std::int64_t pixels = 0;  // of the frame, which limit the number of photons
};

/// Arguments that are the same for all photons of a frame.
struct PhotonTracing {
  const PhotonScene& scene;
  const PhotonSource& source;
  const VisibleRegion& region;  // where photons are wanted
  const ParallelFor& parallel_for;
};

/// Calls `trace(i, &photons)` for i from 0 to parts - 1, in parallel, and returns the photons in
/// the order of i.
std::vector<Photon> trace_parts(
    std::int64_t parts, const ParallelFor& parallel_for,
    const std::function<void(std::int64_t, std::vector<Photon>*)>& trace);

/// The path of a photon from a light, or of importance from the camera.
///
/// Media do not affect photons, and BSDFs are sampled as if photons were paths from the camera: the
/// guide only has to be similar to the light.
class PhotonPath {
 public:
  /// All must outlive the path. `key`: becomes Photon::path.
  PhotonPath(const PhotonScene& scene, PhotonRandom random, std::uint64_t key)
      : scene_(scene), random_(random), key_(key) {}

  /// Follows a photon and appends a Photon for each arrival in `region`. Its share is 0 if light
  /// sampling finds this light, otherwise 1.
  void trace(const PhotonSource& source, const VisibleRegion& region, std::vector<Photon>* stored);

  /// Follows a path from the camera and returns where it meets surfaces that are not specular, at
  /// most two.
  std::vector<SurfacePlace> look(const Ray& camera_ray);

 private:
  void walk();
  bool step();
  bool is_unseen(const ShadingPoint& point);
  bool goes_straight(const Bsdf& bsdf);
  bool pass(const Hit& hit, const SurfacePoint& position);
  bool scatter(const Bsdf& bsdf, const TriangleId& id, const SurfacePoint& position);
  void follow(const SurfacePoint& position, const TriangleId& id, const Vec3f& direction);

  const PhotonScene& scene_;
  PhotonRandom random_;
  std::uint64_t key_;
  std::vector<Photon>* stored_ = nullptr;
  const VisibleRegion* region_ = nullptr;  // of a photon; null for a path from the camera
  std::vector<SurfacePlace> seen_;         // by a path from the camera
  MovedSurface memory_;
  Ray ray_;
  Vec3f flux_;
  std::uint64_t way_ = 0;  // Photon::way, before the first mirror or lens of the light alone
  bool is_found_ = true;   // light sampling finds this light at the next surface
  bool is_point_ = false;  // comes straight from a light that no ray can hit
  std::int32_t depth_ = 0;
  int passed_ = 0;
};

}  // namespace tessera::render
