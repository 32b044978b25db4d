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

/// Part of a ray that lies in one medium, metres from the ray's origin.
struct MediumSegment {
  const MediumView* medium = nullptr;
  Vec3d origin, direction;  // of the ray; unit
  double begin = 0, end = 0;
  std::optional<Affine3d> inwards;  // for a heterogeneous medium in the object space of a body

  bool empty() const { return !(begin < end); }
  double length() const { return end - begin; }
  Vec3d at(double t) const { return origin + direction * t; }
  float density(double t) const {
    return density_at(*medium, inwards ? &*inwards : nullptr, at(t));
  }
};

/// The medium of the topmost body, or the scene's atmosphere; it may be absent.
inline const MediumView& medium_in(const ShadingScene& scene, const MediumStack& stack) {
  const Body* body = stack.top();
  return body != nullptr ? body->material->medium : scene.atmosphere;
}

/// The part of [begin, end] along a ray (multiples of its unit direction) that lies in a medium,
/// for a path whose nested bodies are `stack`: the medium of the topmost body, or the scene's
/// atmosphere as far as it extends.
MediumSegment segment_along(const ShadingScene& scene, const MediumStack& stack, const Ray& ray,
                            double begin, double end);

/// Random numbers for tracking in heterogeneous media, which need an unbounded count. They depend
/// only on the sample and on the earlier events of the path, not on threads or tiles.
class HashSequence {
 public:
  explicit HashSequence(const Sampler& sampler) : sampler_(&sampler) {}
  float next() { return unit_float(sampler_->hash(combine(kPurpose, drawn_++))); }

 private:
  static constexpr std::uint64_t kPurpose = 0x6d656469756d7301ULL;
  const Sampler* sampler_;
  std::uint64_t drawn_ = 0;
};

/// Transmittance of a segment: Beer's law, or for varying density an estimate by ratio tracking.
/// Source: J. Novak et al., "Residual ratio tracking", 2014.
Vec3f transmittance(const MediumSegment& segment, HashSequence* random);

/// Radiance that a segment emits towards its beginning, with absorption and scattering on the way:
/// the integral of transmittance times emission, or for varying density an estimate by one point
/// per stratum of distance. Source: F. Simon et al., "Line integration for rendering heterogeneous
/// emissive volumes", 2017.
Vec3f emission_along(const MediumSegment& segment, HashSequence* random);

/// Delta tracking: returns whether a path collides on a segment of a heterogeneous medium, and the
/// distance from the ray's origin; weights `throughput` accordingly. Null collisions are chosen by
/// one decision for all channels, whose weights keep the estimate of each channel unbiased. Source:
/// E. Woodcock et al., 1965; PBR 4e, section 14.1.
bool collides_heterogeneous(const MediumSegment& segment, HashSequence* random, Vec3f* throughput,
                            double* at);

/// A surface of a body that a ray crosses.
struct Crossing {
  float t;
  TriangleId id;
  Body body;
  bool inwards;
};

/// Collects the surfaces of bodies along a ray, in scratch memory of a thread.
class Crossings {
 public:
  static constexpr std::size_t kMaxCrossings = 1024;

  void clear() { count_ = 0; }
  /// Returns false if the buffer is full.
  bool add(const ShadingScene& scene, const Hit& hit, const Vec3f& direction, float time);
  /// All crossings in order of (t, id), without duplicates.
  std::span<const Crossing> in_order();

 private:
  std::size_t count_ = 0;
  std::array<Crossing, kMaxCrossings> all_;
  MovedSurface moved_;
};

/// Bodies around the start of a ray: those that it leaves without having entered them.
MediumStack initial_medium_stack(const ShadingScene& scene, const SceneAccel& accel, const Ray& ray,
                                 Crossings* crossings);

/// Transmittance of all media along the ray up to its t_max, across the surfaces in `crossed`; 0 if
/// one of them is visible. Turns `stack`, the bodies around the ray's start, into those around its
/// end, unless the result is 0.
Vec3f transmittance_across(const ShadingScene& scene, const Ray& ray,
                           std::span<const Crossing> crossed, MediumStack* stack,
                           HashSequence* random);

}  // namespace tessera::render
