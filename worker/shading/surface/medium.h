#pragma once

#include "worker/math/transform.h"
#include "worker/math/vector.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// A participating medium as paths use it: TESSERA_medium plus the absorption of
/// KHR_materials_volume.
struct MediumView {
  Vec3f scattering, extinction;  // per metre at density 1; extinction includes scattering and may
                                 // be infinite
  float anisotropy = 0;
  const ProceduralTexture* procedural = nullptr;  // density as a procedural texture,
  const DensityGrid* grid = nullptr;              // or as a grid; neither: homogeneous
  float max_density = 1, typical_density = 1;     // upper bound and typical value of the density
  Vec3d origin;                                   // Scene::center

  bool present() const { return max_component(extinction) > 0; }
  bool scatters() const { return max_component(scattering) > 0; }
  bool is_homogeneous() const { return procedural == nullptr && grid == nullptr; }
};

/// View of `medium` of `scene`, which may be null, with `absorption` added.
MediumView view_of_medium(const Scene& scene, const Medium* medium, const Vec3f& absorption);

/// Density at a point of recentred world space, in [0, max_density]. `inwards` maps to the object
/// space of the body that defines the medium; null for world space.
float density_at(const MediumView& medium, const Affine3d* inwards, const Vec3d& point);

}  // namespace tessera::render
