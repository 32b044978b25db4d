#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "worker/geometry/bounds.h"
#include "worker/geometry/object_ray.h"
#include "worker/math/transform.h"

namespace tessera::render::reference {

/// How near a hit lies to the shape that was hit, as a share of ShapeRay::reach. The slab test lets
/// rays in that miss a box by 2^-20 + 2^-21 + 8 u of it per axis (see enter_leave; u = 2^-24). The
/// triangle test is that of a triangle whose corners moved by at most 9 u of it: u for v - o, then
/// 3 u for the product with a shear of at most 1 and 2 u for the difference, in two axes; its
/// edge functions have the right signs. This is more than twice either.
inline constexpr double kNear = 0x1p-18;

/// The shapes that a structure is built over: anything that has bounds. They are numbered from 0.
///
/// Whoever intersects them promises, of every hit at t on the line of a ray:
/// 1. enter_leave() of its box met it and holds t, so that the ray is at t within kNear * reach of
///    the box, per axis;
/// 2. at some s the ray is within kNear * reach of the convex hull, with
///    |s - t| <= ShapeRay::hull_slack: t is clamped to the box, which moves it by no more than the
///    box is missed by along the axis that decides.
struct ShapeBounds {
  std::span<const Box3f> boxes;  // finite
  std::span<const Vec3f> hulls;  // points_per_hull of each shape; in its box
  std::size_t points_per_hull = 0;

  std::uint32_t size() const { return static_cast<std::uint32_t>(boxes.size()); }
  std::span<const Vec3f> hull(std::uint32_t shape) const {
    return hulls.subspan(shape * points_per_hull, points_per_hull);
  }
  /// Around all of them.
  Box3f all() const {
    Box3f box;
    for (const Box3f& each : boxes) box.extend(each);
    return box;
  }
};

/// A ray made ready for one structure.
struct ShapeRay {
  ObjectRay slabs;
  Vec3d origin, direction;
  Vec3d box_direction;    // 0 where the inverse is infinite: the direction as slabs see it
  double near = 0;        // kNear * reach, reach being the farthest that a plane of `all` is away
  double hull_slack = 0;  // may be infinite
};

/// Makes the ray. `all` must hold all boxes. False where make_object_ray() is.
bool make_shape_ray(const Vec3f& origin, const Vec3f& direction, const Box3f& all, ShapeRay& ray);

/// Whether a ray may hit something in the box at a t in [0, limit]; sets where it enters.
inline bool may_meet(const ObjectRay& ray, const Box3f& box, float limit, float& enter) {
  const EnterLeave t = enter_leave(ray, box.lo, box.hi);
  enter = t.enter;
  return t.enter <= t.leave && t.leave >= 0 && t.enter <= limit;
}

/// A part of a ray, empty if last < first.
struct Segment {
  double first, last;
  bool empty() const { return !(first <= last); }
};

/// The part of a segment with x[axis] <= plane, or (`above`) >= plane, of the ray as slabs see it.
inline Segment clip(const ShapeRay& ray, Segment part, int axis, double plane, bool above) {
  const double d = ray.box_direction[axis], o = ray.origin[axis];
  if (d == 0) {
    return (above ? o < plane : o > plane) ? Segment{0, -1} : part;
  }
  const double t = (plane - o) / d;  // from the plane anew, never by accumulated steps
  if ((d > 0) == above) {
    part.first = t > part.first ? t : part.first;
  } else {
    part.last = t < part.last ? t : part.last;
  }
  return part;
}

/// What a walk cost.
struct TraversalStats {
  std::int64_t nodes = 0;   // or cells
  std::int64_t shapes = 0;  // tested
};

/// A call of a function object that outlives it: bool(std::uint32_t shape).
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

/// A structure over shapes that finds those a ray may hit. Immutable: any thread may walk it.
class ShapeIndex {
 public:
  virtual ~ShapeIndex() = default;
  /// Shows `visit` each shape that is hit at a t in [0, limit], at least once, and others, until it
  /// returns true, which is returned. `limit` is read anew at every step: `visit` may lower it.
  virtual bool walk(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
                    TraversalStats& work) const = 0;
  virtual std::size_t memory_bytes() const = 0;
};

/// Shapes met lately, so that one registered in many cells is tested less often. It is the walk's
/// own, unlike the ray numbers kept with each shape, so that threads share structures.
/// Source: M. Shevtsov, A. Soupikov, A. Kapustin, "Ray-triangle intersection algorithm for modern
/// CPU architectures", GraphiCon 2007 ("inverse mailboxing").
class Mailbox {
 public:
  Mailbox() { met_.fill(UINT32_MAX); }
  /// True for one that is not remembered; remembers it.
  bool add(std::uint32_t shape) {
    std::uint32_t& slot = met_[shape % met_.size()];
    if (slot == shape) return false;
    slot = shape;
    return true;
  }

 private:
  std::array<std::uint32_t, 256> met_;
};

}  // namespace tessera::render::reference
