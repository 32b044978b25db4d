#pragma once

#include <optional>

#include "worker/math/transform.h"
#include "worker/math/vector.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// A participating medium as paths use it: TESSERA_medium plus the absorption of
/// KHR_materials_volume.
struct MediumView {
  Vec3f scattering, extinction;  // per metre at density 1; extinction includes scattering and may
                                 // be infinite
  Vec3f emission;                // nits per metre at density 1
  float anisotropy = 0;
  const ProceduralTexture* procedural = nullptr;  // density as a procedural texture,
  const DensityGrid* grid = nullptr;              // or as a grid; neither: homogeneous
  float max_density = 1, typical_density = 1;     // upper bound and typical value of the density
  Vec3d origin;                                   // Scene::center

  bool present() const { return max_component(extinction) > 0 || emits(); }
  bool emits() const { return max_component(emission) > 0; }
  bool scatters() const { return max_component(scattering) > 0; }
  bool is_homogeneous() const { return procedural == nullptr && grid == nullptr; }
};

/// View of `medium` of `scene`, which may be null, with `absorption` added.
MediumView view_of_medium(const Scene& scene, const Medium* medium, const Vec3f& absorption);

/// Density at a point of recentred world space, in [0, max_density]. `inwards` maps to the object
/// space of the body that defines the medium; null for world space.
float density_at(const MediumView& medium, const Affine3d* inwards, const Vec3d& point);

/// Map from recentred world space at `time`, in [0, 1] of the exposure, to the space of the density
/// of a medium that `instance` encloses; nullopt for world space.
std::optional<Affine3d> medium_space(const Scene& scene, const MediumView& medium,
                                     const Instance& instance, float time);

/// Radiance that a homogeneous medium emits along a ray over `distance` metres, which may be
/// infinite: emission (1 - exp(-extinction distance)) / extinction.
Vec3f emission_over(const MediumView& medium, float distance);

/// Extinction per metre, at density 1, of the emitting channel that light passes most easily.
/// Requires emits().
float least_extinction(const MediumView& medium);

}  // namespace tessera::render
