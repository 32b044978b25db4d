#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "worker/accel/scene_accel.h"
#include "worker/geometry/ray.h"
#include "worker/media/medium_stack.h"
#include "worker/sampling/sampler.h"
#include "worker/shading/surface/shading_scene.h"

namespace tessera::render {

/// The part of a ray that lies in one medium, metres from the ray's origin.
struct MediumSegment {
  const MediumView* medium = nullptr;
  Vec3d origin, direction;  // of the ray; unit
  double begin = 0, end = 0;
  std::optional<Affine3d> inwards;  // of an uneven medium that a body has in its own space

  bool empty() const { return !(begin < end); }
  double length() const { return end - begin; }
  Vec3d at(double t) const { return origin + direction * t; }
  float density(double t) const {
    return density_at(*medium, inwards ? &*inwards : nullptr, at(t));
  }
};

/// What of [begin, end] along a ray, in multiples of its unit direction, has a medium for a path
/// that is in `interior`: that of the body that is there, or the scene's, as far as it reaches.
MediumSegment stretch_along(const ShadingScene& scene, const MediumStack& interior, const Ray& ray,
                      double begin, double end);

/// As many random numbers as an uneven medium takes. Which ones a path uses follows from what it
/// did before, so they are as much its own as its dimensions are.
class HashSequence {
 public:
  explicit HashSequence(const Sampler& sampler) : sampler_(&sampler) {}
  float next() { return unit_float(sampler_->hash(combine(kPurpose, drawn_++))); }

 private:
  static constexpr std::uint64_t kPurpose = 0x6d656469756d7301ULL;
  const Sampler* sampler_;
  std::uint64_t drawn_ = 0;
};

/// Share of light that passes the stretch: Beer's law, or where the density varies an estimate by
/// ratio tracking. Source: J. Novak et al., "Residual ratio tracking", 2014.
Vec3f transmittance(const MediumSegment& stretch, HashSequence* chance);

/// Whether a path collides on the stretch of an uneven medium, and how many metres from the ray's
/// origin; `throughput` is weighted as it is then. By delta tracking: collisions with a medium as
/// dense everywhere as its densest part, some of which are with nothing. At each the weights of all
/// channels follow those of one decision, so they are unbiased in colour too.
/// Source: E. Woodcock et al., 1965; PBR 4e, section 14.1.
bool collides_unevenly(const MediumSegment& stretch, HashSequence* chance, Vec3f* throughput, double* at);

/// A surface of a body that a ray crosses.
struct Crossing {
  float t;
  TriangleId id;
  Body body;
  bool inwards;
};

/// Gathers the surfaces of bodies on a ray, in scratch memory of a thread.
class Crossings {
 public:
  static constexpr std::size_t kMost = 1024;

  void clear() { count_ = 0; }
  /// False if there is no room.
  bool add(const ShadingScene& scene, const Hit& hit, const Vec3f& direction, float time);
  /// All of them along the ray, in order of (t, id), each once.
  std::span<const Crossing> in_order();

 private:
  std::size_t count_ = 0;
  std::array<Crossing, kMost> all_;
  MovedSurface moved_;
};

/// The bodies around the start of a ray: those whose surface it first meets from inside.
MediumStack interior_at_start(const ShadingScene& scene, const SceneAccel& accel, const Ray& ray,
                           Crossings* crossings);

/// Share of light that passes all media along the ray up to its t_max, from `interior` on, over the
/// surfaces it crosses; 0 if one of them is seen.
Vec3f transmittance_across(const ShadingScene& scene, MediumStack interior, const Ray& ray,
                           std::span<const Crossing> crossed, HashSequence* chance);

}  // namespace tessera::render
