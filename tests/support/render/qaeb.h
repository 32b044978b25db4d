#pragma once

#include <cstddef>
#include <memory>

#include "worker/accel/accelerator.h"
#include "worker/geometry/shapes/terrain/terrain_field.h"
#include "worker/scene/scene.h"

namespace tessera::testing {

/// Quasi-analytic, error-bounded ray tracing of a terrain, as published: the ray advances in steps
/// that are a fixed fraction of the distance from the camera until it is on the other side of the
/// ground, and the hit is interpolated linearly between the last two heights. It evaluates heights
/// at points only and knows no bounds of them. worker/geometry/shapes/terrain/terrain_line.cpp
/// replaces it.
///
/// Where the ray changes sides between two samples it has a hit in between, so the error of t is at
/// most one step. Ground that the ray enters and leaves between two samples is missed.
///
/// Source: F. K. Musgrave, "QAEB rendering for procedural models" (Texturing & Modeling: A
/// Procedural Approach, 3rd edition, 2003, chapter 17).
class QaebTerrain final : public render::Accelerator {
 public:
  /// The scene's only instance is a terrain without a depth, in world space. A step is `error`
  /// times the distance from `eye`, or from a point `near` away if that is nearer. Requires error >
  /// 0 and near > 0.
  QaebTerrain(const render::Scene& scene, const render::Vec3d& eye, double error, double near);

  bool closest_hit(const render::Ray& ray, const render::HitFilter* filter,
                   render::Hit& hit) const override;
  bool any_hit(const render::Ray& ray, const render::HitFilter* filter) const override;
  std::size_t memory_bytes() const override { return sizeof *this; }

  /// Length of the step from a point, metres: the bound of the error of a hit behind it.
  double step_from(const render::Vec3d& p) const;

 private:
  /// The hit between two points of a ray on different sides of the ground.
  render::Hit between(const render::Vec3d& p, const render::Vec3d& q, double from, double to) const;

  std::shared_ptr<const render::Shape> shape_;
  render::Vec3d eye_;
  double error_, near_;
};

}  // namespace tessera::testing
