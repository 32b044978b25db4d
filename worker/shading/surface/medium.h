#pragma once

#include "worker/math/transform.h"
#include "worker/math/vector.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// What lies between surfaces, as paths read it: TESSERA_medium and what KHR_materials_volume
/// absorbs, added up.
struct MediumView {
  Vec3f scattering, extinction;  // per metre, where the density is 1; extinction includes
                                 // scattering and may be infinite
  float anisotropy = 0;
  const ProceduralTexture* procedure = nullptr;  // of the density; or
  const DensityGrid* grid = nullptr;
  float most = 1, usual = 1;  // density is nowhere above `most`, and about `usual`
  Vec3d origin;               // Scene::center

  bool present() const { return max_component(extinction) > 0; }
  bool scatters() const { return max_component(scattering) > 0; }
  bool even() const { return procedure == nullptr && grid == nullptr; }
};

/// `medium`, of `scene`, may be null. `absorption` is added to its own.
MediumView view_of_medium(const Scene& scene, const Medium* medium, const Vec3f& absorption);

/// Density at a point of recentred world space, in [0, most]. `inwards`: from there to the space of
/// the body that it is given in; null if that is the world.
float density_at(const MediumView& medium, const Affine3d* inwards, const Vec3d& point);

}  // namespace tessera::render
