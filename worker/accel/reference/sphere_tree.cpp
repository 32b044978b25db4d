// A hierarchy of bounding spheres, each around the boxes of its shapes: few operations a test, but
// much air around anything long. Source: H. Weghorst, G. Hooper, D. Greenberg, "Improved
// computational methods for ray tracing", 1984.

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "worker/accel/reference/depth_first.h"
#include "worker/accel/reference/structures.h"

namespace tessera::render::reference {
namespace {

struct Sphere {
  Vec3d centre;
  double radius = 0;
};

/// About the centre of the node's box, as far as the farthest corner of a shape's.
Sphere sphere_around(const DepthFirstTree& tree, const DepthFirstNode& node,
                     const ShapeBounds& shapes) {
  Sphere sphere;
  sphere.centre = (Vec3d(node.box.lo) + Vec3d(node.box.hi)) * 0.5;
  for (std::uint32_t i = 0; i < node.count; ++i) {
    const Box3f& box = shapes.boxes[tree.order[node.first + i]];
    const Vec3d to_lo = Vec3d(box.lo) - sphere.centre, to_hi = Vec3d(box.hi) - sphere.centre;
    Vec3d farthest;
    for (int k = 0; k < 3; ++k) farthest[k] = std::max(std::fabs(to_lo[k]), std::fabs(to_hi[k]));
    sphere.radius = std::max(sphere.radius, length(farthest));
  }
  return sphere;
}

class SphereTree final : public ShapeIndex {
 public:
  SphereTree(DepthFirstTree tree, const ShapeBounds& shapes) : tree_(std::move(tree)) {
    spheres_.reserve(tree_.nodes.size());
    for (const DepthFirstNode& node : tree_.nodes) {
      spheres_.push_back(sphere_around(tree_, node, shapes));
    }
  }

  bool walk(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
            Work& work) const override {
    const Walk walk{ray, dot(ray.box_direction, ray.box_direction), limit, visit, work};
    double enter = 0;
    return meets(0, walk, enter) && descend(0, walk);
  }
  std::size_t memory_bytes() const override {
    return tree_.memory_bytes() + spheres_.capacity() * sizeof(Sphere);
  }

 private:
  struct Walk {
    const ShapeRay& ray;
    double direction_squared;
    const float& limit;
    const ShapeVisitor& visit;
    Work& work;
  };

  /// Whether the ray, at some t in [0, limit], is in the sphere widened by what hits may be off:
  /// sqrt(3) * near. Doubling that covers the rounding here, 2^-50 of the reach.
  bool meets(std::uint32_t node, const Walk& walk, double& enter) const {
    const Sphere& sphere = spheres_[node];
    const double radius = sphere.radius + 4 * walk.ray.near;
    const Vec3d to_centre = sphere.centre - walk.ray.origin;
    const double closest = dot(to_centre, walk.ray.box_direction) / walk.direction_squared;
    const Vec3d miss = to_centre - walk.ray.box_direction * closest;
    const double rest = radius * radius - dot(miss, miss);
    if (rest < 0) return false;
    const double half = std::sqrt(rest / walk.direction_squared);
    enter = closest - half;
    return closest + half >= 0 && enter <= static_cast<double>(walk.limit);
  }

  bool descend(std::uint32_t index, const Walk& walk) const {
    ++walk.work.nodes;
    if (tree_.leaf(index)) {
      const DepthFirstNode& node = tree_.nodes[index];
      for (std::uint32_t i = 0; i < node.count; ++i) {
        if (walk.visit(tree_.order[node.first + i])) return true;
      }
      return false;
    }
    std::uint32_t near = index + 1, far = tree_.nodes[near].skip;
    double near_enter = 0, far_enter = 0;
    bool meets_near = meets(near, walk, near_enter), meets_far = meets(far, walk, far_enter);
    if (meets_far && (!meets_near || far_enter < near_enter)) {
      std::swap(near, far);
      std::swap(meets_near, meets_far);
      std::swap(near_enter, far_enter);
    }
    if (meets_near && descend(near, walk)) return true;
    return meets_far && far_enter <= static_cast<double>(walk.limit) && descend(far, walk);
  }

  DepthFirstTree tree_;
  std::vector<Sphere> spheres_;
};

}  // namespace

std::unique_ptr<ShapeIndex> build_sphere_tree(const ShapeBounds& shapes) {
  return std::make_unique<SphereTree>(build_depth_first(shapes), shapes);
}

}  // namespace tessera::render::reference
