#include "tests/bench/accel/workload/rays.h"

#include <algorithm>
#include <cmath>

#include "tests/bench/accel/workload/shapes.h"

namespace tessera::render::bench {
namespace {

/// A point just off a surface, on the side from which the ray came.
struct Start {
  Vec3f origin, normal;
};

std::vector<Ray> camera_rays(const BenchScene& scene, int side, Random& random) {
  const View view(scene);
  std::vector<Ray> rays;
  for (const contract::GridPoint at : contract::hilbert_curve(side, side)) {
    const float x = (static_cast<float>(at.x) + random.unit()) / static_cast<float>(side);
    const float y = (static_cast<float>(at.y) + random.unit()) / static_cast<float>(side);
    rays.push_back(view.ray(x, y));
  }
  return rays;
}

std::vector<Start> starts(const BenchScene& bench, const SceneAccel& accel,
                          const std::vector<Ray>& rays) {
  std::vector<Start> out;
  for (const Ray& ray : rays) {
    Hit hit;
    if (!accel.closest_hit(ray, hit)) continue;
    const Instance& instance = bench.scene.instances[hit.id.instance];
    const Primitive& p =
        bench.scene.meshes[static_cast<std::size_t>(instance.mesh)].primitives[hit.id.primitive];
    const auto& triangle = p.triangles[hit.id.triangle];
    const auto corner = [&](std::size_t i) {
      return transform_point(instance.object_to_world, Vec3d(p.positions[triangle[i]]));
    };
    const Vec3d a = corner(0);
    Vec3f normal(normalize(cross(corner(1) - a, corner(2) - a)));
    if (dot(normal, ray.direction) > 0) normal = -normal;
    const Vec3f point = ray.origin + ray.direction * hit.t;
    // As in a renderer, the offset exceeds the rounding error of the hit, which depends on the size
    // of the triangle's coordinates.
    const double reach = std::max({max_abs(a), max_abs(corner(1)), max_abs(corner(2))});
    const float offset = 1e-4f * bench.scale + 1e-6f * static_cast<float>(reach);
    out.push_back({point + normal * offset, normal});
  }
  return out;
}

std::vector<Ray> bounce_rays(const std::vector<Start>& from, Random& random) {
  std::vector<Ray> rays;
  for (const Start& start : from) {
    const Vec3f sum = start.normal + random.direction() * 0.999f;
    Ray ray;
    ray.origin = start.origin;
    ray.direction = normalize(sum);
    rays.push_back(ray);
  }
  return rays;
}

std::vector<Ray> shadow_rays(const BenchScene& scene, const std::vector<Start>& from,
                             Random& random) {
  std::vector<Ray> rays;
  for (const Start& start : from) {
    const float u = random.unit(), v = random.unit();
    const Vec3f to = scene.light + scene.light_u * u + scene.light_v * v - start.origin;
    if (dot(to, start.normal) <= 0) continue;
    Ray ray;
    ray.origin = start.origin;
    ray.direction = to;
    ray.t_max = 0.999f;
    rays.push_back(ray);
  }
  return rays;
}

}  // namespace

View::View(const BenchScene& scene)
    : eye(scene.eye),
      forward(normalize(scene.target - scene.eye)),
      right(normalize(cross(forward, Vec3f{0, 1, 0}))),
      up(cross(right, forward)),
      half(std::tan(scene.yfov / 2)) {}

Ray View::ray(float x, float y) const {
  Ray out;
  out.origin = eye;
  out.direction = normalize(forward + right * (half * (2 * x - 1)) + up * (half * (1 - 2 * y)));
  return out;
}

std::vector<Ray> centre_rays(const BenchScene& scene, int side,
                             const std::vector<contract::GridPoint>& order) {
  const View view(scene);
  std::vector<Ray> rays;
  rays.reserve(order.size());
  for (const contract::GridPoint at : order) {
    rays.push_back(view.ray((static_cast<float>(at.x) + 0.5f) / static_cast<float>(side),
                            (static_cast<float>(at.y) + 0.5f) / static_cast<float>(side)));
  }
  return rays;
}

std::vector<RaySet> make_rays(const BenchScene& scene, const SceneAccel& accel, int side) {
  Random random(1);
  std::vector<RaySet> sets(5);
  sets[0] = {"camera", false, true, camera_rays(scene, side, random)};
  const std::vector<Start> first = starts(scene, accel, sets[0].rays);
  sets[1] = {"bounce1", false, false, bounce_rays(first, random)};
  const std::vector<Start> second = starts(scene, accel, sets[1].rays);
  sets[2] = {"bounce2", false, false, bounce_rays(second, random)};
  sets[3] = {"shadow1", true, false, shadow_rays(scene, first, random)};
  sets[4] = {"shadow2", true, false, shadow_rays(scene, second, random)};
  return sets;
}

}  // namespace tessera::render::bench
