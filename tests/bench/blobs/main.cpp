/// tessera-bench-blobs: measures the cost of rays through blobs: camera rays up to the first hit,
/// shadow rays from there, and all hits of a line, as CSG needs them, compared with the plain
/// search of all intervals. Fails if the plain search finds another number of hits.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include "tests/support/cpu_seconds.h"
#include "worker/geometry/shapes/blobs/blob_line.h"
#include "worker/geometry/shapes/intersect_shape.h"
#include "worker/geometry/shapes/make_shape.h"
#include "worker/geometry/shapes/shape_surface.h"

namespace tessera::render::testing {
namespace {

using tessera::testing::cpu_seconds;

/// Uniform in [low, high); the same numbers with every standard library.
class Numbers {
 public:
  double between(double low, double high) {
    return low + (high - low) * 0x1p-32 * static_cast<double>(engine_());
  }
  Vec3d in_cube(double half) {
    const double x = between(-half, half), y = between(-half, half);
    return {x, y, between(-half, half)};
  }

 private:
  std::mt19937 engine_{1};
};

struct Blobs {
  std::string name;
  std::vector<Blob> blobs;
  double threshold = 0.25;
};

/// All blobs overlap, within a ball of radius about 1.
Blobs dense(std::size_t count) {
  Numbers numbers;
  Blobs out = {"dense", std::vector<Blob>(count), static_cast<double>(count) / 16};
  for (Blob& blob : out.blobs) blob = {numbers.in_cube(0.3), {1, 1, 1}, 1};
  return out;
}

/// Like dense(), but every third blob is negative.
Blobs mixed_signs(std::size_t count) {
  Blobs out = dense(count);
  out.name = "mixed signs";
  out.threshold = static_cast<double>(count) / 64;
  for (std::size_t i = 0; i < count; i += 3) out.blobs[i].strength = -1;
  return out;
}

/// Radii over three orders of magnitude.
Blobs unequal(std::size_t count) {
  Numbers numbers;
  Blobs out = {"unequal radii", std::vector<Blob>(count)};
  for (Blob& blob : out.blobs) {
    blob.centre = numbers.in_cube(1);
    const double size = std::exp2(numbers.between(-10, 0));
    blob.radii = {size, size * numbers.between(0.5, 1), size};
  }
  return out;
}

/// A point of the cube is in about 8 blobs.
Blobs sparse(std::size_t count) {
  Numbers numbers;
  Blobs out = {"sparse", std::vector<Blob>(count)};
  const double radius = std::cbrt(16.0 / static_cast<double>(count));
  for (Blob& blob : out.blobs) {
    blob = {numbers.in_cube(1), Vec3d{radius, radius, radius} * numbers.between(0.5, 1.2), 0.3};
  }
  return out;
}

/// Twenty dense clusters.
Blobs clustered(std::size_t count) {
  Numbers numbers;
  std::vector<Vec3d> clusters(20);
  for (Vec3d& cluster : clusters) cluster = numbers.in_cube(1);
  Blobs out = {"clustered", std::vector<Blob>(count), static_cast<double>(count) / 320};
  for (std::size_t i = 0; i < count; ++i) {
    const double radius = numbers.between(0.1, 0.2);
    out.blobs[i] = {clusters[i % 20] + numbers.in_cube(0.05), {radius, radius, radius}, 1};
  }
  return out;
}

struct Line {
  Vec3d origin, direction;
};

/// Camera rays over the shape's bounds, in rows.
std::vector<Line> camera_rays(const Shape& shape, int count) {
  const Vec3d low(shape.bounds.lo), high(shape.bounds.hi), centre = (low + high) * 0.5;
  const double size = max_abs(high - low) * 0.5;
  const int rows = static_cast<int>(std::sqrt(count));
  std::vector<Line> out;
  for (int i = 0; i < rows * rows; ++i) {
    const double x = (2.0 * (i % rows) + 1) / rows - 1, y = (2.0 * (i / rows) + 1) / rows - 1;
    const Vec3d eye = centre + Vec3d{0.4, 0.7, 4} * size;
    out.push_back({eye, centre + Vec3d{x, y, 0} * size - eye});
  }
  return out;
}

struct Cost {
  double camera = 0, shadow = 0, all = 0, plain = 0;  // microseconds per ray
  std::size_t hits = 0, other_hits = 0;
};

double micros(double seconds, std::size_t rays) {
  return 1e6 * seconds / static_cast<double>(std::max<std::size_t>(rays, 1));
}

Cost cost_of(const Shape& shape, const std::vector<Line>& rays, std::size_t plain_rays) {
  Cost out;
  std::vector<ShapeHit> hits, plain;
  std::vector<Line> shadow;
  double start = cpu_seconds();
  for (const Line& ray : rays) {
    hits.clear();
    intersect_shape(shape, ray.origin, ray.direction, hits, {0, 1e9, true});
    if (hits.empty()) continue;
    const Vec3d normal = shape_normal(shape, kCurvedFace, hits.back().point);
    shadow.push_back({hits.back().point + normal * (1e-6 / length(normal)), {0.5, 1, 0.3}});
  }
  out.camera = micros(cpu_seconds() - start, rays.size());
  start = cpu_seconds();
  for (const Line& ray : shadow) {
    hits.clear();
    intersect_shape(shape, ray.origin, ray.direction, hits, {0, 1e9, true});
  }
  out.shadow = micros(cpu_seconds() - start, shadow.size());
  start = cpu_seconds();
  for (const Line& ray : rays) {
    hits.clear();
    intersect_shape(shape, ray.origin, ray.direction, hits);
    out.hits += hits.size();
  }
  out.all = micros(cpu_seconds() - start, rays.size());
  BlobLine line;
  double plain_seconds = 0;
  const std::size_t step = std::max<std::size_t>(rays.size() / plain_rays, 1);
  for (std::size_t i = step / 2; i < rays.size(); i += step) {
    hits.clear();
    plain.clear();
    intersect_shape(shape, rays[i].origin, rays[i].direction, hits);
    start = cpu_seconds();
    line.intersect_plain(*shape.blobs, rays[i].origin, rays[i].direction, plain);
    plain_seconds += cpu_seconds() - start;
    out.other_hits += hits.size() != plain.size() ? 1 : 0;
  }
  out.plain = micros(plain_seconds, (rays.size() - step / 2 + step - 1) / step);
  return out;
}

int run(int argc, char** argv) {
  int count = 10'000;
  std::size_t plain_rays = 4, most = 10'000;
  CLI::App app("Rays through blobs");
  app.add_option("--rays", count, "Camera rays")->check(CLI::Range(100, 10'000'000));
  app.add_option("--plain-rays", plain_rays, "Rays of the plain search")
      ->check(CLI::Range(1, 10'000));
  app.add_option("--most", most, "Blobs at most")->check(CLI::Range(1, 100'000));
  CLI11_PARSE(app, argc, argv);
  std::printf("%-14s %6s %8s %10s %10s %10s %12s %9s\n", "blobs", "count", "build/s", "camera/us",
              "shadow/us", "all/us", "plain/us", "hits/line");
  int status = 0;
  for (Blobs (*make)(std::size_t) : {dense, mixed_signs, unequal, sparse, clustered}) {
    for (const std::size_t size : {1u, 5u, 16u, 20u, 400u, 1'600u, 10'000u}) {
      if (size > most) break;
      const Blobs blobs = make(size);
      const double start = cpu_seconds();
      const Shape shape = make_blobs(blobs.blobs, blobs.threshold);
      const double build = cpu_seconds() - start;
      const std::vector<Line> rays = camera_rays(shape, count);
      const Cost cost = cost_of(shape, rays, plain_rays);
      std::printf("%-14s %6zu %8.3f %10.2f %10.2f %10.2f %12.1f %9.2f\n", blobs.name.c_str(), size,
                  build, cost.camera, cost.shadow, cost.all, cost.plain,
                  static_cast<double>(cost.hits) / static_cast<double>(rays.size()));
      std::fflush(stdout);
      if (cost.other_hits == 0) continue;
      std::printf("FAILED: %zu rays hit otherwise than in the plain search\n", cost.other_hits);
      status = 1;
    }
  }
  return status;
}

}  // namespace
}  // namespace tessera::render::testing

int main(int argc, char** argv) {
  return tessera::render::testing::run(argc, argv);
}
