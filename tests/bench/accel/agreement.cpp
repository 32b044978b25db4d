#include "tests/bench/accel/agreement.h"

#include <algorithm>
#include <array>
#include <bit>
#include <memory>
#include <utility>
#include <vector>

#include "tests/bench/accel/workload/shapes.h"
#include "worker/accel/reference/brute_force.h"
#include "worker/accel/scene_accel.h"
#include "worker/accelerators/structure_accelerator.h"
#include "worker/render/frame_renderer.h"

namespace tessera::render::bench {
namespace {

/// Generates random and degenerate rays for a scene.
class RayMaker {
 public:
  explicit RayMaker(const Scene& scene) : scene_(scene), random_(99) {
    for (int i = 0; i < 64; ++i) bounds_.extend(surface_point(i % 2 == 0));
  }

  Ray next() {
    const Vec3f size = bounds_.hi - bounds_.lo;
    Ray ray;
    ray.origin = bounds_.lo + Vec3f{unit(), unit(), unit()} * size;
    ray.direction = random_.direction();
    const std::uint32_t kind = below(9);
    if (kind < 3) return ray;
    const Vec3f target = surface_point(kind % 2 == 0), other = surface_point(true);
    if (kind == 5) ray.origin = other;                             // between two surface points
    if (kind == 6) ray.origin = target - (other - target) * 4.0f;  // along a chord
    ray.direction = target - ray.origin;
    if (kind >= 7) {  // in a plane of boxes: one or two zero components through a vertex
      const auto axis = static_cast<int>(below(3));
      flatten(ray, target, axis);
      if (kind == 8) flatten(ray, target, (axis + 1) % 3);
    }
    if (below(8) == 0) ray.t_max = 2 * unit();
    return ray;
  }

 private:
  float unit() { return random_.unit(); }
  std::uint32_t below(std::uint32_t n) {
    return static_cast<std::uint32_t>(unit() * static_cast<float>(n));
  }
  static void flatten(Ray& ray, const Vec3f& target, int axis) {
    ray.origin[axis] = target[axis];
    ray.direction[axis] = 0;
  }

  /// A vertex or a point on an edge, in world space.
  Vec3f surface_point(bool edge) {
    const auto& instances = scene_.instances;
    const Instance& instance = instances[below(static_cast<std::uint32_t>(instances.size()))];
    const auto& primitives = scene_.meshes[static_cast<std::size_t>(instance.mesh)].primitives;
    const Primitive& p = primitives[below(static_cast<std::uint32_t>(primitives.size()))];
    const auto& triangle = p.triangles[below(static_cast<std::uint32_t>(p.triangles.size()))];
    const std::uint32_t corner = below(3);
    const Vec3f& a = p.positions[triangle[corner]];
    const Vec3f& b = p.positions[triangle[(corner + 1) % 3]];
    const float along = edge ? unit() : 0;
    return Vec3f(transform_point(instance.object_to_world, Vec3d(a + (b - a) * along)));
  }

  const Scene& scene_;
  Random random_;
  Box3f bounds_;
};

bool same_bits(const Hit& a, const Hit& b) {
  const auto same = [](float x, float y) {
    return std::bit_cast<std::uint32_t>(x) == std::bit_cast<std::uint32_t>(y);
  };
  return same(a.t, b.t) && a.id == b.id && same(a.b0, b.b0) && same(a.b1, b.b1) && same(a.b2, b.b2);
}

/// Rays that are traced in one packet, and the results of every structure.
struct Packets {
  struct Result {
    std::uint64_t found, any;
    std::array<Hit, kPacketSize> hits;
  };
  std::vector<const SceneAccel*> accels;  // those with takes_packets()
  std::vector<Ray> rays;
  std::vector<Result> results;
  bool bundle = false;

  explicit Packets(const std::vector<std::unique_ptr<SceneAccel>>& all) {
    for (const auto& accel : all) {
      if (accel->takes_packets()) accels.push_back(accel.get());
    }
    results.resize(accels.size());
  }

  /// Traces the next `count` rays. Every other packet consists of bundles of eight similar rays.
  void trace(RayMaker& maker, std::size_t count) {
    bundle = !bundle;
    rays.clear();
    for (std::size_t i = 0; i < count; ++i) {
      rays.push_back(maker.next());
      if (bundle && i % 8 != 0) {
        const Vec3f off = rays[i].direction;
        rays[i] = rays[i - 1];
        rays[i].direction += off * 0.01f;
      }
    }
    for (std::size_t a = 0; a < accels.size(); ++a) {
      results[a].found = accels[a]->closest_hits(rays, results[a].hits.data());
      results[a].any = accels[a]->any_hits(rays);
    }
  }

  bool agrees(std::size_t i, bool found, const Hit& hit) const {
    return std::all_of(results.begin(), results.end(), [&](const Result& result) {
      return (result.found >> i & 1) == (found ? 1u : 0u) &&
             (result.any >> i & 1) == (found ? 1u : 0u) &&
             (!found || same_bits(result.hits[i], hit));
    });
  }
};

Scene with_duplicates(Scene scene) {
  for (Mesh& mesh : scene.meshes) {
    std::vector<Primitive> primitives(mesh.primitives.begin(), mesh.primitives.end());
    for (Primitive& p : primitives) {
      std::vector<std::array<std::uint32_t, 3>> triangles(p.triangles.begin(), p.triangles.end());
      for (std::size_t t = 0; t < p.triangles.size(); t += 16) triangles.push_back(triangles[t]);
      p.triangles = std::move(triangles);
    }
    mesh.primitives = std::move(primitives);
  }
  return scene;
}

/// Builds the production BVH for each supported instruction set and, with `references`, the
/// structures of worker/accelerators.
std::vector<std::unique_ptr<SceneAccel>> structures_of(const Scene& scene, bool references) {
  std::vector<std::unique_ptr<SceneAccel>> all;
  for (const Isa isa : {Isa::avx2, Isa::avx512}) {
    if (is_supported(isa)) all.push_back(std::make_unique<SceneAccel>(scene, sequential(), isa));
  }
  if (!references) return all;
  for (const accelerators::Structure& structure : accelerators::structures()) {
    if (structure.build == accelerators::build_brute_force)
      continue;  // compared for the first rays only
    all.push_back(std::make_unique<SceneAccel>(
        std::make_unique<accelerators::StructureAccelerator>(scene, structure)));
  }
  return all;
}

}  // namespace

Agreement compare_structures(const BenchScene& bench, const AgreementPlan& plan) {
  const Scene scene = with_duplicates(bench.scene);
  const auto accels = structures_of(scene, plan.references);
  RayMaker maker(scene);
  Agreement out;
  out.structures = static_cast<std::int64_t>(accels.size());
  out.rays = plan.rays;
  out.brute_rays = plan.brute_rays;
  Packets packets(accels);
  for (std::int64_t i = 0; i < plan.rays; ++i) {
    const std::size_t place = static_cast<std::size_t>(i) % kPacketSize;
    if (place == 0) {
      packets.trace(maker,
                    static_cast<std::size_t>(std::min<std::int64_t>(kPacketSize, plan.rays - i)));
    }
    const Ray& ray = packets.rays[place];
    Hit first;
    const bool found = accels[0]->closest_hit(ray, first);
    bool agree = packets.agrees(place, found, first);
    for (const auto& accel : accels) {
      Hit hit;
      agree = agree && accel->closest_hit(ray, hit) == found && (!found || same_bits(hit, first)) &&
              accel->any_hit(ray) == found;
    }
    if (i < plan.brute_rays) {
      Hit hit;
      agree = agree && brute_force_closest(scene, ray, hit) == found &&
              (!found || same_bits(hit, first));
    }
    out.hits += found ? 1 : 0;
    out.wrong += agree ? 0 : 1;
  }
  return out;
}

}  // namespace tessera::render::bench
