#include "worker/gltf/decode/tangents.h"

#include <algorithm>
#include <cmath>

#include "worker/math/elementary.h"

namespace tessera::render {

namespace {

constexpr std::uint32_t kUnset = 0xFFFFFFFF;

/// A corner of a triangle: its position, normal and UV.
struct Corner {
  Vec3f position, normal;
  Vec2f uv;
};

bool same(const Corner& a, const Corner& b) {
  return a.position == b.position && a.normal == b.normal && a.uv == b.uv;
}

bool before(const Corner& a, const Corner& b) {
  for (int k = 0; k < 3; ++k) {
    if (a.position[k] != b.position[k]) return a.position[k] < b.position[k];
  }
  for (int k = 0; k < 3; ++k) {
    if (a.normal[k] != b.normal[k]) return a.normal[k] < b.normal[k];
  }
  if (a.uv.x != b.uv.x) return a.uv.x < b.uv.x;
  return a.uv.y < b.uv.y;
}

/// Contribution of a triangle: the direction of increasing u on its surface.
struct FaceFrame {
  Vec3d along_u;           // unit, or zero
  bool preserves = false;  // UV winding equals surface winding
  bool joins_any = true;   // no usable UV derivative
  bool flat = false;       // degenerate: takes no part and copies its neighbours
};

Vec3d reject(const Vec3d& v, const Vec3d& n) {
  return v - n * dot(n, v);
}

class TangentBuilder {
 public:
  TangentBuilder(const Primitive& primitive, std::int32_t uv_set)
      : triangles_(primitive.triangles.size()) {
    gather(primitive, uv_set);
    weld();
    for (std::size_t f = 0; f < triangles_; ++f) frames_.push_back(face_frame(f));
    pair_edges();
    make_groups();
  }

  std::vector<Vec4f> tangents() {
    std::vector<Vec3d> sums(group_sign_.size());
    for (std::size_t c = 0; c < corners_.size(); ++c) {
      if (group_[c] != kUnset && !frames_[c / 3].joins_any) sums[group_[c]] += contribution(c);
    }
    std::vector<Vec4f> out(corners_.size());
    std::vector<std::uint32_t> of_vertex(corners_.size(), kUnset);  // for flat triangles
    for (std::size_t c = 0; c < corners_.size(); ++c) {
      if (group_[c] != kUnset && of_vertex[vertex_[c]] == kUnset) of_vertex[vertex_[c]] = group_[c];
    }
    for (std::size_t c = 0; c < corners_.size(); ++c) {
      const std::uint32_t group = group_[c] != kUnset ? group_[c] : of_vertex[vertex_[c]];
      const Vec3d n = normalize(Vec3d(corners_[c].normal));
      Vec3d t = group == kUnset ? Vec3d{} : normalize(sums[group]);
      // For degenerate UVs the method gives +x, which is not always perpendicular.
      if (t == Vec3d{}) t = std::fabs(n.x) < 0.99 ? Vec3d{1, 0, 0} : Vec3d{0, 1, 0};
      const float sign = group == kUnset ? -1.0f : group_sign_[group];
      const Vec3f narrow(t);
      out[c] = {narrow.x, narrow.y, narrow.z, sign};
    }
    return out;
  }

 private:
  void gather(const Primitive& p, std::int32_t uv_set) {
    corners_.reserve(triangles_ * 3);
    for (const auto& t : p.triangles) {
      const Vec3f face = p.normals.empty() ? face_normal(p, t) : Vec3f{};
      for (const std::uint32_t v : t) {
        corners_.push_back({p.positions[v], p.normals.empty() ? face : p.normals[v],
                            p.uv[static_cast<std::size_t>(uv_set)][v]});
      }
    }
  }

  /// Welds corners: equal ones get the index of the first of them.
  void weld() {
    std::vector<std::uint32_t> order(corners_.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = static_cast<std::uint32_t>(i);
    std::sort(order.begin(), order.end(), [this](std::uint32_t a, std::uint32_t b) {
      if (before(corners_[a], corners_[b])) return true;
      return !before(corners_[b], corners_[a]) && a < b;
    });
    vertex_.resize(corners_.size());
    for (std::size_t i = 0; i < order.size(); ++i) {
      const bool first = i == 0 || !same(corners_[order[i]], corners_[order[i - 1]]);
      vertex_[order[i]] = first ? order[i] : vertex_[order[i - 1]];
    }
  }

  [[nodiscard]] FaceFrame face_frame(std::size_t f) const {
    const Corner* c = corners_.data() + 3 * f;
    FaceFrame frame;
    frame.flat = c[0].position == c[1].position || c[1].position == c[2].position ||
                 c[2].position == c[0].position;
    const double u1 = static_cast<double>(c[1].uv.x) - c[0].uv.x;
    const double v1 = static_cast<double>(c[1].uv.y) - c[0].uv.y;
    const double u2 = static_cast<double>(c[2].uv.x) - c[0].uv.x;
    const double v2 = static_cast<double>(c[2].uv.y) - c[0].uv.y;
    const Vec3d d1 = Vec3d(c[1].position) - Vec3d(c[0].position);
    const Vec3d d2 = Vec3d(c[2].position) - Vec3d(c[0].position);
    const double area = u1 * v2 - v1 * u2;
    frame.preserves = area > 0;
    if (area == 0) return frame;
    const double sign = frame.preserves ? 1 : -1;
    frame.along_u = normalize(d1 * v2 - d2 * v1) * sign;
    const Vec3d along_v = d2 * u1 - d1 * u2;
    frame.joins_any = frame.along_u == Vec3d{} || along_v == Vec3d{};
    return frame;
  }

  /// Finds the triangle across each edge: the first that has the edge in the opposite direction.
  void pair_edges() {
    struct Edge {
      std::uint32_t low, high, corner;
    };
    std::vector<Edge> edges;
    for (std::size_t c = 0; c < corners_.size(); ++c) {
      if (frames_[c / 3].flat) continue;
      const std::uint32_t a = vertex_[c], b = vertex_[next(c)];
      edges.push_back({std::min(a, b), std::max(a, b), static_cast<std::uint32_t>(c)});
    }
    std::sort(edges.begin(), edges.end(), [](const Edge& a, const Edge& b) {
      if (a.low != b.low) return a.low < b.low;
      return a.high != b.high ? a.high < b.high : a.corner < b.corner;
    });
    across_.assign(corners_.size(), kUnset);
    for (std::size_t i = 0; i < edges.size(); ++i) {
      const std::uint32_t c = edges[i].corner;
      for (std::size_t k = i + 1; k < edges.size() && across_[c] == kUnset; ++k) {
        if (edges[k].low != edges[i].low || edges[k].high != edges[i].high) break;
        const std::uint32_t d = edges[k].corner;
        if (across_[d] != kUnset || vertex_[d] != vertex_[next(c)]) continue;
        across_[c] = d;
        across_[d] = c;
      }
    }
  }

  static std::size_t next(std::size_t corner) { return corner % 3 == 2 ? corner - 2 : corner + 1; }
  static std::size_t previous(std::size_t corner) {
    return corner % 3 == 0 ? corner + 2 : corner - 1;
  }

  /// Groups the corners around a vertex that are connected by edges and have one UV orientation.
  void make_groups() {
    group_.assign(corners_.size(), kUnset);
    for (std::size_t c = 0; c < corners_.size(); ++c) {
      const FaceFrame& frame = frames_[c / 3];
      if (group_[c] != kUnset || frame.flat || frame.joins_any) continue;
      const auto group = static_cast<std::uint32_t>(group_sign_.size());
      group_sign_.push_back(frame.preserves ? -1.0f : 1.0f);
      fill_group(c, group, frame.preserves);
    }
  }

  void fill_group(std::size_t seed, std::uint32_t group, bool preserves) {
    std::vector<std::size_t> open = {seed};
    while (!open.empty()) {
      const std::size_t c = open.back();
      open.pop_back();
      FaceFrame& frame = frames_[c / 3];
      const std::size_t first = c / 3 * 3;
      const bool untouched =
          group_[first] == kUnset && group_[first + 1] == kUnset && group_[first + 2] == kUnset;
      if (frame.joins_any && untouched) frame.preserves = preserves;
      if (group_[c] != kUnset || frame.preserves != preserves) continue;
      group_[c] = group;
      // Continues at the same vertex in the triangles across the two edges that meet here.
      const std::uint32_t right = across_[c];
      if (right != kUnset) open.push_back(next(right));
      const std::uint32_t left = across_[previous(c)];
      if (left != kUnset) open.push_back(left);
    }
  }

  /// The triangle's direction in the corner's tangent plane, weighted by the corner's angle.
  [[nodiscard]] Vec3d contribution(std::size_t c) const {
    const Vec3d n = normalize(Vec3d(corners_[c].normal));
    const Vec3d t = normalize(reject(frames_[c / 3].along_u, n));
    const Vec3d here(corners_[c].position);
    const Vec3d to_next = normalize(reject(Vec3d(corners_[next(c)].position) - here, n));
    const Vec3d to_previous = normalize(reject(Vec3d(corners_[previous(c)].position) - here, n));
    const double cosine = clamp(dot(to_next, to_previous), -1.0, 1.0);
    return t * elementary::acos(cosine);
  }

  std::size_t triangles_;
  std::vector<Corner> corners_;
  std::vector<std::uint32_t> vertex_;  // welded index of each corner
  std::vector<FaceFrame> frames_;
  std::vector<std::uint32_t> across_;  // edge (corner, next corner) -> corner that begins the
                                       // same edge, run the other way
  std::vector<std::uint32_t> group_;
  std::vector<float> group_sign_;
};

template <typename T>
void split(std::vector<T>& values, const std::vector<std::uint32_t>& source) {
  if (values.empty()) return;
  std::vector<T> out(source.size());
  for (std::size_t i = 0; i < source.size(); ++i) out[i] = values[source[i]];
  values = std::move(out);
}

}  // namespace

Vec3f face_normal(const Primitive& primitive, const std::array<std::uint32_t, 3>& triangle) {
  const Vec3d a(primitive.positions[triangle[0]]);
  const Vec3d n = cross(Vec3d(primitive.positions[triangle[1]]) - a,
                        Vec3d(primitive.positions[triangle[2]]) - a);
  return Vec3f(normalize(n));
}

std::vector<Vec4f> corner_tangents(const Primitive& primitive, std::int32_t uv_set) {
  return TangentBuilder(primitive, uv_set).tangents();
}

void add_tangents(BasePrimitive& base, std::int32_t uv_set) {
  Primitive& p = base.primitive;
  const std::vector<Vec4f> corners = corner_tangents(p, uv_set);
  // New vertices in order of first use; those of one old vertex form a chain through `next_of`.
  std::vector<std::uint32_t> first_of(p.positions.size(), kUnset), next_of, source;
  std::vector<Vec4f> tangents;
  for (std::size_t c = 0; c < corners.size(); ++c) {
    std::uint32_t& index = p.triangles[c / 3][c % 3];
    const std::uint32_t old = index;
    std::uint32_t made = first_of[old];
    while (made != kUnset && tangents[made] != corners[c]) made = next_of[made];
    if (made == kUnset) {
      made = static_cast<std::uint32_t>(tangents.size());
      tangents.push_back(corners[c]);
      source.push_back(old);
      next_of.push_back(first_of[old]);
      first_of[old] = made;
    }
    index = made;
  }
  p.tangents = std::move(tangents);
  split(p.positions, source);
  split(p.normals, source);
  split(p.colors, source);
  split(p.uv[0], source);
  split(p.uv[1], source);
  for (auto& target : base.targets) {
    split(target.positions, source);
    split(target.normals, source);
    split(target.tangents, source);
  }
  for (auto& influences : base.influences) {
    split(influences.joints, source);
    split(influences.weights, source);
  }
}

}  // namespace tessera::render
