#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "worker/geometry/ray.h"
#include "worker/light/light_sampler.h"
#include "worker/math/vector.h"
#include "worker/sampling/distribution.h"
#include "worker/sampling/hash.h"
#include "worker/scene/scene.h"
#include "worker/shading/surface/shading_scene.h"

namespace tessera::render {

/// The random numbers of one photon: a function of its key and of how many were drawn, or numbers
/// near those of another photon.
class PhotonRandom {
 public:
  explicit PhotonRandom(std::uint64_t key) : key_(key) {}
  /// Number k differs from base[k], modulo 1, by at most 2^-(closeness + 1). Numbers beyond the end
  /// of `base`, which must outlive this, depend on the key alone.
  PhotonRandom(std::uint64_t key, std::span<const std::uint64_t> base, int closeness)
      : key_(key), base_(base), closeness_(closeness) {}

  /// In [0, 1), a multiple of 2^-24.
  float next() { return unit_float(draw()); }
  Vec2f next_2d() {
    const float x = next();
    const float y = next();
    return {x, y};
  }
  /// In [0, 1), a multiple of 2^-53.
  double next_double() { return static_cast<double>(draw() >> 11) * 0x1p-53; }

  /// Appends all numbers that are drawn from now on, for the `base` of another photon.
  void record(std::vector<std::uint64_t>* drawn) { drawn_ = drawn; }

 private:
  std::uint64_t draw() {
    std::uint64_t number = combine(key_, count_);
    if (count_ < base_.size()) {
      const std::int64_t step = static_cast<std::int64_t>(number) >> closeness_;
      number = base_[count_] + static_cast<std::uint64_t>(step);
    }
    ++count_;
    if (drawn_ != nullptr) drawn_->push_back(number);
    return number;
  }

  std::uint64_t key_;
  std::size_t count_ = 0;
  std::span<const std::uint64_t> base_;
  int closeness_ = 0;
  std::vector<std::uint64_t>* drawn_ = nullptr;
};

/// Emits photons from the lights of a scene, each light in proportion to its estimated power.
/// Media, operands of CSG solids and infinite planes emit none. A moving light emits from its place
/// at the frame's time only.
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
    std::uint64_t light = 0;  // key of a mesh, a shape or the environment
  };
  /// One photon; nullopt if the point chosen emits nothing.
  std::optional<Emission> emit(PhotonRandom* random) const;

 private:
  enum class Kind : std::uint8_t { triangle, shape, punctual, environment };
  struct Light {
    Kind kind;
    TriangleId triangle;       // of a triangle; its instance is that of a shape
    std::size_t punctual = 0;  // index into Scene::lights
    float extent = 0;          // area of both sides that emit; of a shape: radius around `centre`
    Vec3f centre;
  };

  void add(const Light& light, double power);
  void add_emitters();
  void add_shape(std::uint32_t instance, double radiance);
  void add_punctual();
  Emission emit_triangle(const Light& light, PhotonRandom* random) const;
  std::optional<Emission> emit_shape(const Light& light, PhotonRandom* random) const;
  Emission emit_punctual(const PunctualLight& light, PhotonRandom* random) const;
  Emission emit_environment(PhotonRandom* random) const;
  Ray from_outside(const Vec3f& direction, PhotonRandom* random) const;

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
