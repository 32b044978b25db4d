#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <memory>
#include <utility>

#include "tests/support/scene/plain_scene.h"
#include "worker/geometry/shape.h"

namespace tessera::testing {

inline render::Medium medium(const render::Vec3f& absorption, const render::Vec3f& scattering = {},
                             float anisotropy = 0) {
  render::Medium m;
  m.absorption = absorption;
  m.scattering = scattering;
  m.anisotropy = anisotropy;
  return m;
}

/// An invisible boundary of a medium.
inline render::Material boundary(const render::Medium& with) {
  render::Material m = lambert({0.5f, 0.5f, 0.5f});
  m.medium = with;
  return m;
}

inline render::Material lamp(float radiance) {
  render::Material m = lambert({0, 0, 0});
  m.emission = {radiance, radiance, radiance};
  return m;
}

/// A camera at `eye` that sees a tiny spot at `target`.
inline render::Scene spot(const render::Vec3d& eye, const render::Vec3d& target) {
  render::Scene scene = empty_scene();
  look_at(&scene, eye, target);
  scene.camera.yfov = 1e-6;
  return scene;
}

/// A slab across the z axis, 100 m wide.
inline void add_slab(render::Scene* scene, float low, float high,
                     const render::Material& material) {
  const auto index = add_material(scene, material);
  add_primitive(scene, box({-50, -50, low}, {50, 50, high}, false, index));
}

inline Picture middle(render::Scene scene, int spp, int max_depth, int width = 4) {
  auto settings = small_settings(width, width, spp);
  settings.max_depth = max_depth;
  return render_picture(std::move(scene), settings);
}

/// Mean over all pixels of one channel, with its standard error.
struct Estimate {
  double mean = 0, error = 0;
};
inline Estimate channel(const Picture& picture, std::size_t c) {
  Estimate e;
  const auto pixels = static_cast<double>(picture.alpha.size());
  for (std::size_t i = c; i < picture.rgb.size(); i += 3) {
    e.mean += picture.rgb[i] / pixels;
    e.error += picture.error[i] * picture.error[i];
  }
  e.error = std::sqrt(e.error) / pixels;
  return e;
}

/// Checks that every channel has the mean `radiance`, with a standard error below `largest_error`.
inline void expect_uniform(const Picture& picture, double radiance, double largest_error) {
  for (std::size_t k = 0; k < 3; ++k) {
    const Estimate got = channel(picture, k);
    EXPECT_NEAR(got.mean, radiance, 4 * got.error + 1e-5) << k;
    EXPECT_LT(got.error, largest_error) << k;
  }
}

}  // namespace tessera::testing
