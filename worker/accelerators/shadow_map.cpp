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

/// The texels of a face, whose coordinates are -1 to 1.
struct TexelGrid {
  int side;

  double texel() const { return 2.0 / side; }
  double edge() const { return 1 + kWiden * texel(); }
  int at(double u) const {
    const double x = (u + 1) / texel();
    return x > 0 ? (x < side - 1 ? static_cast<int>(x) : side - 1) : 0;
  }
  std::size_t index(int face, int x, int y) const {
    const int row = face * side + y;
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(side) +
           static_cast<std::size_t>(x);
  }
};

/// A rectangle of a face.
struct Window {
  double u0, u1, v0, v1;
};

/// Returns the widened window of a texel.
Window texel_window(const TexelGrid& grid, int x, int y) {
  const double size = grid.texel(), u = x * size - 1, v = y * size - 1, w = kWiden * size;
  return {u - w, u + size + w, v - w, v + size + w};
}

/// A corner on a face: coordinates across are across.x / across.z and across.y / across.z.
struct Corner {
  Vec3d across;
  double depth = 0;
};
using Polygon = std::vector<Corner>;

/// Keeps the part of a polygon with dot(normal, across) >= 0.
Polygon halve(const Polygon& polygon, const Vec3d& normal) {
  Polygon out;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Corner &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    const double at_a = dot(normal, a.across), at_b = dot(normal, b.across);
    if (at_a >= 0) out.push_back(a);
    if ((at_a < 0) == (at_b < 0)) continue;
    const double s = at_a / (at_a - at_b);
    out.push_back({a.across + (b.across - a.across) * s, a.depth + (b.depth - a.depth) * s});
  }
  return out;
}

Polygon clip(const Polygon& polygon, const Window& window) {
  const Polygon right = halve(polygon, {1, 0, -window.u0});
  const Polygon middle = halve(right, {-1, 0, window.u1});
  const Polygon upper = halve(middle, {0, 1, -window.v0});
  return halve(upper, {0, -1, window.v1});
}

/// Returns whether all lines of light through the window meet the triangle.
bool covers(const Polygon& triangle, const Window& window) {
  for (const double u : {window.u0, window.u1}) {
    for (const double v : {window.v0, window.v1}) {
      int positive = 0, negative = 0;
      for (std::size_t i = 0; i < 3; ++i) {
        const double side =
            dot(cross(triangle[i].across, triangle[(i + 1) % 3].across), Vec3d{u, v, 1});
        positive += side > 0 ? 1 : 0;
        negative += side < 0 ? 1 : 0;
      }
      // Behind the light the triangle is met by the lines' other halves.
      if (positive != 3 && negative != 3) return false;
    }
  }
  return std::all_of(triangle.begin(), triangle.end(),
                     [](const Corner& p) { return p.across.z > 0; });
}

/// Returns the smallest and the largest depth of a polygon in a window; (kFar, -kFar) if there is
/// none.
std::pair<double, double> depths_in(const Polygon& polygon, const Window& window) {
  double low = kFar, high = -kFar;
  for (const Corner& p : clip(polygon, window)) {
    low = std::min(low, p.depth);
    high = std::max(high, p.depth);
  }
  return {low, high};
}

/// Returns a window that contains a polygon, which lies on the face.
Window window_around(const Polygon& polygon, double edge) {
  Window all = {edge, -edge, edge, -edge};
  for (const Corner& p : polygon) {
    if (!(p.across.z > 0)) return {-edge, edge, -edge, edge};  // it contains the light
    const double u = p.across.x / p.across.z, v = p.across.y / p.across.z;
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
  Box3d box;
  for_each_placed(scene, [&](const Corners& placed, const TriangleId&, double reach) {
    size_ = std::max(size_, reach);
    for (const Vec3d& corner : placed) box.extend(corner);
  });
  for (const PunctualLight& light : scene.lights) {
    if (light.keys.empty() && maps_.size() < kMaxMaps && !box.empty()) add_map(light, box);
  }
  for_each_placed(scene, [&](const Corners& placed, const TriangleId& id, double) {
    for (Map& map : maps_) add(placed, id, map);
  });
}

void ShadowMap::add_map(const PunctualLight& light, const Box3d& box) {
  Map map;
  map.nearest = kFar;
  map.light = Vec3d(light.position);
  map.distant = light.kind == PunctualLight::Kind::directional;
  if (map.distant) {
    map.to_light = -light.direction;
    map.light = (box.lo + box.hi) * 0.5;
    map.half = 0.5 * length(box.hi - box.lo);
    if (!(map.half > 0)) return;
    const Vec3d along = normalize(Vec3d(light.direction));
    const Vec3d other = std::fabs(along.x) < 0.5 ? Vec3d{1, 0, 0} : Vec3d{0, 1, 0};
    const Vec3d u = normalize(cross(along, other));
    map.axes = {u / map.half, cross(along, u) / map.half, along};
  }
  map.texels.assign(TexelGrid{map.side()}.index(map.faces(), 0, 0), Texel{kFar, kFar, {}, kFar});
  maps_.push_back(std::move(map));
}

/// Calls visit(corners, id, reach) for each triangle, placed in the world; `reach` bounds its
/// coordinates before and after.
template <typename Visit>
void ShadowMap::for_each_placed(const Scene& scene, const Visit& visit) {
  for (std::uint32_t i = 0; i < scene.instances.size(); ++i) {
    const Instance& instance = scene.instances[i];
    const double scale = frobenius(instance.object_to_world);
    for_each_triangle(
        scene.meshes[static_cast<std::size_t>(instance.mesh)],
        [&](std::uint32_t p, std::uint32_t t, const Vec3f& v0, const Vec3f& v1, const Vec3f& v2) {
          Corners placed;
          double reach = 0;
          for (std::size_t k = 0; k < 3; ++k) {
            const Vec3d corner(k == 0 ? v0 : k == 1 ? v1 : v2);
            reach = std::max(reach, scale * max_abs(corner));
            placed[k] = transform_point(instance.object_to_world, corner);
          }
          visit(placed, TriangleId{i, p, t}, reach);
        });
  }
}

/// Faces of a cube: 2 * axis, or 2 * axis + 1 for its negative side.
ShadowMap::Map::OnFace ShadowMap::Map::place(const Vec3d& point, int face) const {
  const Vec3d p = point - light;
  if (distant) return {{dot(axes[0], p), dot(axes[1], p), 1}, dot(axes[2], p)};
  const int axis = face / 2;
  const double depth = face % 2 == 0 ? p[axis] : -p[axis];
  return {{p[(axis + 1) % 3], p[(axis + 2) % 3], depth}, depth};
}

int ShadowMap::Map::face_of(const Vec3d& point) const {
  if (distant) return 0;
  const Vec3d p = point - light;
  int axis = 0;
  for (int k = 1; k < 3; ++k) axis = std::fabs(p[k]) > std::fabs(p[axis]) ? k : axis;
  return 2 * axis + (p[axis] < 0 ? 1 : 0);
}

bool ShadowMap::Map::resolves(double error) const {
  const double width = distant ? half : nearest - 3 * error;
  return 2 * error * side() <= width;
}

void ShadowMap::add(const Corners& placed, const TriangleId& id, Map& map) {
  const TexelGrid grid{map.side()};
  const double edge = grid.edge();
  for (int face = 0; face < map.faces(); ++face) {
    Polygon triangle;
    for (const Vec3d& corner : placed) {
      const Map::OnFace at = map.place(corner, face);
      triangle.push_back({at.across, at.depth});
    }
    const Polygon part = clip(triangle, Window{-edge, edge, -edge, edge});
    if (part.empty()) continue;
    const Window all = window_around(part, edge);
    const double widen = (kWiden + 1) * grid.texel();
    for (int y = grid.at(all.v0 - widen); y <= grid.at(all.v1 + widen); ++y) {
      for (int x = grid.at(all.u0 - widen); x <= grid.at(all.u1 + widen); ++x) {
        const Window window = texel_window(grid, x, y);
        const auto [low, high] = depths_in(part, window);
        if (!(low <= high)) continue;
        Texel& texel = map.texels[grid.index(face, x, y)];
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
  const bool endless = !(ray.t_max < std::numeric_limits<float>::max());
  const Vec3d end = origin + Vec3d(ray.direction) * static_cast<double>(ray.t_max);
  for (const Map& map : maps_) {
    const double reach = length(origin - map.light);
    double off = 0;
    if (map.distant) {
      if (!endless || !(ray.direction == map.to_light)) continue;
    } else {
      off = length(end - map.light);
      if (!(off <= kMaxOff * reach)) continue;
    }
    return answer(map, ray, off + kError * stretch_ * (reach + size_));
  }
  return Answer::unknown;
}

/// A hit is at most `error` from the line of light through the origin. Lines that differ by it
/// differ by at most one texel where they meet triangles.
ShadowMap::Answer ShadowMap::answer(const Map& map, const Ray& ray, double error) const {
  if (!map.resolves(error)) return Answer::unknown;
  const TexelGrid grid{map.side()};
  const Vec3d origin(ray.origin);
  const int face = map.face_of(origin);
  const Map::OnFace p = map.place(origin, face);
  const double u = p.across.x / p.across.z, v = p.across.y / p.across.z;
  if (!(std::fabs(u) <= 1 && std::fabs(v) <= 1)) return Answer::unknown;
  const Texel& texel = map.texels[grid.index(face, grid.at(u), grid.at(v))];
  if (texel.covered < p.depth - 2 * error) return Answer::occluded;
  const bool own = texel.id == ray.origin_triangle;  // cannot be hit
  const double first = own ? texel.second : texel.nearest;
  return first > p.depth + 2 * error ? Answer::visible : Answer::unknown;
}

std::int64_t ShadowMap::memory_bytes() const {
  std::size_t sum = 0;
  for (const Map& map : maps_) sum += map.texels.capacity() * sizeof(Texel);
  return static_cast<std::int64_t>(sum);
}

}  // namespace tessera::render
