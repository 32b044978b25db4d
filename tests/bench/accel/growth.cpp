#include "tests/bench/accel/growth.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <utility>
#include <vector>

#include "tests/bench/accel/measure.h"
#include "tests/bench/accel/workload/item_buffer.h"
#include "tests/bench/accel/workload/rays.h"
#include "tests/bench/accel/workload/scenes.h"
#include "tests/bench/accel/workload/shapes.h"
#include "worker/accel/reference/brute_force.h"
#include "worker/accel/scene_accel.h"
#include "worker/accel/traversal/thread_counts.h"
#include "worker/render/frame_renderer.h"

namespace tessera::render::bench {
namespace {

constexpr int kRounds = 3;
/// Maximum number of triangle tests in a measurement of brute force.
constexpr std::size_t kBruteTests = 20'000'000;

/// Returns nanoseconds per ray in the best round.
template <typename Trace>
double nanoseconds(std::size_t rays, Trace&& trace) {
  double best = 1e30;
  std::int64_t hits = 0;
  for (int round = 0; round < kRounds; ++round) best = std::min(best, timed(trace, 1, &hits));
  return best / static_cast<double>(rays) * 1e9;
}

/// Selects evenly spaced rays, as many as kBruteTests allows but at least 10.
std::vector<Ray> sample_of(const std::vector<Ray>& rays, std::size_t triangles) {
  const std::size_t count = std::clamp<std::size_t>(kBruteTests / triangles, 10, rays.size());
  std::vector<Ray> sample;
  for (std::size_t i = 0; i < count; ++i) sample.push_back(rays[i * (rays.size() / count)]);
  return sample;
}

std::int64_t brute_hits(const Scene& scene, const std::vector<Ray>& rays) {
  std::int64_t hits = 0;
  for (const Ray& ray : rays) {
    Hit hit;
    hits += brute_force_closest(scene, ray, hit) ? 1 : 0;
  }
  return hits;
}

/// Measures the seconds to refit the BVH to the next frame of an animation that moves every vertex
/// a little.
double refit_seconds(Scene scene, const SceneAccel& before) {
  std::vector<Primitive> primitives(scene.meshes[0].primitives.begin(),
                                    scene.meshes[0].primitives.end());
  Random random(1);
  for (Primitive& p : primitives) {
    std::vector<Vec3f> positions(p.positions.begin(), p.positions.end());
    for (Vec3f& position : positions) position.y += 1e-6f * random.unit();
    p.positions = std::move(positions);
  }
  scene.meshes[0].primitives = std::move(primitives);
  const double start = cpu_seconds();
  const SceneAccel accel(scene, sequential(), best_isa(), &before);
  return cpu_seconds() - start;
}

nlohmann::json against_triangles(bool quick, std::int64_t* wrong) {
  nlohmann::json rows = nlohmann::json::array();
  std::printf("%10s %8s %8s %8s %8s %8s\n", "triangles", "build s", "refit s", "packets", "single",
              "bounce");
  for (const std::uint32_t side : {22u, 71u, 224u, 707u, 2236u}) {
    if (quick && side > 71) break;
    const BenchScene bench = make_terrain(side);
    const double start = cpu_seconds();
    const SceneAccel accel(bench.scene, sequential());
    const double build = cpu_seconds() - start;
    const double refit = refit_seconds(bench.scene, accel);
    const std::vector<RaySet> sets = make_rays(bench, accel, quick ? 32 : 512);
    const std::vector<Ray>&camera = sets[0].rays, &bounce = sets[1].rays;
    *wrong += std::abs(closest_in_packets(accel, camera) - closest_hits(accel, camera)) +
              std::abs(closest_in_packets(accel, bounce) - closest_hits(accel, bounce));
    const double packets =
        nanoseconds(camera.size(), [&] { return closest_in_packets(accel, camera); });
    const double single = nanoseconds(camera.size(), [&] { return closest_hits(accel, camera); });
    const double scattered =
        nanoseconds(bounce.size(), [&] { return closest_hits(accel, bounce); });
    std::printf("%10lld %8.3f %8.3f %8.1f %8.1f %8.1f\n",
                static_cast<long long>(triangle_count(bench.scene)), build, refit, packets, single,
                scattered);
    std::fflush(stdout);
    rows.push_back({{"triangles", triangle_count(bench.scene)},
                    {"build_seconds", build},
                    {"refit_seconds", refit},
                    {"memory_bytes", accel.memory_bytes()},
                    {"camera_packets_ns", packets},
                    {"camera_ns", single},
                    {"bounce_ns", scattered}});
  }
  return rows;
}

/// Side of the image of the z-buffer, whose cost per pixel does not depend on it.
constexpr int kBufferSide = 64;

/// Returns the work of the BVH for the rays.
contract::TraversalCounts count_work(const Scene& scene, const std::vector<Ray>& rays) {
  TraceOptions options;
  options.counted = true;
  const SceneAccel accel(scene, sequential(), options);
  const contract::TraversalCounts before = thread_traversal_counts();
  closest_hits(accel, rays);
  return thread_traversal_counts() - before;
}

nlohmann::json against_depth(bool quick, std::int64_t* wrong) {
  nlohmann::json rows = nlohmann::json::array();
  std::printf("\n%10s %10s %12s %10s %8s %10s %10s\n", "layers", "BVH", "brute force", "z-buffer",
              "nodes", "triangles", "fragments");
  for (const int layers : {1, 10, 100, 1'000, 10'000, 100'000}) {
    if (quick && layers > 100) break;
    const BenchScene bench = make_layers(layers);
    const SceneAccel accel(bench.scene, sequential());
    const std::vector<Ray> rays = make_rays(bench, accel, quick ? 32 : 256)[0].rays;
    const double ours = nanoseconds(rays.size(), [&] { return closest_hits(accel, rays); });
    const std::vector<Ray> sample = sample_of(rays, 2 * static_cast<std::size_t>(layers));
    *wrong += std::abs(closest_hits(accel, sample) - brute_hits(bench.scene, sample));
    const double brute =
        nanoseconds(sample.size(), [&] { return brute_hits(bench.scene, sample); });
    constexpr std::size_t kBufferPixels = std::size_t{kBufferSide} * kBufferSide;
    std::int64_t fragments = 0;
    const double buffer = nanoseconds(
        kBufferPixels, [&] { return fragments = item_buffer(bench, kBufferSide).fragments; });
    const contract::TraversalCounts work = count_work(bench.scene, rays);
    const auto per_ray = [&](std::int64_t count) {
      return static_cast<double>(count) / static_cast<double>(rays.size());
    };
    const double covered = static_cast<double>(fragments) / static_cast<double>(kBufferPixels);
    std::printf("%10d %10.1f %12.1f %10.1f %8.2f %10.2f %10.1f\n", layers, ours, brute, buffer,
                per_ray(work.nodes), per_ray(work.primitives), covered);
    std::fflush(stdout);
    rows.push_back({{"layers", layers},
                    {"hierarchy_ns", ours},
                    {"brute_force_ns", brute},
                    {"z_buffer_ns", buffer},
                    {"nodes_per_ray", per_ray(work.nodes)},
                    {"triangles_per_ray", per_ray(work.primitives)},
                    {"fragments_per_pixel", covered}});
  }
  return rows;
}

}  // namespace

nlohmann::json measure_growth(bool quick, bool depth_only, std::int64_t* wrong) {
  nlohmann::json out;
  if (!depth_only) out["triangles"] = against_triangles(quick, wrong);
  out["depth_complexity"] = against_depth(quick, wrong);
  return out;
}

}  // namespace tessera::render::bench
