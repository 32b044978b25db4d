#include "worker/render/spots/searched_lights.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <optional>

#include "worker/geometry/bounds.h"
#include "worker/light/emitters/emissive_power.h"
#include "worker/light/emitters/shape_light.h"
#include "worker/math/elementary.h"
#include "worker/math/transform.h"

namespace tessera::render {
namespace {

constexpr std::size_t kMaxLights = 256;
/// Corners of a light, at most.
constexpr std::size_t kMaxCorners = 64;

/// Sums over the triangles of a light.
struct Component {
  double area = 0, power = 0;  // square metres; radiance times area
  Vec3d origin;                // a point of the light, to which moments are relative
  Vec3d moment;                // area times position
  std::array<Vec3d, 3> second{};
  Box3d box;

  void add(std::array<Vec3d, 3> corners, double radiance) {
    if (box.empty()) origin = corners[0];
    for (const Vec3d& v : corners) box.extend(v);
    for (Vec3d& v : corners) v = v - origin;
    const Vec3d centre = (corners[0] + corners[1] + corners[2]) / 3.0;
    const double part = length(cross(corners[1] - corners[0], corners[2] - corners[0])) / 2;
    area += part;
    power += part * radiance;
    moment += centre * part;
    // The mean of p p' over a triangle is (Σ v v' + 9 c c') / 12.
    for (int k = 0; k < 3; ++k) {
      Vec3d row = centre * (9 * centre[k]);
      for (const Vec3d& v : corners) row += v * v[k];
      second[static_cast<std::size_t>(k)] += row * (part / 12);
    }
  }

  SearchedLight light() const {
    SearchedLight light;
    const Vec3d mean = moment / area;
    light.centre = origin + mean;
    light.radiance = power / area;
    light.radius = length(box.hi - box.lo) / 2;
    for (int k = 0; k < 3; ++k) {
      const auto i = static_cast<std::size_t>(k);
      light.covariance[i] = second[i] / area - mean * mean[k];
    }
    return light;
  }
};

/// The points that are furthest out in one of kMaxCorners directions; all of them if they are few.
std::vector<Vec3d> outermost(const std::vector<Vec3d>& points) {
  if (points.size() <= kMaxCorners) return points;
  std::vector<std::size_t> chosen;
  for (std::size_t k = 0; k < kMaxCorners; ++k) {
    // Directions on a spiral with equal steps of height and the golden angle between them.
    const float z = 1 - (2 * static_cast<float>(k) + 1) / kMaxCorners, r = std::sqrt(1 - z * z);
    const elementary::SinCosf turn = elementary::sincos(2.39996323f * static_cast<float>(k));
    const Vec3d direction(Vec3f{r * turn.cos, r * turn.sin, z});
    std::size_t furthest = 0;
    for (std::size_t i = 1; i < points.size(); ++i) {
      if (dot(points[i] - points[furthest], direction) > 0) furthest = i;
    }
    chosen.push_back(furthest);
  }
  std::sort(chosen.begin(), chosen.end());
  chosen.erase(std::unique(chosen.begin(), chosen.end()), chosen.end());
  std::vector<Vec3d> corners;
  corners.reserve(chosen.size());
  for (const std::size_t i : chosen) corners.push_back(points[i]);
  return corners;
}

/// Sets of vertices that triangles connect.
class Connections {
 public:
  explicit Connections(std::size_t vertices) : parents_(vertices) {
    std::iota(parents_.begin(), parents_.end(), 0u);
  }
  std::uint32_t root(std::uint32_t v) {
    while (parents_[v] != v) v = parents_[v] = parents_[parents_[v]];
    return v;
  }
  void connect(std::uint32_t a, std::uint32_t b) {
    const std::uint32_t x = root(a), y = root(b);
    parents_[std::max(x, y)] = std::min(x, y);
  }

 private:
  std::vector<std::uint32_t> parents_;
};

struct Candidate {
  SearchedLight light;
  double power = 0;
};

void add_triangles(const Instance& instance, const Primitive& p, EmittedRadiance* radiance,
                   std::vector<Candidate>* found) {
  Connections connections(p.positions.size());
  for (const auto& t : p.triangles) {
    connections.connect(t[0], t[1]);
    connections.connect(t[0], t[2]);
  }
  const auto world = [&](std::uint32_t v) {
    return transform_point(instance.object_to_world, Vec3d(p.positions[v]));
  };
  std::vector<Component> components(p.positions.size());
  std::vector<char> is_used(p.positions.size());
  for (const auto& t : p.triangles) {
    components[connections.root(t[0])].add({world(t[0]), world(t[1]), world(t[2])},
                                           radiance->at(p, t));
    for (const std::uint32_t v : t) is_used[v] = 1;
  }
  std::vector<std::vector<Vec3d>> vertices(p.positions.size());
  for (std::uint32_t v = 0; v < p.positions.size(); ++v) {
    if (is_used[v]) vertices[connections.root(v)].push_back(world(v));
  }
  for (std::size_t i = 0; i < components.size(); ++i) {
    const Component& c = components[i];
    if (!(c.area > 0 && c.power > 0)) continue;
    found->push_back({c.light(), c.power});
    found->back().light.corners = outermost(vertices[i]);
  }
}

/// A shape counts as the ball in its box.
void add_shape(const Instance& instance, const Shape& shape, double radiance,
               std::vector<Candidate>* found) {
  if (!shape.bounded() || !(radiance > 0)) return;
  const LightBounds box =
      ShapeLight(instance.object_to_world, instance.world_to_object, shape).bounds(radiance, false);
  SearchedLight light;
  light.centre = (box.box_min + box.box_max) * 0.5;
  const Vec3d half = (box.box_max - box.box_min) * 0.5;
  light.radius = length(half);
  light.radiance = radiance;
  // The projection of a ball has the variance r^2 / 4 on each axis.
  for (int k = 0; k < 3; ++k) {
    Vec3d row;
    row[k] = half[k] * half[k] / 4;
    light.covariance[static_cast<std::size_t>(k)] = row;
  }
  found->push_back({light, radiance * dot(half, half)});
}

}  // namespace

std::vector<SearchedLight> searched_lights(const Scene& scene, const ShadingScene& shading,
                                           const LightSampler& lights) {
  std::vector<Candidate> found;
  EmittedRadiance radiance(scene, shading.textures);
  for (const Instance& instance : scene.instances) {
    if (instance.operand || instance.flat) continue;
    const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
    for (const Primitive& p : mesh.primitives) {
      const MaterialView& material = shading.materials[static_cast<std::size_t>(p.material)];
      if (!material.emissive) continue;
      if (mesh.shape != nullptr) {
        add_shape(instance, *mesh.shape, double{luminance(material.source->emission)}, &found);
      } else {
        add_triangles(instance, p, &radiance, &found);
      }
    }
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const Candidate& a, const Candidate& b) { return a.power > b.power; });
  std::vector<SearchedLight> all;
  for (std::size_t i = 0; i < std::min(found.size(), kMaxLights); ++i)
    all.push_back(found[i].light);
  if (lights.environment() != nullptr) {
    const std::optional<EnvironmentMap::Sun> sun = lights.environment()->sun();
    if (sun) all.push_back({true, sun->towards, sun->covariance, {}, sun->radius, sun->radiance});
  }
  return all;
}

}  // namespace tessera::render
