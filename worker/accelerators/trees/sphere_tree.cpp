// A hierarchy of bounding spheres around the boxes of the shapes: few operations per test, but
// loose bounds of elongated shapes. Source: H. Weghorst, G. Hooper, D. Greenberg, "Improved
// computational methods for ray tracing", 1984.

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "worker/accelerators/shapes/depth_first.h"
#include "worker/accelerators/trees/trees.h"

namespace tessera::render::accelerators {
namespace {

struct Sphere {
  Vec3d centre;
  double radius = 0;
};

/// Returns the sphere about the centre of the node's box that contains the boxes of its shapes.
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

  bool traverse(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
                TraversalStats& stats) const override {
    const double direction_squared = dot(ray.box_direction, ray.box_direction);
    const auto hits = [&](std::uint32_t node, double& enter) {
      return sphere_hits(spheres_[node], ray, direction_squared, limit, enter);
    };
    double enter = 0;
    return hits(0, enter) && traverse_near_first({tree_, limit, visit, stats}, hits);
  }
  std::size_t memory_bytes() const override {
    return tree_.memory_bytes() + spheres_.capacity() * sizeof(Sphere);
  }

 private:
  /// Returns whether the ray is in the sphere, widened by the maximum error of hits, at some t in
  /// [0, limit]. The error is sqrt(3) * hit_tolerance; more than doubling it covers the rounding
  /// here, which is 2^-50 of the reach.
  static bool sphere_hits(const Sphere& sphere, const ShapeRay& ray, double direction_squared,
                          float limit, double& enter) {
    const double radius = sphere.radius + 4 * ray.hit_tolerance;
    const Vec3d to_centre = sphere.centre - ray.origin;
    const double closest = dot(to_centre, ray.box_direction) / direction_squared;
    const Vec3d miss = to_centre - ray.box_direction * closest;
    const double rest = radius * radius - dot(miss, miss);
    if (rest < 0) return false;
    const double half = std::sqrt(rest / direction_squared);
    enter = closest - half;
    return closest + half >= 0 && enter <= double{limit};
  }

  DepthFirstTree tree_;
  std::vector<Sphere> spheres_;
};

}  // namespace

std::unique_ptr<ShapeIndex> build_sphere_tree(const ShapeBounds& shapes) {
  return std::make_unique<SphereTree>(build_depth_first(shapes), shapes);
}

}  // namespace tessera::render::accelerators
