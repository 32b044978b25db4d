#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <optional>

#include "worker/accel/scene_accel.h"
#include "worker/geometry/surface_point.h"
#include "worker/light/light_sampler.h"
#include "worker/math/elementary.h"
#include "worker/math/vector.h"
#include "worker/media/media.h"
#include "worker/media/medium_stack.h"
#include "worker/media/medium_traversal.h"
#include "worker/media/phase.h"
#include "worker/render/path/path_observer.h"
#include "worker/render/path/transparency.h"
#include "worker/sampling/dimensions.h"
#include "worker/sampling/equi_angular.h"
#include "worker/sampling/sampler.h"
#include "worker/shading/surface/shading_scene.h"
#include "worker/shading/surface/surface.h"

namespace tessera::render {

/// The low 20 bits as a number in [0, 1).
inline double fraction(std::uint64_t bits) {
  return static_cast<double>(bits & 0xfffffu) * 0x1p-20;
}

/// State of a path that tracks the bodies it is in and scatters between surfaces.
struct MediaState {
  explicit MediaState(const Sampler& sampler) : random(sampler) {}
  MediumStack stack;
  MediumTraversal traversal;
  HashSequence random;
};

/// Whether a path scattered or ended in a medium on its way to the next surface.
enum class Passage : std::uint8_t { none, scattered, ended };

/// The members of PathTracer that only scenes with media or nested bodies use.
///
/// A base class of its `Tracer`, which is PathTracer of path_tracer.cpp and declares this class a
/// friend: members here use the tracer's path, sampler, frame, scratch memory and MediaState.
/// A template, so that it is compiled together with its callers.
template <typename Tracer>
class PathMedia {
 protected:
  /// Crosses the surface without shading it if it is only the boundary of a medium, or hidden in a
  /// solid of higher priority; then the path continues behind it. Returns whether it did.
  bool passes_unseen(const ShadingPoint& point, const Hit& hit, const SurfacePoint& position);

  /// PathTracer::light_through() for scenes with bodies that light may cross straight.
  Vec3f light_through_bodies(const Ray& ray, const LightSample& light);

  /// Adds the emission along a segment of the path, weighted against light sampling by the
  /// densities of the direction: both strategies estimate the radiance along it. Rounding at an
  /// edge may hide the way out of a body, so the segment ends at the hull of the body at the
  /// latest.
  void add_emission_along(MediumSegment segment);

  /// Follows the path for `distance` metres that hold no surface.
  ///
  /// Light that is scattered once more on the way is sampled in two ways, weighted by their
  /// densities along the ray: where the path collides, and near a light (EquiAngular). The light to
  /// be near to is chosen independently of the distance, and for each light the weights add up to
  /// one, so the probability of that choice cancels.
  Passage cross_medium(double distance);

 private:
  /// Distribution of distances near a light, which is chosen for a point about as far on as
  /// collisions are likely. None if no light has a position, and beyond max_depth, where the path
  /// is traced for the report only.
  std::optional<EquiAngular> choose_equi_angular(const MediumSegment& segment, double select);

  /// Scatters the path at `position`, where it collided; `weight` is the MIS weight of the light
  /// sampled there. Returns false if the path ends.
  bool scatter_in_medium(const MediumView& medium, const Vec3f& position, float weight);

  /// Adds sampled light that reaches `position` and is scattered there into the path. `set` are the
  /// sampler's dimensions.
  void add_light_in_medium(const MediumView& medium, const Vec3f& position, const Vec3f& throughput,
                           std::uint32_t set);

  Tracer& tracer() { return static_cast<Tracer&>(*this); }
};

template <typename Tracer>
bool PathMedia<Tracer>::passes_unseen(const ShadingPoint& point, const Hit& hit,
                                      const SurfacePoint& position) {
  if ((point.material->traits & kTraitCrossed) == 0) return false;
  MediumStack& stack = tracer().media_.stack;
  const Body body = body_of(point);
  const bool visible = point.material->rank != kBoundaryRank && !stack.hides(body);
  if (visible) return false;
  stack.cross(body, point.front);
  if (PathObserver* observer = tracer().scratch_->observer) [[unlikely]]
    observer->on_pass(tracer().path_.throughput);
  tracer().continue_behind(hit, position);
  return true;
}

template <typename Tracer>
Vec3f PathMedia<Tracer>::light_through_bodies(const Ray& ray, const LightSample& light) {
  Tracer& t = tracer();
  const ShadingScene& scene = t.frame_.shading;
  ThinSurfaceStack& thin_surfaces = t.scratch_->thin_surfaces;
  Crossings& crossings = *t.scratch_->crossings;
  thin_surfaces.passed = thin_surfaces.count = 0;
  crossings.clear();
  const auto traits =
      static_cast<std::uint8_t>(scene.traits & (kTraitAlpha | kTraitUnlit | kTraitStraight));
  const ShadowFilter filter{scene,           {t.sampler_, t.bounce(), RayKind::shadow},
                            light.direction, light.triangle,
                            traits,          &thin_surfaces,
                            ray.time,        &t.scratch_->passed};
  bool full = false;
  const bool blocked = t.frame_.accel.any_hit(ray, [&](const Hit& hit) {
    if (hit.id == light.triangle) return false;
    if ((scene.primitive(hit.id).traits & kTraitCrossed) == 0) return filter(hit);
    full = !crossings.add(scene, hit, light.direction, ray.time) || full;
    return false;
  });
  if (blocked) return {};  // before looking at what was met: that depends on the traversal's order
  if (full || thin_surfaces.passed > kTransparencyLimit) {
    ++t.path_.result.limit_count;
    return {};
  }
  MediumStack stack = t.media_.stack;
  const Vec3f arrives =
      transmittance_across(scene, ray, crossings.in_order(), &stack, &t.media_.random);
  if (light.filling != nullptr) [[unlikely]] {
    const Body* body = stack.top();
    if (body == nullptr || body->id != light.body || body->material != light.filling) return {};
  }
  return thin_surfaces.transmittance() * arrives;
}

template <typename Tracer>
void PathMedia<Tracer>::add_emission_along(MediumSegment segment) {
  auto& path = tracer().path_;
  MediaState& media = tracer().media_;
  const LightSampler& lights = tracer().frame_.lights;
  const Body* body = media.stack.top();
  const VolumeLight* glow =
      body == nullptr ? nullptr : lights.find_volume(body->id, *body->material);
  if (glow != nullptr) {
    const auto chord = glow->hull().chord(segment.origin, segment.direction);
    if (!chord) return;
    segment.begin = std::max(segment.begin, chord->begin);
    segment.end = std::min(segment.end, chord->end);
  }
  if (body != nullptr && !(segment.end < INFINITY)) return;
  Vec3f light = path.throughput * emission_along(segment, &media.random);
  if (!(max_component(light) > 0)) return;
  float weight = 1;
  if (glow != nullptr && !path.specular_bounce) {
    weight = power_heuristic(path.pdf, lights.volume_pdf(path.scattered_at, *glow));
    light *= weight;
  }
  path.result.radiance += light;
  if (PathObserver* observer = tracer().scratch_->observer) [[unlikely]]
    observer->on_radiance(RadianceSource::medium_emission, light, weight);
}

template <typename Tracer>
Passage PathMedia<Tracer>::cross_medium(double distance) {
  auto& path = tracer().path_;
  MediaState& media = tracer().media_;
  if (!medium_in(tracer().frame_.shading, media.stack).present()) return Passage::none;
  const MediumSegment segment =
      segment_along(tracer().frame_.shading, media.stack, path.ray, 0, distance);
  if (segment.empty()) return Passage::none;
  const MediumView& medium = *segment.medium;
  const bool glows = tracer().frame_.shading.has_emissive_media && !tracer().second_;
  if (glows && medium.emits()) [[unlikely]]
    add_emission_along(segment);
  if (!medium.scatters()) {
    path.throughput *= transmittance(segment, &media.random);
    return Passage::none;
  }
  const Vec4d u = tracer().sampler_.get_4d_fine(dimensions::medium(tracer().bounce()));
  media.traversal.begin(u.x, u.y, path.throughput);
  const MediumTraversal start = media.traversal;
  const auto density = [&](double t) { return start.density(medium, t - segment.begin); };
  const std::optional<EquiAngular> near = choose_equi_angular(segment, u.w);
  if (near && !tracer().second_) {
    const double t = near->sample(u.z);
    const auto pdf = static_cast<float>(near->pdf(t));
    const float here = medium.is_homogeneous() ? 1 : segment.density(t);
    MediumSegment before = segment;
    before.end = t;
    const Vec3f arrives = transmittance(before, &media.random) * medium.scattering * here;
    add_light_in_medium(medium, Vec3f(segment.at(t)),
                        path.throughput * arrives * (power_heuristic(pdf, density(t)) / pdf),
                        dimensions::light_in_medium(tracer().bounce()));
  }
  double t = 0;
  const bool collides = medium.is_homogeneous()
                            ? media.traversal.collides(segment, &path.throughput, &t)
                            : collides_heterogeneous(segment, &media.random, &path.throughput, &t);
  if (!collides) return Passage::none;
  // Where the density is zero, light near the point has all the weight, and this has none.
  const float pdf = density(t);
  float weight = 1;
  if (near) weight = pdf > 0 ? power_heuristic(pdf, static_cast<float>(near->pdf(t))) : 0;
  const bool continues = scatter_in_medium(medium, Vec3f(segment.at(t)), weight);
  return continues ? Passage::scattered : Passage::ended;
}

template <typename Tracer>
std::optional<EquiAngular> PathMedia<Tracer>::choose_equi_angular(const MediumSegment& segment,
                                                                  double select) {
  if (tracer().path_.depth >= tracer().frame_.max_depth) return std::nullopt;
  const MediumView& medium = *segment.medium;
  const double v = fraction(tracer().sampler_.hash(dimensions::medium(tracer().bounce())));
  const auto sigma =
      static_cast<double>(dot(medium.extinction, Vec3f{1, 1, 1}) * medium.typical_density) / 3;
  const double missed = elementary::exp(-sigma * segment.length());
  const double reach = -elementary::log(1 - v * (1 - missed)) / sigma;
  const LightSampleContext middle{Vec3f(segment.at(segment.begin + reach)), {0, 0, 1}, true};
  Vec3d place;
  if (!tracer().frame_.lights.choose_light_position(middle, select, &place)) return std::nullopt;
  const EquiAngular near(segment.origin, segment.direction, place, segment.begin, segment.end);
  return near.usable() ? std::optional(near) : std::nullopt;
}

template <typename Tracer>
bool PathMedia<Tracer>::scatter_in_medium(const MediumView& medium, const Vec3f& position,
                                          float weight) {
  auto& path = tracer().path_;
  if (PathObserver* observer = tracer().scratch_->observer) [[unlikely]]
    observer->on_medium(medium, position, path.throughput);
  if (tracer().second_ || tracer().is_cut()) return false;
  add_light_in_medium(medium, position, path.throughput * weight,
                      dimensions::light(tracer().bounce()));
  const Vec4f u = tracer().sampler_.get_4d(dimensions::bsdf(tracer().bounce()));
  if (!tracer().survives(u.w)) return false;
  const Vec3f before = path.ray.direction;
  tracer().follow({});
  path.ray.origin = position;
  path.ray.direction = phase::sample(medium.anisotropy, before, {u.x, u.y});
  path.pdf = phase::density(medium.anisotropy, before, path.ray.direction);
  path.from_camera = path.specular_bounce = false;
  path.lobes = 0;
  path.footprint = path.growth = 0;
  path.scattered_at = {position, {0, 0, 1}, true, path.ray.time};
  tracer().media_.traversal.restart();
  return true;
}

template <typename Tracer>
void PathMedia<Tracer>::add_light_in_medium(const MediumView& medium, const Vec3f& position,
                                            const Vec3f& throughput, std::uint32_t set) {
  auto& path = tracer().path_;
  if (!tracer().frame_.lights.samples_anything() || !(max_component(throughput) > 0)) return;
  LightSample light;
  if (!tracer().draw_light({position, {0, 0, 1}, true, path.ray.time}, set, &light)) return;
  const float phase = phase::density(medium.anisotropy, path.ray.direction, light.direction);
  Ray ray;
  ray.origin = position;
  ray.direction = light.distant ? light.direction : light.target - position;
  if (!light.distant) ray.t_max = 1;
  ray.time = path.ray.time;
  const Vec3f visibility = tracer().light_through(ray, light);
  if (!(max_component(visibility) > 0)) return;
  const float weight = light.pdf > 0 ? power_heuristic(light.pdf, phase) : 1.0f;
  const Vec3f added = throughput * light.radiance_over_pdf * visibility * (phase * weight);
  path.result.radiance += added;
  if (PathObserver* observer = tracer().scratch_->observer) [[unlikely]]
    observer->on_radiance(RadianceSource::medium_light, added, weight);
}

}  // namespace tessera::render
