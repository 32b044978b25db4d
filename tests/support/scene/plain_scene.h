#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "contract/film_block.h"
#include "contract/pass_schedule.h"
#include "contract/render_settings.h"
#include "worker/render/frame_renderer.h"
#include "worker/scene/scene.h"

namespace tessera::testing {

/// A scene with only glTF's default material and a camera at (0, 0, 5) looking down -z, yfov 40
/// degrees.
render::Scene empty_scene();

/// Appends a material and returns its index. The default material stays at index 0.
std::int32_t add_material(render::Scene* scene, const render::Material& material);

/// A Lambert material: no specular layer.
render::Material lambert(const render::Vec3f& albedo);
/// Black, emitting this radiance.
render::Material lamp(float radiance);
/// A white metal of the given roughness.
render::Material metal(float roughness);
/// Smooth solid glass without tint.
render::Material glass(float ior);

/// Appends one primitive as a mesh of its own, placed by `placement`; returns the instance.
std::int32_t add_primitive(render::Scene* scene, render::Primitive primitive,
                           const render::Affine3d& placement = {});

/// The parallelogram origin + s a + t b, front side towards a x b, uv (s, t).
render::Primitive quad(const render::Vec3f& origin, const render::Vec3f& a, const render::Vec3f& b,
                       std::int32_t material);

/// A UV sphere with smooth normals, front side out. Vertices lie on the sphere.
render::Primitive sphere(const render::Vec3f& center, float radius, int segments,
                         std::int32_t material);

/// An axis-aligned box seen from inside (`inward`) or outside.
render::Primitive box(const render::Vec3f& low, const render::Vec3f& high, bool inward,
                      std::int32_t material);

/// Puts the camera at `eye`, looking at `target`, +y up.
void look_at(render::Scene* scene, const render::Vec3d& eye, const render::Vec3d& target);

/// A sky of one radiance.
void set_constant_sky(render::Scene* scene, float radiance);

/// Sets a map of float RGB texels as the scene's sky.
void set_sky(render::Scene* scene, std::int32_t width, std::int32_t height,
             const std::vector<float>& rgb);

render::Affine3d translation(double x, double y, double z);
render::Affine3d scaling(double x, double y, double z);

/// Means per pixel of a whole render.
struct Picture {
  std::int32_t width = 0, height = 0;
  std::vector<double> rgb;  // [pixel][channel]
  std::vector<double> alpha;
  std::vector<double> error;                // standard error of each rgb, from the replicates
  std::vector<contract::FilmBlock> blocks;  // of the passes

  render::Vec3d at(std::int32_t x, std::int32_t y) const;
  /// Mean over all pixels and channels.
  double mean() const;
  /// Standard error of mean().
  double mean_error() const;
};

/// Renders all passes of `settings.spp` in one tile, on this thread.
Picture render_picture(render::Scene scene, const contract::RenderSettings& settings,
                       const render::TraceOptions& tracing = {});

/// Sum of the squared relative differences between pictures of different seeds, over four pairs:
/// few samples that find a small lamp decide the difference of one pair.
double noise_between_seeds(const render::Scene& scene, contract::RenderSettings settings);

/// Largest difference of the means over 4 x 4 pixels of two pictures of one size, in standard
/// errors: for pictures of at most 40 x 32 that have the same expectation, 4.5 is exceeded once in
/// two thousand times.
double largest_difference(const Picture& a, const Picture& b);

/// Small settings: size, samples, no sky options.
contract::RenderSettings small_settings(std::int32_t width, std::int32_t height, std::int32_t spp);

}  // namespace tessera::testing
