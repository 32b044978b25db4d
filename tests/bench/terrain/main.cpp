/// tessera-bench-terrain: measures the cost of rays at a fractal terrain, and cost and error of
/// tessellations of it and of QAEB tracing, for camera rays over mountains and shadow rays towards
/// a low directional light. Fails if one of these does not converge to the terrain, or if omitting
/// detail smaller than a pixel moves hits by more than the angle of a pixel.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <vector>

#include "tests/support/cpu_seconds.h"
#include "tests/support/render/qaeb.h"
#include "tests/support/scene/tessellation.h"
#include "worker/accel/scene_accel.h"
#include "worker/geometry/shapes/make_shape.h"
#include "worker/render/frame_renderer.h"

namespace tessera::render::testing {
namespace {

using tessera::testing::cpu_seconds;

constexpr double kSpot = 0.0011;  // angle of a pixel: 0.6 radians over 540 pixels
constexpr Vec3d kEye = {0, 4, 22};

Shape mountains(bool detail) {
  TerrainForm form;
  form.size = {40, 40};
  form.height = 6;
  form.scale = 0.15;
  form.octaves = 9;
  form.seed = 11;
  form.spot_angle = detail ? kSpot : 0;
  form.seen_from = kEye;
  return make_terrain(form, 0);
}

struct Rays {
  std::vector<Ray> camera, sun;
};

/// Camera rays in rows of the image, and rays towards the light from their hits on the terrain.
Rays rays_of(const SceneAccel& accel, int count) {
  Rays out;
  const int columns = static_cast<int>(std::sqrt(16.0 / 9 * count)), rows = count / columns;
  for (int i = 0; i < columns * rows; ++i) {
    Ray ray;
    ray.origin = Vec3f(kEye);
    const int row = i / columns, column = i % columns;
    ray.direction = Vec3f(normalize(Vec3d{1.06 * ((column + 0.5) / columns - 0.5),
                                          0.6 * (0.5 - (row + 0.5) / rows) - 0.12, -1}));
    out.camera.push_back(ray);
    Hit hit;
    if (!accel.closest_hit(ray, hit)) continue;
    Ray on;
    on.origin = ray.origin + ray.direction * (hit.t * 0.9999f);
    on.direction = {-0.8f, 0.35f, 0.3f};
    out.sun.push_back(on);
  }
  return out;
}

struct Cost {
  double camera = 0, sun = 0;  // microseconds per ray
  std::vector<float> depths;
  std::vector<char> lit;
};

Cost cost_of(const SceneAccel& accel, const Rays& rays) {
  Cost out;
  const double start = cpu_seconds();
  for (const Ray& ray : rays.camera) {
    Hit hit;
    out.depths.push_back(accel.closest_hit(ray, hit) ? hit.t : -1);
  }
  const double middle = cpu_seconds();
  for (const Ray& ray : rays.sun) out.lit.push_back(accel.any_hit(ray) ? 0 : 1);
  out.camera = 1e6 * (middle - start) / static_cast<double>(rays.camera.size());
  out.sun = 1e6 * (cpu_seconds() - middle) / static_cast<double>(rays.sun.size());
  return out;
}

Scene scene_with(Mesh mesh) {
  Scene scene;
  scene.meshes.push_back(std::move(mesh));
  Instance instance;
  instance.mesh = 0;
  scene.instances.push_back(instance);
  return scene;
}

Scene scene_of(const Shape& shape) {
  Mesh mesh;
  mesh.primitives = {Primitive{}};
  mesh.shape = std::make_shared<const Shape>(shape);
  return scene_with(std::move(mesh));
}

struct Difference {
  double depth = 0;  // relative, mean over the rays that hit both
  double edge = 0;   // share of the rays that hit one of the two
};

Difference print(const char* name, std::uint64_t triangles, double build, const Cost& cost,
                 const Cost& exact) {
  double depth = 0;
  std::size_t both = 0, edge = 0, light = 0;
  for (std::size_t i = 0; i < cost.depths.size(); ++i) {
    const float a = cost.depths[i], b = exact.depths[i];
    if (a < 0 || b < 0) {
      edge += a < 0 && b < 0 ? 0 : 1;
      continue;
    }
    ++both;
    depth += std::fabs(double{a} - double{b}) / double{b};
  }
  for (std::size_t i = 0; i < cost.lit.size(); ++i) light += cost.lit[i] != exact.lit[i] ? 1 : 0;
  const Difference found = {depth / static_cast<double>(std::max<std::size_t>(both, 1)),
                            static_cast<double>(edge) / static_cast<double>(cost.depths.size())};
  std::printf("%-16s %10llu %8.2f %10.2f %10.2f %11.5f %8.4f %8.4f\n", name,
              static_cast<unsigned long long>(triangles), build, cost.camera, cost.sun, found.depth,
              found.edge, static_cast<double>(light) / static_cast<double>(cost.lit.size()));
  return found;
}

/// Prints rows for QAEB tracing with steps of several pixels, of one and of less.
std::vector<Difference> print_qaeb(const Shape& terrain, const Rays& rays, const Cost& exact) {
  std::vector<Difference> coarse_to_fine;
  for (const double pixels : {4.0, 1.0, 0.25}) {
    const SceneAccel accel(std::make_unique<const tessera::testing::QaebTerrain>(
        scene_of(terrain), kEye, pixels * kSpot, 1));
    char name[32];
    std::snprintf(name, sizeof name, "QAEB, %g px", pixels);
    coarse_to_fine.push_back(print(name, 0, 0, cost_of(accel, rays), exact));
  }
  return coarse_to_fine;
}

/// Returns exit code 1 if the errors are implausible. The error of a tessellation falls with the
/// square of the cell size, by 64 over three halvings, if cells are smaller than the features; the
/// limits of a quarter and a half leave room for octaves that coarse cells miss. The error of QAEB
/// tracing is a small part of its step, of several pixels and then of one.
int check(const Difference& detail, const std::vector<Difference>& coarse_to_fine,
          const std::vector<Difference>& qaeb) {
  const Difference &coarse = coarse_to_fine.front(), &fine = coarse_to_fine.back();
  int status = 0;
  if (!(qaeb[1].depth < kSpot / 4 && qaeb[1].depth < qaeb[0].depth / 2)) {
    std::printf("FAILED: QAEB tracing does not converge to the terrain\n");
    status = 1;
  }
  if (!(detail.depth < kSpot)) {
    std::printf("FAILED: detail below a pixel moves hits by more than a pixel's angle\n");
    status = 1;
  }
  if (!(fine.depth < coarse.depth / 4 && fine.edge < coarse.edge / 2)) {
    std::printf("FAILED: tessellations do not converge to the terrain\n");
    status = 1;
  }
  return status;
}

int run(int argc, char** argv) {
  int count = 40'000;
  std::uint32_t finest = 2048;
  CLI::App app("Terrain against tessellations");
  app.add_option("--rays", count, "Camera rays")->check(CLI::Range(100, 10'000'000));
  app.add_option("--finest", finest, "Cells a side of the finest")->check(CLI::Range(64, 8192));
  CLI11_PARSE(app, argc, argv);
  const ParallelFor parallel = sequential();
  std::printf("%-16s %10s %8s %10s %10s %11s %8s %8s\n", "terrain", "triangles", "build/s",
              "camera/us", "sun/us", "depth off", "edge", "shadow");
  double start = cpu_seconds();
  const Shape band_limited = mountains(true);
  const SceneAccel accel(scene_of(band_limited), parallel);
  const double build = cpu_seconds() - start;
  const Rays rays = rays_of(accel, count);
  const Cost exact = cost_of(accel, rays);
  print("detail as seen", 0, build, exact, exact);
  start = cpu_seconds();
  const SceneAccel whole(scene_of(mountains(false)), parallel);
  const Difference detail =
      print("all detail", 0, cpu_seconds() - start, cost_of(whole, rays), exact);
  const std::vector<Difference> qaeb = print_qaeb(band_limited, rays, exact);
  std::vector<Difference> coarse_to_fine;
  for (std::uint32_t n = finest / 8; n <= finest; n *= 2) {
    start = cpu_seconds();
    Mesh mesh;
    mesh.primitives = {tessera::testing::tessellated(band_limited, n)};
    const SceneAccel triangles(scene_with(std::move(mesh)), parallel);
    char name[32];
    std::snprintf(name, sizeof name, "%u x %u", n, n);
    coarse_to_fine.push_back(print(name, std::uint64_t{2} * n * n, cpu_seconds() - start,
                                   cost_of(triangles, rays), exact));
  }
  return check(detail, coarse_to_fine, qaeb);
}

}  // namespace
}  // namespace tessera::render::testing

int main(int argc, char** argv) {
  return tessera::render::testing::run(argc, argv);
}
