#include "worker/shading/surface/medium.h"

#include <algorithm>
#include <cmath>

#include "worker/math/elementary.h"
#include "worker/scene/moved_pose.h"
#include "worker/shading/surface/shading_scene.h"
#include "worker/shading/texture/procedural_texture.h"

namespace tessera::render {
namespace {

/// Trilinear density; zero outside the box.
float grid_density(const DensityGrid& grid, const Vec3d& p) {
  std::array<std::size_t, 3> cell{};
  std::array<float, 3> f{};
  for (int k = 0; k < 3; ++k) {
    const auto axis = static_cast<std::size_t>(k);
    const double low = static_cast<double>(grid.low[k]), high = static_cast<double>(grid.high[k]);
    if (!(p[k] >= low && p[k] <= high)) return 0;
    const double x = (p[k] - low) / (high - low) * (grid.size[axis] - 1);
    const double whole = std::min(std::floor(x), static_cast<double>(grid.size[axis] - 2));
    cell[axis] = static_cast<std::size_t>(whole);
    f[axis] = static_cast<float>(x - whole);
  }
  const auto nx = static_cast<std::size_t>(grid.size[0]),
             ny = static_cast<std::size_t>(grid.size[1]);
  const auto along_x = [&](std::size_t y, std::size_t z) {
    const float* row = grid.values.data() + ((cell[2] + z) * ny + cell[1] + y) * nx + cell[0];
    return lerp(row[0], row[1], f[0]);
  };
  const float near = lerp(along_x(0, 0), along_x(1, 0), f[1]);
  return lerp(near, lerp(along_x(0, 1), along_x(1, 1), f[1]), f[2]);
}

}  // namespace

MediumView view_of_medium(const Scene& scene, const Medium* medium, const Vec3f& absorption) {
  MediumView view;
  view.extinction = absorption;
  if (medium == nullptr) return view;
  view.scattering = medium->scattering;
  view.extinction += medium->absorption + medium->scattering;
  // A large extinction has the effect of an infinite one and keeps products with scattering finite.
  view.extinction = min(view.extinction, Vec3f{1e30f, 1e30f, 1e30f});
  view.emission = medium->emission;
  view.anisotropy = medium->anisotropy;
  view.origin = scene.center;
  if (medium->grid != nullptr) {
    view.grid = medium->grid.get();
    view.max_density = view.typical_density = 0;
    for (const float v : view.grid->values) {
      view.max_density = std::max(view.max_density, v);
      view.typical_density += v / static_cast<float>(view.grid->values.size());
    }
  } else if (medium->procedural != kNone) {
    view.procedural = &scene.procedural_textures[static_cast<std::size_t>(medium->procedural)];
    view.max_density = view.typical_density = 0;
    for (const ProceduralTexture::Stop& stop : view.procedural->ramp) {
      view.max_density = std::max(view.max_density, stop.color.x);
      view.typical_density += stop.color.x / static_cast<float>(view.procedural->ramp.size());
    }
  }
  if (!(view.max_density > 0)) view.extinction = view.scattering = view.emission = {};
  return view;
}

float density_at(const MediumView& medium, const Affine3d* inwards, const Vec3d& point) {
  const Vec3d p = inwards == nullptr ? point + medium.origin : transform_point(*inwards, point);
  if (medium.procedural != nullptr) {
    return clamp(procedural_color(*medium.procedural, p, 0).x, 0.0f, medium.max_density);
  }
  return medium.grid == nullptr ? 1
                                : clamp(grid_density(*medium.grid, p), 0.0f, medium.max_density);
}

std::optional<Affine3d> medium_space(const Scene& scene, const MediumView& medium,
                                     const Instance& instance, float time) {
  const ProceduralTexture* procedural = medium.procedural;
  if (procedural != nullptr && procedural->space == ProceduralTexture::Space::world)
    return std::nullopt;
  const auto pose = pose_of(scene, instance, time);
  return pose ? pose->world_to_object : instance.world_to_object;
}

Vec3f emission_over(const MediumView& medium, float distance) {
  Vec3f radiance;
  for (int k = 0; k < 3; ++k) {
    const float e = medium.emission[k], sigma = medium.extinction[k];
    if (!(e > 0)) continue;  // the distance may be infinite
    radiance[k] = e * (sigma > 0 ? -elementary::expm1(-sigma * distance) / sigma : distance);
  }
  return radiance;
}

float least_extinction(const MediumView& medium) {
  float least = INFINITY;
  for (int k = 0; k < 3; ++k) {
    if (medium.emission[k] > 0) least = std::min(least, medium.extinction[k]);
  }
  return least;
}

}  // namespace tessera::render
