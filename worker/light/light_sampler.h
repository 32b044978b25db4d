#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "worker/geometry/ray.h"
#include "worker/light/emitters/environment_map.h"
#include "worker/light/emitters/shape_light.h"
#include "worker/light/emitters/spherical_rectangle.h"
#include "worker/light/emitters/spherical_triangle.h"
#include "worker/light/emitters/volume_light.h"
#include "worker/light/tree/light_bounds.h"
#include "worker/light/tree/light_tree.h"
#include "worker/math/vector.h"
#include "worker/sampling/distribution.h"
#include "worker/scene/scene.h"
#include "worker/shading/surface/shading_scene.h"

namespace tessera::render {

/// Mean emitted radiance of triangles (worker/light/emitters/emissive_power.h).
class EmittedRadiance;

/// Random numbers for one light sample.
struct LightRandom {
  double select = 0;  // [0, 1), at least 32 bits
  double u1 = 0, u2 = 0;
  double u3 = 0;           // [0, 1); distance in a volume
  std::uint64_t bits = 0;  // hash from which volumes derive another number
};

/// A direction from which light may reach a point, before visibility is tested.
struct LightSample {
  Vec3f direction;  // unit, towards the light
  Vec3f target;     // point on the light, world; unset if `distant`
  bool distant = false;
  TriangleId triangle;                    // the emitter, which does not shadow itself
  std::uint32_t body = 0;                 // of `filling`
  const MaterialView* filling = nullptr;  // if set, `target` must be inside that body's medium
  Vec3f radiance_over_pdf;  // radiance, or irradiance of a delta light, / pdf; of a medium, that
                            // which a ray would gather without loss on its way
  float pdf = 0;            // over solid angle, including the choice of light; 0 for delta lights
};

/// All lights of a scene and how to sample them: the environment map, directional lights (by power)
/// and lights with a position (by a LightTree). The three groups are chosen by the irradiance they
/// may cause. Every point of an emitter has positive density wherever it gives light.
class LightSampler {
 public:
  /// Light sampling mode. `none`: lights are found by BSDF sampling only, which is slow and misses
  /// lights without a surface; an independent estimator for tests.
  enum class LightSampling : std::uint8_t { all, none };

  /// Both must outlive the sampler.
  LightSampler(const Scene& scene, const ShadingScene& shading,
               LightSampling sampling = LightSampling::all);

  /// Returns whether sample() can ever return light; if not, only BSDF sampling finds lights.
  bool samples_anything() const { return environment_irradiance_ > 0 || has_local_lights(); }

  /// Samples a light for `context`. False if the sample contributes nothing.
  bool sample(const LightSampleContext& context, const LightRandom& u, LightSample* sample) const;

  /// Centre of a light that is important for `context`, for u in [0, 1). False if no light has a
  /// position.
  bool choose_light_position(const LightSampleContext& context, double u, Vec3d* position) const {
    if (tree_.empty()) return false;
    *position = Vec3d(entries_[tree_.choose(context, u).light].centre);
    return true;
  }

  /// Density with which sample() would have sampled, for `context`, the point of an emissive
  /// triangle that a ray from there hit after `distance`; 0 if never. `cos_light` is the absolute
  /// cosine at the emitter.
  float emitter_pdf(const LightSampleContext& context, const TriangleId& id, float distance,
                    float cos_light) const;
  /// The emissive medium of `material` inside a body; null if it is left to BSDF sampling.
  const VolumeLight* find_volume(std::uint32_t body, const MaterialView& material) const;
  /// Density with which sample() would have sampled, for `context`, the direction of a ray from
  /// there that meets a light of find_volume().
  float volume_pdf(const LightSampleContext& context, const VolumeLight& light) const;
  /// Radiance of the environment from `direction`, with the density of sample() there for
  /// `context`. Requires an environment.
  EnvironmentMap::Lookup environment(const LightSampleContext& context,
                                     const Vec3f& direction) const {
    EnvironmentMap::Lookup found = environment_->look_up(direction);
    if (found.pdf > 0) found.pdf *= static_cast<float>(shares(context).environment);
    return found;
  }

  /// Null without an environment.
  const EnvironmentMap* environment() const { return environment_.get(); }
  std::int64_t memory_bytes() const;

 private:
  /// An emissive triangle, two that form a rectangle, an emissive shape or medium, or a punctual
  /// light.
  struct Entry {
    TriangleId triangle;
    std::uint32_t other = kNoTriangle;  // the second triangle of a rectangle
    bool merged = false;                // it is the second triangle of the preceding entry
    std::uint8_t right_angle = 0,
                 other_right_angle = 0;  // right-angled corners of a rectangle's triangles
    std::int32_t punctual = kNone;
    std::int32_t shape = kNone;   // index into shapes_; its instance is that of `triangle`
    std::int32_t volume = kNone;  // index into volumes_
    bool moves = false;           // during the exposure; evaluated at the time of the context
    bool special = false;         // a shape or a medium, or it moves
    bool uniform = false;         // planar and of uniform emission: only its side matters
    Vec3f normal;                 // of that plane: world_normal()
    float density = 0;            // per area of points on it: 1 / area; 1 for punctual lights
    Vec3f centre;
    float reach2 = 0;  // squared distance from `centre` within which it subtends a large angle
  };

  static constexpr std::uint32_t kNoTriangle = UINT32_MAX;
  void add_emitters(const Scene& scene, std::vector<LightBounds>& bounds);
  void add_triangles(const Scene& scene, const TriangleId& first, EmittedRadiance& radiance,
                     std::vector<LightBounds>& bounds);
  void merge_rectangles(const Instance& instance, const Primitive& p, std::size_t first,
                        std::vector<LightBounds>& bounds);
  void add_shape(const Scene& scene, std::uint32_t instance, std::vector<LightBounds>& bounds);
  void add_volumes(const Scene& scene, std::vector<LightBounds>& bounds);
  void add_volume(const Scene& scene, std::uint32_t instance, const MaterialView& material,
                  MeshBoxes& boxes, std::vector<LightBounds>& bounds);
  void add_punctual(const Scene& scene, std::vector<LightBounds>& bounds);
  bool has_local_lights() const { return !tree_.empty() || !distant_.empty(); }
  /// Probabilities of choosing the environment, a directional light or a light of the tree.
  struct Shares {
    double environment = 0, distant = 0, tree = 0;
  };
  Shares shares(const LightSampleContext& context) const;
  bool sample_environment(float share, const LightRandom& u, LightSample* sample) const;
  bool sample_distant(double u, float time, float share, LightSample* sample) const;
  Vec3d corner_from(const Entry& entry, std::uint32_t triangle, std::size_t corner,
                    const Vec3f& point) const;
  bool may_be_near(const Entry& entry, const Vec3f& point) const;
  SphericalTriangle near_triangle(const Entry& entry, const Vec3f& point) const;
  SphericalRectangle near_rectangle(const Entry& entry, const Vec3f& point) const;
  /// A point on a triangle.
  struct LightPoint {
    TriangleId triangle;
    Vec2f weights;           // barycentrics of the second and third vertex
    double solid_angle = 0;  // of the emitter; 0 if it is sampled by area
  };
  LightPoint sample_point_on(const Entry& entry, const Vec3f& point, const LightRandom& u) const;
  /// Emission of a light towards -direction, and the cosine there.
  struct Emitted {
    Vec3f radiance;
    float cosine;
  };
  Emitted emitted(const Entry& entry, const LightPoint& light_point, const Vec3f& direction) const;
  bool sample_emitter(const Entry& entry, float share, const Vec3f& point, const LightRandom& u,
                      LightSample* sample) const;
  bool sample_special(const Entry& entry, float share, const LightSampleContext& context,
                      const LightRandom& u, LightSample* sample) const;
  bool sample_shape(const Entry& entry, float share, const LightSampleContext& context,
                    const LightRandom& u, LightSample* sample) const;
  bool sample_volume(const VolumeLight& light, float share, const LightSampleContext& context,
                     const LightRandom& u, LightSample* sample) const;
  static bool sample_point_light(const PunctualLight& light, const PunctualPose& pose, float share,
                                 const Vec3f& point, LightSample* sample);
  // Moving lights, at the time of the context:
  bool sample_moving_triangle(const Entry& entry, float share, const LightSampleContext& context,
                              const LightRandom& u, LightSample* sample) const;
  bool sample_moving_shape(const Entry& entry, float share, const LightSampleContext& context,
                           const LightRandom& u, LightSample* sample) const;
  float special_pdf(const Entry& entry, double share, const LightSampleContext& context,
                    const TriangleId& id, float distance, float cos_light) const;

  const ShadingScene& shading_;
  const std::vector<PunctualLight>& punctual_;
  std::unique_ptr<EnvironmentMap> environment_;
  double environment_irradiance_ = 0;  // mean over all normals; 0: left to BSDF sampling
  std::vector<Entry> entries_;
  std::vector<ShapeLight> shapes_;
  std::vector<VolumeLight> volumes_;           // by body
  std::vector<std::uint32_t> volume_entries_;  // parallel to volumes_
  LightTree tree_;                             // over entries_ without directional lights
  std::vector<std::uint32_t> distant_;         // entries of directional lights
  DiscreteDistribution distant_choice_;        // over distant_, by irradiance
  std::vector<std::uint32_t> slot_first_;      // per instance: index of its first slot
  std::vector<std::int64_t> slots_;            // per instance and primitive: first entry or kNone
};

/// Converts a density over area to one over solid angle.
inline float solid_angle_density(float per_area, float distance, float cos_light) {
  if (!(cos_light > 0)) return std::numeric_limits<float>::infinity();
  return per_area * distance * distance / cos_light;
}

/// Veach's power heuristic for a sample of density `pdf` and one other strategy of density `other`.
/// Uses their ratio, so no square overflows. Requires pdf > 0.
inline float power_heuristic(float pdf, float other) {
  const float r = other / pdf;
  return 1 / (1 + r * r);
}

}  // namespace tessera::render
