#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "worker/geometry/ray.h"
#include "worker/light/emitters/environment_map.h"
#include "worker/light/tree/light_bounds.h"
#include "worker/light/tree/light_tree.h"
#include "worker/light/emitters/shape_light.h"
#include "worker/light/emitters/spherical_rectangle.h"
#include "worker/light/emitters/spherical_triangle.h"
#include "worker/math/vector.h"
#include "worker/sampling/distribution.h"
#include "worker/scene/scene.h"
#include "worker/shading/surface/shading_scene.h"

namespace tessera::render {

class EmittedRadiance;

/// Random numbers for one light sample.
struct LightRandom {
  double select = 0;  // [0, 1), at least 32 bits
  double u1 = 0, u2 = 0;
};

/// One way light may reach a point, before it is known whether anything stands between.
struct LightSample {
  Vec3f direction;  // unit, towards the light
  Vec3f target;     // world, where the light is; unused if `distant`
  bool distant = false;
  TriangleId triangle;      // the emitter, which does not shadow itself
  Vec3f radiance_over_pdf;  // radiance (or irradiance of delta lights) / density
  float pdf = 0;            // over solid angle, selection included; 0 for delta lights
};

/// All lights of a scene and how to choose among them: the sky, lights without a place (directional
/// ones, by power) and those with a place (by a LightTree), each kind by the irradiance it may
/// give. A point of an emitter has positive density wherever it gives light.
class LightSampler {
 public:
  /// Which lights are looked for. `none`: light is found where rays meet it by chance, which is
  /// slow and leaves out lights without a surface: the independent estimator of tests.
  enum class LightSampling : std::uint8_t { all, none };

  /// Both must outlive the table.
  LightSampler(const Scene& scene, const ShadingScene& shading, LightSampling sought = LightSampling::all);

  /// Whether sample() can ever give light: false leaves everything to chance hits.
  bool samples_anything() const { return sky_irradiance_ > 0 || has_local_lights(); }

  /// A light for `receiver`. False when the draw gives no light there.
  bool sample(const LightSampleContext& receiver, const LightRandom& u, LightSample* sample) const;

  /// Where a light is that matters to `receiver`, for u in [0, 1): its middle. False if no light
  /// has a place.
  bool place_of_one(const LightSampleContext& receiver, double u, Vec3d* place) const {
    if (tree_.empty()) return false;
    *place = Vec3d(entries_[tree_.choose(receiver, u).light].centre);
    return true;
  }

  /// Density with which sample() would have drawn, for `receiver`, the emissive triangle that a ray
  /// from there met after `distance`; 0 if never. `cos_light` is the absolute cosine there.
  float emitter_pdf(const LightSampleContext& receiver, const TriangleId& id, float distance,
                    float cos_light) const;
  /// The sky's radiance from `direction`, with the density of sample() there for `receiver`.
  /// Requires a sky.
  EnvironmentMap::Lookup sky(const LightSampleContext& receiver, const Vec3f& direction) const {
    EnvironmentMap::Lookup found = environment_->look_up(direction);
    if (found.pdf > 0) found.pdf *= static_cast<float>(shares(receiver).sky);
    return found;
  }

  /// Null without a sky.
  const EnvironmentMap* environment() const { return environment_.get(); }
  std::int64_t memory_bytes() const;

 private:
  /// An emissive triangle, or two that make a rectangle, a shape that emits, or a punctual light.
  struct Entry {
    TriangleId triangle;
    std::uint32_t other = kNoTriangle;  // the second triangle of a rectangle
    bool merged = false;                // is the second triangle of the entry before
    std::uint8_t right_angle = 0, other_right_angle = 0;  // corners of a rectangle's triangles
    std::int32_t punctual = kNone;
    std::int32_t shape = kNone;  // of shapes_; its instance is that of `triangle`
    bool moves = false;          // while the shutter is open: looked up at the receiver's time
    bool special = false;        // a shape, or it moves
    bool even = false;           // a plane that shines alike all over: only its side matters
    Vec3f normal;                // of that plane: world_normal()
    float density = 0;           // of a point on it: 1 / area, 1 for punctual lights
    Vec3f centre;
    float reach2 = 0;  // squared distance from it within which they are seen under a large angle
  };

  static constexpr std::uint32_t kNoTriangle = UINT32_MAX;
  void add_emitters(const Scene& scene, std::vector<LightBounds>& bounds);
  void add_triangles(const Scene& scene, const TriangleId& first, EmittedRadiance& radiance,
                     std::vector<LightBounds>& bounds);
  void merge_rectangles(const Instance& instance, const Primitive& p, std::size_t first,
                        std::vector<LightBounds>& bounds);
  void add_shape(const Scene& scene, std::uint32_t instance, std::vector<LightBounds>& bounds);
  void add_punctual(const Scene& scene, std::vector<LightBounds>& bounds);
  bool has_local_lights() const { return !tree_.empty() || !distant_.empty(); }
  /// Probabilities of the three kinds; those of kinds that are not there are 0.
  struct Shares {
    double sky = 0, distant = 0, tree = 0;
  };
  Shares shares(const LightSampleContext& receiver) const;
  bool sample_sky(float share, const LightRandom& u, LightSample* sample) const;
  bool sample_distant(double u, float time, float share, LightSample* sample) const;
  Vec3d corner_from(const Entry& entry, std::uint32_t triangle, std::size_t corner,
                    const Vec3f& point) const;
  bool may_be_near(const Entry& entry, const Vec3f& point) const;
  SphericalTriangle near_triangle(const Entry& entry, const Vec3f& point) const;
  SphericalRectangle near_rectangle(const Entry& entry, const Vec3f& point) const;
  /// A triangle, and where on it.
  struct Place {
    TriangleId triangle;
    Vec2f weights;           // barycentrics of the second and third corner
    double solid_angle = 0;  // of the emitter; 0 where it is sampled by area
  };
  Place place_on(const Entry& entry, const Vec3f& point, const LightRandom& u) const;
  /// What an emitter gives off at a place against `direction`, and the cosine there.
  struct Emitted {
    Vec3f radiance;
    float cosine;
  };
  Emitted emitted(const Entry& entry, const Place& place, const Vec3f& direction) const;
  bool sample_emitter(const Entry& entry, float share, const Vec3f& point, const LightRandom& u,
                      LightSample* sample) const;
  bool sample_special(const Entry& entry, float share, const LightSampleContext& receiver,
                      const LightRandom& u, LightSample* sample) const;
  bool sample_shape(const Entry& entry, float share, const Vec3f& point, const LightRandom& u,
                    LightSample* sample) const;
  static bool sample_point_light(const PunctualLight& light, const PunctualPose& pose, float share,
                                 const Vec3f& point, LightSample* sample);
  // Of what moves, at the receiver's time:
  bool sample_moving_triangle(const Entry& entry, float share, const LightSampleContext& receiver,
                              const LightRandom& u, LightSample* sample) const;
  bool sample_moving_shape(const Entry& entry, float share, const LightSampleContext& receiver,
                           const LightRandom& u, LightSample* sample) const;
  float special_pdf(const Entry& entry, double share, const LightSampleContext& receiver,
                    const TriangleId& id, float distance, float cos_light) const;

  const ShadingScene& shading_;
  const std::vector<PunctualLight>& punctual_;
  std::unique_ptr<EnvironmentMap> environment_;
  double sky_irradiance_ = 0;  // of a sky worth sampling, on average over all normals
  std::vector<Entry> entries_;
  std::vector<ShapeLight> shapes_;
  LightTree tree_;                         // over entries; directional lights have no leaf
  std::vector<std::uint32_t> distant_;     // entries of directional lights
  DiscreteDistribution distant_choice_;    // over distant_, by irradiance
  std::vector<std::uint32_t> slot_first_;  // per instance: first of its primitives' slots
  std::vector<std::int64_t> slots_;        // per instance and primitive: first entry or kNone
};

/// From density over a triangle's area to density over the solid angle it is seen under.
inline float solid_angle_density(float per_area, float distance, float cos_light) {
  if (!(cos_light > 0)) return std::numeric_limits<float>::infinity();
  return per_area * distance * distance / cos_light;
}

/// Veach's power heuristic for a sample of density `pdf` against one other strategy, from the
/// ratio, so that no square of a density overflows. Requires pdf > 0.
inline float power_heuristic(float pdf, float other) {
  const float r = other / pdf;
  return 1 / (1 + r * r);
}

}  // namespace tessera::render
