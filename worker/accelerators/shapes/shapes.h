#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "worker/geometry/bounds.h"
#include "worker/geometry/object_ray.h"
#include "worker/geometry/ray.h"
#include "worker/math/transform.h"

namespace tessera::render::accelerators {

/// Maximum distance of a hit from the shape that was hit, as a fraction of the ray's reach (see
/// ShapeRay::hit_tolerance). The slab test accepts rays that miss a box by 2^-20 + 2^-21 + 8 u of
/// the reach per axis (see enter_leave(); u = 2^-24). The triangle test is exact for a triangle
/// whose corners are moved by at most 9 u of the reach: u for v - o, then 3 u for the product with
/// a shear of at most 1 and 2 u for the difference, in two axes. The constant is more than twice
/// either error.
inline constexpr double kHitTolerance = 0x1p-18;

/// The shapes over which a structure is built: anything with bounds. They are numbered from 0.
///
/// The intersection test guarantees for every hit at t on the line of a ray:
/// 1. enter_leave() of the shape's box accepts the ray and its interval contains t, so that the ray
///    at t is within kHitTolerance * reach of the box, per axis;
/// 2. at some s with |s - t| <= ShapeRay::hull_slack the ray is within kHitTolerance * reach of the
/// convex
///    hull: t is clamped to the box, which changes it by no more than the box is missed by along
///    the limiting axis.
struct ShapeBounds {
  std::span<const Box3f> boxes;  // finite
  std::span<const Vec3f> hulls;  // points_per_hull points per shape, in its box
  std::size_t points_per_hull = 0;
  /// A sample of the rays that will be traced, in the space of the shapes, each with t_max at its
  /// hit. Answers do not depend on it. May be empty.
  std::span<const Ray> rays = {};

  std::uint32_t size() const { return static_cast<std::uint32_t>(boxes.size()); }
  std::span<const Vec3f> hull(std::uint32_t shape) const {
    return hulls.subspan(shape * points_per_hull, points_per_hull);
  }
  /// Returns the box around all shapes.
  Box3f all() const {
    Box3f box;
    for (const Box3f& each : boxes) box.extend(each);
    return box;
  }
};

/// A ray prepared for one structure.
struct ShapeRay {
  ObjectRay slabs;
  Vec3d origin, direction;
  Vec3d box_direction;  // direction of the slab test: components with an infinite inverse are 0
  double hit_tolerance =
      0;  // kHitTolerance * reach; reach is the distance of the farthest plane of `all`
  double hull_slack = 0;  // may be infinite; see ShapeBounds
};

/// Prepares a ray for shapes whose boxes are all in `all`. Returns false if make_object_ray() does.
bool make_shape_ray(const Vec3f& origin, const Vec3f& direction, const Box3f& all, ShapeRay& ray);

/// Returns whether a ray may hit something in the box at a t in [0, limit]. Sets `enter` to the t
/// at which the ray enters the box.
inline bool may_hit(const ObjectRay& ray, const Box3f& box, float limit, float& enter) {
  const EnterLeave t = enter_leave(ray, box.lo, box.hi);
  enter = t.enter;
  return t.enter <= t.leave && t.leave >= 0 && t.enter <= limit;
}

/// An interval of t on a ray, empty if last < first.
struct Segment {
  double first, last;
  bool empty() const { return !(first <= last); }
};

/// Clips a segment of a ray to x[axis] <= plane or, with `above`, to x[axis] >= plane. Uses
/// box_direction.
inline Segment clip(const ShapeRay& ray, Segment part, int axis, double plane, bool above) {
  const double d = ray.box_direction[axis], o = ray.origin[axis];
  if (d == 0) {
    return (above ? o < plane : o > plane) ? Segment{0, -1} : part;
  }
  const double t = (plane - o) / d;  // computed from the plane, not by accumulating steps
  if ((d > 0) == above) {
    part.first = t > part.first ? t : part.first;
  } else {
    part.last = t < part.last ? t : part.last;
  }
  return part;
}

/// Cost of a traversal.
struct TraversalStats {
  std::int64_t nodes = 0;   // nodes or cells visited
  std::int64_t shapes = 0;  // shapes tested
};

/// Non-owning reference to a function object bool(std::uint32_t shape), which must outlive it.
class ShapeVisitor {
 public:
  template <typename Visit>
  explicit ShapeVisitor(Visit& visit)
      : visit_(const_cast<void*>(static_cast<const void*>(&visit))),
        call_([](void* v, std::uint32_t shape) { return (*static_cast<Visit*>(v))(shape); }) {}
  bool operator()(std::uint32_t shape) const { return call_(visit_, shape); }

 private:
  void* visit_;
  bool (*call_)(void*, std::uint32_t);
};

/// An acceleration structure: finds the shapes that a ray may hit. Immutable and thread-safe.
class ShapeIndex {
 public:
  virtual ~ShapeIndex() = default;
  /// Visits each shape that is hit at a t in [0, limit] at least once, and possibly others, until
  /// `visit` returns true; returns whether it did. `limit` is read at every step, so `visit` may
  /// lower it.
  virtual bool traverse(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
                        TraversalStats& stats) const = 0;
  virtual std::size_t memory_bytes() const = 0;
};

/// Cache of recently visited shapes, so that a shape in many cells is tested less often. It belongs
/// to a traversal, so that threads can share a structure; of many shapes it forgets some.
/// Source: M. Shevtsov, A. Soupikov, A. Kapustin, "Ray-triangle intersection algorithm for modern
/// CPU architectures", GraphiCon 2007 ("inverse mailboxing").
class Mailbox {
 public:
  Mailbox() { visited_.fill(UINT32_MAX); }
  /// Adds a shape; returns false if it is already in the cache.
  bool add(std::uint32_t shape) {
    std::uint32_t& slot = visited_[shape % visited_.size()];
    if (slot == shape) return false;
    slot = shape;
    return true;
  }

 private:
  std::array<std::uint32_t, 256> visited_;
};

/// A mailbox at every shape with the number of the last ray that tested it: no shape is tested
/// twice, for four bytes per shape and thread. The nearest hit so far, which the published mailbox
/// also holds, is with the ray here: it bounds `limit`. Source: J. Arnaldi, T. Priol, K. Bouatouch,
/// "A new space subdivision method for ray tracing CSG modelled scenes", 1987.
class RayMailboxes {
 public:
  explicit RayMailboxes(std::size_t shape_count) : last_ray_(shape_count, 0) {}
  /// Begins with the next ray.
  void next_ray() {
    if (++ray_ != 0) return;
    std::fill(last_ray_.begin(), last_ray_.end(), 0u);  // after 2^32 rays
    ray_ = 1;
  }
  /// Marks a shape as tested by this ray; returns false if it already is.
  bool add(std::uint32_t shape) {
    if (last_ray_[shape] == ray_) return false;
    last_ray_[shape] = ray_;
    return true;
  }

 private:
  std::vector<std::uint32_t> last_ray_;  // by shape
  std::uint32_t ray_ = 0;
};

/// Arguments of a recursive traversal that do not change during it.
struct ShapeTraversal {
  const ShapeRay& ray;
  const float& limit;
  const ShapeVisitor& visit;
  Mailbox& mailbox;
  TraversalStats& stats;
};

/// Visits the shapes that are not in the mailbox (a Mailbox or RayMailboxes) until `visit` returns
/// true; returns whether it did.
template <typename AnyMailbox>
bool visit_all(std::span<const std::uint32_t> shapes, const ShapeVisitor& visit,
               AnyMailbox& mailbox) {
  for (const std::uint32_t shape : shapes) {
    if (mailbox.add(shape) && visit(shape)) return true;
  }
  return false;
}

/// Returns 0, 1, ..., count - 1.
std::vector<std::uint32_t> all_shapes(std::uint32_t count);

}  // namespace tessera::render::accelerators
