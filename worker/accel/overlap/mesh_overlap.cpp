#include "worker/accel/overlap/mesh_overlap.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include "worker/accel/binary_bvh/binary_bvh.h"
#include "worker/accel/build/mesh_triangles.h"

namespace tessera::render {
namespace {

constexpr std::uint32_t kLeafSize = 4;

bool boxes_overlap(const Box3f& a, const Box3f& b) {
  return a.lo.x <= b.hi.x && b.lo.x <= a.hi.x && a.lo.y <= b.hi.y && b.lo.y <= a.hi.y &&
         a.lo.z <= b.hi.z && b.lo.z <= a.hi.z;
}

/// Boxes and a BVH over them.
struct BoxTree {
  std::vector<Box3f> boxes;
  BinaryBvh bvh;

  void build() { bvh = build_binary_bvh({boxes, kLeafSize}, sequential()); }
};

/// Finds overlapping boxes of two trees, or of one tree with itself, by descending both at once.
template <typename Visit>
class PairSearch {
 public:
  /// Calls visit(i, j) for each box i of `a` that overlaps box j of `b`. If they are the same tree:
  /// for each two different boxes once, in either order.
  PairSearch(const BoxTree& a, const BoxTree& b, const Visit& visit)
      : a_(a), b_(b), self_(&a == &b), visit_(visit) {
    if (!a.boxes.empty() && !b.boxes.empty()) search(0, 0);
  }

 private:
  void search(std::uint32_t i, std::uint32_t j) {
    const BinaryNode &a = a_.bvh.nodes[i], &b = b_.bvh.nodes[j];
    if (!boxes_overlap(a.box, b.box)) return;
    if (a.leaf() && b.leaf()) {
      compare(a, b, self_ && i == j);
    } else if (self_ && i == j) {
      search(a.left, a.left);
      search(a.right, a.right);
      search(a.left, a.right);
    } else if (b.leaf() || (!a.leaf() && a.box.half_area() > b.box.half_area())) {
      search(a.left, j);
      search(a.right, j);
    } else {
      search(i, b.left);
      search(i, b.right);
    }
  }

  void compare(const BinaryNode& a, const BinaryNode& b, bool same) {
    for (std::uint32_t i = 0; i < a.count; ++i) {
      for (std::uint32_t j = same ? i + 1 : 0; j < b.count; ++j) {
        const std::uint32_t s = a_.bvh.order[a.first + i], t = b_.bvh.order[b.first + j];
        if (boxes_overlap(a_.boxes[s], b_.boxes[t])) visit_(s, t);
      }
    }
  }

  const BoxTree& a_;
  const BoxTree& b_;
  const bool self_;
  const Visit& visit_;
};

/// The triangles of a mesh that can be hit, transformed.
struct MeshTriangles {
  std::vector<TriangleCorners> triangles;
  std::vector<OverlapPair::Id> ids;
  BoxTree tree;

  MeshTriangles(const Mesh& mesh, const std::vector<bool>& primitives, const Affine3d& to_world) {
    const bool moves = !is_identity(to_world);
    const auto place = [&](const Vec3f& p) {
      return moves ? Vec3f(transform_point(to_world, Vec3d(p))) : p;
    };
    for_each_triangle(mesh, [&](std::uint32_t p, std::uint32_t t, const Vec3f& v0, const Vec3f& v1,
                                const Vec3f& v2) {
      if (!primitives[p]) return;
      const TriangleCorners corners = {place(v0), place(v1), place(v2)};
      if (!is_hittable(corners[0], corners[1], corners[2])) return;  // degenerate after rounding
      triangles.push_back(corners);
      ids.push_back({p, t});
      Box3f& box = tree.boxes.emplace_back();
      for (const Vec3f& corner : corners) box.extend(corner);
    });
    tree.build();
  }
};

/// Returns the overlapping triangles of two meshes, or of one mesh with itself, in ascending order.
std::vector<OverlapPair> overlaps_of(const MeshTriangles& a, const MeshTriangles& b) {
  std::vector<OverlapPair> pairs;
  const auto compare = [&](std::uint32_t i, std::uint32_t j) {
    if (!triangles_overlap(a.triangles[i], b.triangles[j])) return;
    OverlapPair pair{a.ids[i], b.ids[j]};
    if (&a == &b && pair.b < pair.a) std::swap(pair.a, pair.b);
    pairs.push_back(pair);
  };
  PairSearch(a.tree, b.tree, compare);
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

std::vector<bool> all_primitives(const Mesh& mesh) {
  return std::vector<bool>(mesh.primitives.size(), true);
}

}  // namespace

std::vector<OverlapPair> self_intersections(const Mesh& mesh, const std::vector<bool>& primitives) {
  const MeshTriangles triangles(mesh, primitives, {});
  return overlaps_of(triangles, triangles);
}

std::vector<OverlapPair> self_intersections(const Mesh& mesh) {
  return self_intersections(mesh, all_primitives(mesh));
}

std::vector<InstanceOverlap> instance_overlaps(const Scene& scene) {
  const auto mesh_of = [&](std::uint32_t i) -> const Mesh& {
    return scene.meshes[static_cast<std::size_t>(scene.instances[i].mesh)];
  };
  BoxTree tree;
  std::vector<std::uint32_t> instances;  // by box: those with triangles
  for (std::uint32_t i = 0; i < scene.instances.size(); ++i) {
    if (scene.instances[i].flat) continue;
    Box3f box;
    for (const Primitive& primitive : mesh_of(i).primitives) {
      for (const Vec3f& p : primitive.positions) {
        box.extend(Vec3f(transform_point(scene.instances[i].object_to_world, Vec3d(p))));
      }
    }
    if (!(box.lo.x <= box.hi.x)) continue;
    tree.boxes.push_back(box);
    instances.push_back(i);
  }
  tree.build();
  std::vector<std::pair<std::uint32_t, std::uint32_t>> candidates;
  const auto collect = [&](std::uint32_t i, std::uint32_t j) {
    candidates.emplace_back(std::minmax(instances[i], instances[j]));
  };
  PairSearch(tree, tree, collect);
  std::sort(candidates.begin(), candidates.end());
  std::map<std::uint32_t, MeshTriangles> meshes;  // by instance, until all its pairs are done
  const auto triangles_of = [&](std::uint32_t i) -> const MeshTriangles& {
    return meshes
        .try_emplace(i, mesh_of(i), all_primitives(mesh_of(i)), scene.instances[i].object_to_world)
        .first->second;
  };
  std::vector<InstanceOverlap> out;
  for (const auto& [a, b] : candidates) {
    meshes.erase(meshes.begin(), meshes.lower_bound(a));
    std::vector<OverlapPair> pairs = overlaps_of(triangles_of(a), triangles_of(b));
    if (!pairs.empty()) out.push_back({a, b, std::move(pairs)});
  }
  return out;
}

namespace {

using Corner = std::array<float, 3>;

/// Identifies corners within a tolerance of each other.
class VertexWelder {
 public:
  explicit VertexWelder(double tolerance) : tolerance_(tolerance) {}

  Corner operator()(const Corner& corner) {
    if (!(tolerance_ > 0)) return corner;
    Cell cell{};
    for (std::size_t k = 0; k < 3; ++k) {
      cell[k] = std::floor(static_cast<double>(corner[k]) / (2 * tolerance_));
    }
    for (int i = 0; i < 27; ++i) {
      const int x = i % 3 - 1, y = i / 3 % 3 - 1, z = i / 9 - 1;
      const Cell neighbour = {cell[0] + x, cell[1] + y, cell[2] + z};
      const auto [first, last] = vertices_.equal_range(neighbour);
      for (auto known = first; known != last; ++known) {
        if (is_near(known->second, corner)) return known->second;
      }
    }
    return vertices_.emplace(cell, corner)->second;
  }

 private:
  using Cell = std::array<double, 3>;  // integers

  bool is_near(const Corner& a, const Corner& b) const {
    for (std::size_t k = 0; k < 3; ++k) {
      const double gap = static_cast<double>(a[k]) - static_cast<double>(b[k]);
      if (!(std::fabs(gap) <= tolerance_)) return false;
    }
    return true;
  }

  double tolerance_;
  std::multimap<Cell, Corner> vertices_;
};

}  // namespace

std::int64_t boundary_edges(const Mesh& mesh, const std::vector<bool>& primitives,
                            double tolerance) {
  VertexWelder weld(tolerance);
  std::map<std::pair<Corner, Corner>, std::int64_t> balance;  // forward minus backward uses
  for (std::size_t p = 0; p < mesh.primitives.size(); ++p) {
    if (!primitives[p]) continue;
    const Primitive& primitive = mesh.primitives[p];
    const auto corner = [&](std::uint32_t i) {
      const Vec3f& v = primitive.positions[i];
      return weld({v.x + 0.0f, v.y + 0.0f, v.z + 0.0f});  // turns -0 into 0
    };
    for (const auto& triangle : primitive.triangles) {
      for (std::size_t i = 0; i < 3; ++i) {
        const Corner from = corner(triangle[i]), to = corner(triangle[i == 2 ? 0 : i + 1]);
        if (from < to) ++balance[{from, to}];
        if (to < from) --balance[{to, from}];
      }
    }
  }
  return std::count_if(balance.begin(), balance.end(),
                       [](const auto& edge) { return edge.second != 0; });
}

}  // namespace tessera::render
