#include "worker/accelerators/shadow_map.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "worker/accel/build/mesh_triangles.h"

namespace tessera::render {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();
constexpr std::size_t kMaxMaps = 16;
/// Relative error of hits; larger than accelerators::kHitTolerance.
constexpr double kError = 0x1p-16;
/// A shadow ray belongs to a light if it ends within this fraction of its length.
constexpr double kMaxOff = 0x1p-10;
/// By how many texels the lines of a texel are widened: one for the difference between a ray and
/// the line through its origin, and a half as margin.
constexpr double kWiden = 1.5;
constexpr int kSide = 64;               // texels along a face
constexpr double kTexel = 2.0 / kSide;  // width of a texel
constexpr double kEdge = 1 + kWiden * kTexel;

/// A rectangle of a face: u and v are coordinates divided by the depth.
struct Window {
  double u0, u1, v0, v1;
};

/// Coordinates on a face of the cube: 2 * axis, or 2 * axis + 1 for its negative side.
Vec3d on_face(const Vec3d& p, int face) {
  const int axis = face / 2;
  return {p[(axis + 1) % 3], p[(axis + 2) % 3], face % 2 == 0 ? p[axis] : -p[axis]};
}

int face_of(const Vec3d& p) {
  int axis = 0;
  for (int k = 1; k < 3; ++k) axis = std::fabs(p[k]) > std::fabs(p[axis]) ? k : axis;
  return 2 * axis + (p[axis] < 0 ? 1 : 0);
}

using Polygon = std::vector<Vec3d>;

/// Keeps the part of a polygon with dot(normal, p) >= 0.
Polygon halve(const Polygon& polygon, const Vec3d& normal) {
  Polygon out;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Vec3d &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    const double at_a = dot(normal, a), at_b = dot(normal, b);
    if (at_a >= 0) out.push_back(a);
    if ((at_a < 0) != (at_b < 0)) out.push_back(a + (b - a) * (at_a / (at_a - at_b)));
  }
  return out;
}

Polygon clip(const Polygon& polygon, const Window& window) {
  const Polygon right = halve(polygon, {1, 0, -window.u0});
  const Polygon middle = halve(right, {-1, 0, window.u1});
  const Polygon upper = halve(middle, {0, 1, -window.v0});
  return halve(upper, {0, -1, window.v1});
}

/// Returns whether all lines from the light through the window meet the triangle.
bool covers(const Polygon& triangle, const Window& window) {
  for (const double u : {window.u0, window.u1}) {
    for (const double v : {window.v0, window.v1}) {
      int positive = 0, negative = 0;
      for (std::size_t i = 0; i < 3; ++i) {
        const double side = dot(cross(triangle[i], triangle[(i + 1) % 3]), Vec3d{u, v, 1});
        positive += side > 0 ? 1 : 0;
        negative += side < 0 ? 1 : 0;
      }
      // Behind the light the triangle is met by the lines' other halves.
      if (positive != 3 && negative != 3) return false;
    }
  }
  return std::all_of(triangle.begin(), triangle.end(), [](const Vec3d& p) { return p.z > 0; });
}

int texel_at(double u) {
  const double x = (u + 1) / kTexel;
  return x > 0 ? (x < kSide - 1 ? static_cast<int>(x) : kSide - 1) : 0;
}

std::size_t index_of(int face, int x, int y) {
  const int row = face * kSide + y;
  return static_cast<std::size_t>(row) * kSide + static_cast<std::size_t>(x);
}

/// Returns the widened window of a texel.
Window texel_window(int x, int y) {
  const double u = x * kTexel - 1, v = y * kTexel - 1, w = kWiden * kTexel;
  return {u - w, u + kTexel + w, v - w, v + kTexel + w};
}

/// Returns the smallest and the largest depth of a polygon in a window; (kFar, 0) if there is none.
std::pair<double, double> depths_in(const Polygon& polygon, const Window& window) {
  double low = kFar, high = 0;
  for (const Vec3d& p : clip(polygon, window)) {
    low = std::min(low, p.z);
    high = std::max(high, p.z);
  }
  return {low, high};
}

/// Returns a window that contains a polygon, which lies on the face.
Window window_around(const Polygon& polygon) {
  Window all = {kEdge, -kEdge, kEdge, -kEdge};
  for (const Vec3d& p : polygon) {
    if (!(p.z > 0)) return {-kEdge, kEdge, -kEdge, kEdge};  // it contains the light
    const double u = p.x / p.z, v = p.y / p.z;
    all = {std::min(all.u0, u), std::max(all.u1, u), std::min(all.v0, v), std::max(all.v1, v)};
  }
  return all;
}

double frobenius(const Affine3d& m) {
  double sum = 0;
  for (const auto& row : m.rows) sum += dot(row, row);
  return std::sqrt(sum);
}

bool still_mesh(const Scene& scene, const Instance& instance) {
  const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
  return instance.motion == kNone && mesh.shape == nullptr && mesh.keys.empty();
}

}  // namespace

ShadowMap::ShadowMap(const Scene& scene) : size_(max_abs(scene.bounds_max - scene.bounds_min)) {
  if (!scene.solids.empty()) return;
  for (const Instance& instance : scene.instances) {
    if (!still_mesh(scene, instance)) return;
    stretch_ = std::max(stretch_,
                        frobenius(instance.object_to_world) * frobenius(instance.world_to_object));
  }
  for (const PunctualLight& light : scene.lights) {
    const bool usable = light.kind != PunctualLight::Kind::directional && light.keys.empty();
    if (!usable || maps_.size() == kMaxMaps) continue;
    const std::vector<Texel> texels(index_of(6, 0, 0), Texel{kFar, kFar, {}, kFar});
    maps_.push_back({Vec3d(light.position), kFar, texels});
  }
  for (std::uint32_t i = 0; i < scene.instances.size(); ++i) add(scene, i);
}

void ShadowMap::add(const Scene& scene, std::uint32_t number) {
  const Instance& instance = scene.instances[number];
  const double scale = frobenius(instance.object_to_world);
  for_each_triangle(
      scene.meshes[static_cast<std::size_t>(instance.mesh)],
      [&](std::uint32_t p, std::uint32_t t, const Vec3f& v0, const Vec3f& v1, const Vec3f& v2) {
        Corners placed;
        for (std::size_t k = 0; k < 3; ++k) {
          const Vec3d corner(k == 0 ? v0 : k == 1 ? v1 : v2);
          size_ = std::max(size_, scale * max_abs(corner));
          placed[k] = transform_point(instance.object_to_world, corner);
        }
        for (Map& map : maps_) add(placed, {number, p, t}, map);
      });
}

void ShadowMap::add(const Corners& placed, const TriangleId& id, Map& map) {
  for (int face = 0; face < 6; ++face) {
    const Polygon triangle = {on_face(placed[0] - map.light, face),
                              on_face(placed[1] - map.light, face),
                              on_face(placed[2] - map.light, face)};
    const Polygon part = clip(triangle, Window{-kEdge, kEdge, -kEdge, kEdge});
    if (part.empty()) continue;
    const Window all = window_around(part);
    const double widen = (kWiden + 1) * kTexel;
    for (int y = texel_at(all.v0 - widen); y <= texel_at(all.v1 + widen); ++y) {
      for (int x = texel_at(all.u0 - widen); x <= texel_at(all.u1 + widen); ++x) {
        const Window window = texel_window(x, y);
        const auto [low, high] = depths_in(part, window);
        if (!(low <= high)) continue;
        Texel& texel = map.texels[index_of(face, x, y)];
        texel.add(id, low);
        if (covers(triangle, window)) texel.covered = std::min(texel.covered, high);
        map.nearest = std::min(map.nearest, low);
      }
    }
  }
}

void ShadowMap::Texel::add(const TriangleId& triangle, double depth) {
  if (depth < nearest) {
    second = nearest;
    nearest = depth;
    id = triangle;
  } else {
    second = std::min(second, depth);
  }
}

ShadowMap::Answer ShadowMap::answer(const Ray& ray) const {
  const Vec3d origin(ray.origin);
  const Vec3d end = origin + Vec3d(ray.direction) * static_cast<double>(ray.t_max);
  for (const Map& map : maps_) {
    const Vec3d seen = origin - map.light;
    const double reach = length(seen);
    const double off = length(end - map.light);
    if (!(off <= kMaxOff * reach)) continue;
    // A hit is at most `error` from the line between the light and the origin. Lines that differ
    // by it differ by at most one texel where they meet triangles.
    const double error = off + kError * stretch_ * (reach + size_);
    if (!(2 * error * kSide <= map.nearest - 3 * error)) return Answer::unknown;
    const int face = face_of(seen);
    const Vec3d p = on_face(seen, face);
    const int x = texel_at(p.x / p.z), y = texel_at(p.y / p.z);
    const Texel& texel = map.texels[index_of(face, x, y)];
    if (texel.covered < p.z - 2 * error) return Answer::occluded;
    const bool own = texel.id == ray.origin_triangle;  // cannot be hit
    const double first = own ? texel.second : texel.nearest;
    return first > p.z + 2 * error ? Answer::visible : Answer::unknown;
  }
  return Answer::unknown;
}

std::int64_t ShadowMap::memory_bytes() const {
  std::size_t sum = 0;
  for (const Map& map : maps_) sum += map.texels.capacity() * sizeof(Texel);
  return static_cast<std::int64_t>(sum);
}

}  // namespace tessera::render
