#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "worker/geometry/ray.h"
#include "worker/guide/direction_tree.h"
#include "worker/light/light_sampler.h"
#include "worker/math/vector.h"
#include "worker/sampling/distribution.h"
#include "worker/sampling/hash.h"
#include "worker/scene/scene.h"
#include "worker/shading/surface/shading_scene.h"

namespace tessera::render {

/// The random numbers of one photon: a function of its key and of how many were drawn.
class PhotonRandom {
 public:
  explicit PhotonRandom(std::uint64_t key) : key_(key) {}
  /// In [0, 1), a multiple of 2^-24.
  float next() { return unit_float(draw()); }
  Vec2f next_2d() {
    const float x = next();
    const float y = next();
    return {x, y};
  }
  /// In [0, 1), a multiple of 2^-53.
  double next_double() { return static_cast<double>(draw() >> 11) * 0x1p-53; }

 private:
  std::uint64_t draw() { return combine(key_, count_++); }
  std::uint64_t key_, count_ = 0;
};

/// The numbers from which the directions of photons are made, with more photons where more useful
/// ones came from. Immutable.
class PhotonAim {
 public:
  /// A photon that was useful: its number of PhotonSource::Emission, and how useful it was.
  struct Useful {
    std::uint32_t group = 0;
    Vec2f start;
    float weight = 0;
  };

  /// Aims at nothing.
  PhotonAim() = default;
  explicit PhotonAim(std::span<const Useful> useful);

  /// A point of [0, 1)^2 for a photon of a group of lights, and by how much the photon's flux
  /// changes: the reciprocal of the density.
  struct Start {
    Vec2f point;
    float flux = 1;
  };
  Start sample(std::uint32_t group, PhotonRandom* random) const;

 private:
  std::vector<std::vector<DirectionNode>> trees_;  // by group; empty: uniform
};

/// Emits photons from the lights of a scene, each light in proportion to its estimated power. Does
/// not emit from media, operands of CSG solids, infinite planes, or the ends of moving lights:
/// these emit from their place at the frame's time.
class PhotonSource {
 public:
  /// All must outlive the source.
  PhotonSource(const Scene& scene, const ShadingScene& shading, const LightSampler& lights);

  bool empty() const { return choice_.empty(); }

  struct Emission {
    Ray ray;
    Vec3f flux;               // relative to the mean of all photons
    bool is_found = true;     // light sampling finds this light at the first surface
    bool is_point = false;    // no ray can hit this light
    std::uint32_t group = 0;  // of lights that are aimed together
    Vec2f start;              // from which its direction or, of directional light, place is made
  };
  /// One photon; nullopt if the point chosen emits nothing.
  std::optional<Emission> emit(const PhotonAim& aim, PhotonRandom* random) const;

 private:
  enum class Kind : std::uint8_t { triangle, shape, punctual, environment };
  struct Light {
    Kind kind;
    TriangleId triangle;       // of a triangle; its instance is that of a shape
    std::size_t punctual = 0;  // index into Scene::lights
    float extent = 0;          // area of both sides that emit; of a shape: radius around `centre`
    Vec3f centre;
    std::uint32_t group = 0;
  };

  void add(Light light, double power);
  void add_emitters();
  void add_shape(std::uint32_t instance, double radiance);
  void add_punctual();
  Emission emit_triangle(const Light& light, Vec2f start, PhotonRandom* random) const;
  std::optional<Emission> emit_shape(const Light& light, const Vec2f& start,
                                     PhotonRandom* random) const;
  Emission emit_punctual(const PunctualLight& light, const Vec2f& start) const;
  Emission emit_environment(const Vec2f& start, PhotonRandom* random) const;
  Ray from_outside(const Vec3f& direction, const Vec2f& u) const;

  const Scene& scene_;
  const ShadingScene& shading_;
  const LightSampler& lights_;
  Vec3f centre_;      // of the sphere around the scene
  float radius_ = 0;  // 0: the scene is empty
  std::vector<Light> emitters_;
  std::vector<double> powers_;
  DiscreteDistribution choice_;
};

}  // namespace tessera::render
