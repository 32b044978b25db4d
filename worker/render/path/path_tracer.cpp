#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <type_traits>

#include "worker/accel/traversal/thread_counts.h"
#include "worker/geometry/surface_point.h"
#include "worker/guide/guide.h"
#include "worker/guide/guided_bsdf.h"
#include "worker/media/medium_stack.h"
#include "worker/media/medium_traversal.h"
#include "worker/media/phase.h"
#include "worker/render/path/motion_vectors.h"
#include "worker/render/path/path_media.h"
#include "worker/render/path/single_path.h"
#include "worker/render/spots/light_spots.h"
#include "worker/render/spots/specular_segments.h"
#include "worker/sampling/dimensions.h"
#include "worker/sampling/equi_angular.h"
#include "worker/sampling/sampler.h"
#include "worker/shading/microfacet/dispersion.h"

namespace tessera::render {
namespace {

/// Russian roulette after the second scattering event: paths with a throughput below this end with
/// a probability, or continue with this throughput. Measured: docs/notes/dropped-ideas.md.
constexpr float kRouletteWeight = 0.5f;
constexpr std::int32_t kRouletteDepth = 1;
/// One in this many paths that end at max_depth is continued up to this many scattering events,
/// only to estimate the truncated light for the report
/// (docs/explanation/error-estimation.md#error-measure).
constexpr std::uint64_t kCutPathsPerContinued = 64;
constexpr std::int32_t kContinuedMaxDepth = 4096;

LightSampleContext light_sample_context(const Bsdf& bsdf, const SurfacePoint& position,
                                        float time) {
  return {position.position, bsdf.frame.normal, bsdf.interface != Interface::opaque, time};
}

/// State of a path: the next ray and its throughput.
struct Path {
  Ray ray;  // unit direction
  Vec3f throughput{1, 1, 1};
  PathResult result;
  std::int32_t depth = 0;           // number of scattering events
  std::int32_t passed = 0;          // number of transparent surfaces passed
  bool from_camera = true;          // only alpha holes so far
  bool specular_bounce = true;      // the ray cannot come from light sampling: no MIS
  std::uint64_t lobes = kNoLobes;   // while all scattering was at delta lobes; 0 afterwards
  float pdf = 0;                    // of the last scattering, over solid angle
  float unguided = 1;               // factor by which guides have lowered `throughput`
  LightSampleContext scattered_at;  // position of the last scattering
  float footprint = 0;   // pixel footprint at the ray's origin, metres, and its growth per metre;
  float growth = 0;      // 0 after non-specular scattering: footprints are then points
  float wavelength = 0;  // nanometres; 0 until a dispersive surface samples one
};

struct NoMedia {
  explicit NoMedia(const Sampler& /*sampler*/) {}
};

/// `kMedia`: for scenes that track bodies (ShadingScene::tracks_bodies).
template <bool kMedia>
class PathTracer : PathMedia<PathTracer<kMedia>> {
 public:
  PathTracer(const FrameContext& frame, const PathStart& start, PathScratch* scratch)
      : frame_(frame),
        sampler_(start.sampler),
        scratch_(scratch),
        max_depth_(frame.max_depth),
        spots_(start.spots),
        offset_(start.offset),
        direct_weight_(start.direct_weight),
        second_(start.second),
        media_(sampler_) {}

  /// `first`: hit of the camera ray, if known; instance UINT32_MAX for a miss.
  PathResult trace(const Ray& camera_ray, const Hit* first);

 private:
  friend class PathMedia<PathTracer>;
  using Media = PathMedia<PathTracer>;

  bool find_hit(Hit* hit);
  bool step(const Hit& hit);
  void set_footprint(float distance, ShadingPoint* point);
  void choose_wavelength();
  bool is_cut();
  void add_environment();
  void record(const Hit& met, const ShadingPoint& point, const SurfacePoint& position,
              const Vec4f& base);
  void add_emission(const ShadingPoint& point, const TriangleId& id, const Vec3f& position);
  void continue_behind(const Hit& hit, const SurfacePoint& position);
  bool passes_straight(const Bsdf& bsdf, const Hit& hit, const SurfacePoint& position);
  void add_direct(const Bsdf& bsdf, const TriangleId& id, const SurfacePoint& position);
  Vec3f light_through(const Ray& ray, const LightSample& light);
  Vec3f medium_transmittance(const Ray& ray);
  Bsdf bsdf_at_hit(ShadingPoint point, const Vec4f& base) const;
  bool survives(float u);
  bool draw_direction(const Bsdf& bsdf, BsdfSample* next);
  bool follow_lobe(const Bsdf& bsdf, BsdfSample* next);
  float spot_weight() const;
  void choose_lobe(const Bsdf& bsdf, const SurfacePoint& position);
  bool draw_light(const LightSampleContext& context, std::uint32_t set, LightSample* light);
  bool scatter(const ShadingPoint& point, const Bsdf& bsdf, const TriangleId& id,
               const SurfacePoint& position);
  /// Continues along a ray at the same time.
  void follow(const Ray& ray) {
    const float time = path_.ray.time;
    path_.ray = ray;
    path_.ray.time = time;
  }
  std::uint32_t bounce() const { return static_cast<std::uint32_t>(path_.depth); }

  const FrameContext& frame_;
  Sampler sampler_;
  PathScratch* scratch_;
  std::int32_t max_depth_;           // of the image, or of a path that is continued for the report
  std::optional<PathResult> image_;  // result for the image before the path was continued
  Path path_;
  LightSpots::Pixel spots_;  // PathStart; empty for a path that is continued for the report
  Vec2f offset_;
  float direct_weight_;
  std::optional<LightSpots::Pixel::Second> second_;
  GuideLobe lobe_;  // at the surface where the path is
  std::conditional_t<kMedia, MediaState, NoMedia> media_;
};

template <bool kMedia>
PathResult PathTracer<kMedia>::trace(const Ray& camera_ray, const Hit* first) {
  path_.ray = camera_ray;
  path_.footprint = frame_.camera.footprint_at_start();
  path_.growth = frame_.camera.footprint_growth();
  if constexpr (kMedia) {
    media_.stack =
        initial_medium_stack(frame_.shading, frame_.accel, camera_ray, scratch_->crossings.get());
  }
  for (;; first = nullptr) {
    Hit hit;
    if (first != nullptr) hit = *first;
    const bool found = first != nullptr ? hit.id != TriangleId{} : find_hit(&hit);
    if constexpr (kMedia) {
      const float distance = found ? hit.t : path_.ray.t_max;
      const Passage passage = Media::cross_medium(static_cast<double>(distance));
      if (passage == Passage::ended) break;
      if (passage == Passage::scattered) continue;
    }
    if (!found) {
      if (PathObserver* observer = scratch_->observer) [[unlikely]]
        observer->on_miss(path_.ray, path_.throughput);
      add_environment();
      break;
    }
    if (path_.passed > kTransparencyLimit) {
      ++path_.result.limit_count;
      break;
    }
    if (!step(hit)) break;
  }
  if (!image_) return path_.result;
  image_->truncated = path_.result.radiance * static_cast<float>(kCutPathsPerContinued);
  return *image_;
}

/// Returns whether the path has reached max_depth. A few such paths are continued: they then
/// accumulate the light that the image lacks.
template <bool kMedia>
bool PathTracer<kMedia>::is_cut() {
  if (path_.depth < max_depth_) return false;
  const bool cut = second_ || max_depth_ == kContinuedMaxDepth ||
                   sampler_.hash(dimensions::kTraceOn) % kCutPathsPerContinued != 0;
  if (PathObserver* observer = scratch_->observer) [[unlikely]]
    observer->on_max_depth(!cut);
  if (cut) return true;
  image_ = path_.result;
  path_.result.radiance = {};
  max_depth_ = kContinuedMaxDepth;
  spots_ = {};
  return false;
}

template <bool kMedia>
bool PathTracer<kMedia>::find_hit(Hit* hit) {
  const bool camera = path_.depth == 0;
  unsigned traits = kTraitAlpha;
  if (!camera) traits |= kTraitUnlit;
  if (camera && frame_.cull_backfaces) traits |= kTraitOneSided;
  traits &= frame_.shading.traits;
  if (traits == 0) return frame_.accel.closest_hit(path_.ray, *hit);
  int passed = 0;
  const ClosestFilter filter{frame_.shading,
                             {sampler_, bounce(), RayKind::path},
                             path_.ray.direction,
                             static_cast<std::uint8_t>(traits),
                             &passed,
                             path_.ray.time,
                             &scratch_->passed};
  const bool found = frame_.accel.closest_hit(path_.ray, *hit, filter);
  if (path_.passed + passed > kTransparencyLimit) {
    Ray again = path_.ray;
    if (found) again.t_max = hit->t;
    int exact = 0;
    frame_.accel.any_hit(again, HoleCounter{filter, &exact});
    passed = exact;
  }
  path_.passed += passed;
  return found;
}

/// Handles one surface: emission, direct light and the next ray. Returns false if the path ends.
template <bool kMedia>
bool PathTracer<kMedia>::step(const Hit& hit) {
  ShadingPoint point =
      surface_at(frame_.shading, hit, path_.ray.direction, path_.ray.time, scratch_->met);
  if (frame_.shading.tracks_footprints) [[unlikely]]
    set_footprint(hit.t, &point);
  SurfacePoint position = position_of(point);
  if constexpr (kMedia) {
    if (Media::passes_unseen(point, hit, position)) return true;
  }
  const Vec4f base = base_color_at(frame_.shading, point);
  if (path_.depth == 0 && !path_.result.hit.present && !second_) record(hit, point, position, base);
  if (point.material->source->unlit) {
    if (second_) return false;
    path_.result.radiance += path_.throughput * base.xyz();
    if (PathObserver* observer = scratch_->observer) [[unlikely]]
      observer->on_radiance(RadianceSource::unlit, path_.throughput * base.xyz(), 1);
    return false;
  }
  add_emission(point, hit.id, position.position);
  if (point.material->interface != Interface::thin && is_cut()) return false;
  if (point.material->dispersive) [[unlikely]]
    choose_wavelength();
  offset_shadow_terminator(-path_.ray.direction, &point, &position);
  const Bsdf bsdf = bsdf_at_hit(point, base);
  if (PathObserver* observer = scratch_->observer) [[unlikely]] {
    observer->on_vertex(
        {path_.depth, path_.ray, hit, point, bsdf, position.position, path_.throughput});
  }
  if (passes_straight(bsdf, hit, position)) return true;
  if (second_ && path_.lobes == second_->lobes) return false;
  if (is_cut()) return false;
  if (frame_.guide != nullptr) [[unlikely]]
    choose_lobe(bsdf, position);
  const TriangleId left = point.raised ? TriangleId{} : hit.id;
  add_direct(bsdf, left, position);
  return scatter(point, bsdf, left, position);
}

/// BSDF at the hit. For nested solids the index of refraction is relative to the outer medium.
template <bool kMedia>
Bsdf PathTracer<kMedia>::bsdf_at_hit(ShadingPoint point, const Vec4f& base) const {
  if constexpr (kMedia) {
    if (point.material->interface == Interface::solid) {
      const Body* outside = media_.stack.top_except(body_of(point));
      if (outside != nullptr)
        point.material = &frame_.shading.between(*point.material, *outside->material);
    }
  }
  return bsdf_at(frame_.shading, point, base, -path_.ray.direction, path_.wavelength);
}

/// Continues the ray behind a surface that it passed, with the same end.
template <bool kMedia>
void PathTracer<kMedia>::continue_behind(const Hit& hit, const SurfacePoint& position) {
  ++path_.passed;
  const float rest = path_.ray.t_max - hit.t;
  follow(spawn_ray(position, hit.id, path_.ray.direction));
  path_.ray.t_max = rest;
}

/// Sets the footprint of the path's cone on a surface at an angle.
template <bool kMedia>
void PathTracer<kMedia>::set_footprint(float distance, ShadingPoint* point) {
  path_.footprint += path_.growth * distance;
  constexpr float kMinCosine = 0.1f;  // longer footprints would blur across the view direction
  const float cosine = std::fabs(dot(point->geometric_normal, path_.ray.direction));
  point->footprint = path_.footprint / (cosine > kMinCosine ? cosine : kMinCosine);
}

/// From the first dispersive surface on, the path represents one wavelength.
template <bool kMedia>
void PathTracer<kMedia>::choose_wavelength() {
  if (path_.wavelength > 0) return;
  const Wavelength chosen = wavelength_at(sampler_.get_4d(dimensions::kFilter).w);
  path_.wavelength = chosen.nanometres;
  path_.throughput *= chosen.weight;
}

template <bool kMedia>
void PathTracer<kMedia>::add_environment() {
  const bool has_environment = frame_.lights.environment() != nullptr;
  if (path_.from_camera) {
    switch (frame_.background) {
      case contract::Background::color:
        if (second_) return;
        path_.result.radiance += path_.throughput * frame_.background_color;
        if (PathObserver* observer = scratch_->observer) [[unlikely]] {
          observer->on_radiance(RadianceSource::environment,
                                path_.throughput * frame_.background_color, 1);
        }
        return;
      case contract::Background::none:
        path_.result.alpha = 0;
        return;
      case contract::Background::automatic:
        if (!has_environment) path_.result.alpha = 0;
        break;
    }
  }
  if (!has_environment) return;
  const EnvironmentMap::Lookup environment =
      frame_.lights.environment(path_.scattered_at, path_.ray.direction);
  float weight = path_.specular_bounce ? 1 : power_heuristic(path_.pdf, environment.pdf);
  weight *= spot_weight();
  path_.result.radiance += path_.throughput * environment.radiance * weight;
  if (PathObserver* observer = scratch_->observer) [[unlikely]] {
    observer->on_radiance(RadianceSource::environment,
                          path_.throughput * environment.radiance * weight, weight);
  }
}

template <bool kMedia>
void PathTracer<kMedia>::record(const Hit& met, const ShadingPoint& point,
                                const SurfacePoint& position, const Vec4f& base) {
  CameraHit& hit = path_.result.hit;
  hit.present = true;
  hit.albedo = base.xyz();
  if ((frame_.aovs & (contract::kAovNormal | contract::kAovDenoising)) != 0) {
    const Vec3f normal = shading_normal_at(frame_.shading, point);
    hit.normal = point.front ? normal : -normal;
  }
  hit.position = position.position;
  hit.node = point.instance->node;
  hit.material = point.primitive->material;
  hit.primitive = point.primitive->id;
  hit.time = path_.ray.time;
  if ((frame_.aovs & contract::kAovDenoising) != 0) {
    const CameraRays& camera = frame_.camera;
    hit.depth = static_cast<float>(camera.moves() ? camera.at(hit.time).depth(hit.position)
                                                  : camera.depth(hit.position));
  }
  if (frame_.motion != nullptr) [[unlikely]]
    hit.motion = frame_.motion->of(met);
}

template <bool kMedia>
void PathTracer<kMedia>::add_emission(const ShadingPoint& point, const TriangleId& id,
                                      const Vec3f& position) {
  if (!point.material->emissive) return;
  Vec3f light = path_.throughput * emission_at(frame_.shading, point, -path_.ray.direction);
  if (!(max_component(light) > 0)) return;
  float weight = spot_weight();
  if (!path_.specular_bounce) {
    const float distance = length(position - path_.scattered_at.point);
    const float cosine = std::fabs(dot(point.geometric_normal, path_.ray.direction));
    const float other = frame_.lights.emitter_pdf(path_.scattered_at, id, distance, cosine);
    weight *= power_heuristic(path_.pdf, other);
  }
  light *= weight;
  path_.result.radiance += light;
  if (PathObserver* observer = scratch_->observer) [[unlikely]]
    observer->on_radiance(RadianceSource::emission, light, weight);
}

/// Passes a thin surface: this is no scattering event, so depth and roulette do not count it, and
/// the density of the last scattering stays.
template <bool kMedia>
bool PathTracer<kMedia>::passes_straight(const Bsdf& bsdf, const Hit& hit,
                                         const SurfacePoint& position) {
  const Vec3f share = straight_transmittance(bsdf);
  const float straight = luminance(share);
  if (!(straight > 0)) return false;
  const float probability = straight / (straight + scattered_albedo(bsdf));
  if (!(straight_random(sampler_, bounce(), hit.id) < probability)) {
    path_.throughput = path_.throughput / (1 - probability);
    return false;
  }
  path_.throughput *= share / probability;
  if (PathObserver* observer = scratch_->observer) [[unlikely]]
    observer->on_pass(path_.throughput);
  path_.from_camera = false;
  continue_behind(hit, position);
  return true;
}

template <bool kMedia>
bool PathTracer<kMedia>::draw_light(const LightSampleContext& context, std::uint32_t set,
                                    LightSample* light) {
  LightRandom u;
  const Vec4f x = sampler_.get_4d(set);
  // 20 extra bits each, because one of millions of lights or texels may have a probability below
  // 2^-24.
  const std::uint64_t bits = sampler_.hash(set);
  u.u1 = x.x + fraction(bits) * 0x1p-24;
  u.u2 = x.y + fraction(bits >> 20) * 0x1p-24;
  u.select = x.z + fraction(bits >> 40) * 0x1p-24;
  u.u3 = x.w;
  u.bits = bits;
  return frame_.lights.sample(context, u, light);
}

template <bool kMedia>
void PathTracer<kMedia>::add_direct(const Bsdf& bsdf, const TriangleId& id,
                                    const SurfacePoint& position) {
  if (second_ || !frame_.lights.samples_anything() || !has_smooth_density(bsdf)) return;
  LightSample light;
  LightSampleContext context = light_sample_context(bsdf, position, path_.ray.time);
  context.surface = &position;
  if (!draw_light(context, dimensions::light(bounce()), &light)) return;
  const BsdfValue value = evaluate_bsdf(bsdf, light.direction);
  if (!(max_component(value.f_cos) > 0)) return;
  Ray ray = light.distant ? spawn_ray(position, id, light.direction)
                          : spawn_ray_to(position, id, light.target);
  ray.time = path_.ray.time;
  const Vec3f visibility = light_through(ray, light);
  if (!(max_component(visibility) > 0)) return;
  float pdf = value.pdf;
  if (lobe_.probability > 0) [[unlikely]]
    pdf = lerp(pdf, lobe_.pdf(light.direction), lobe_.probability);
  const float weight = light.pdf > 0 ? power_heuristic(light.pdf, pdf) : 1.0f;
  const Vec3f added =
      path_.throughput * value.f_cos * light.radiance_over_pdf * visibility * weight;
  path_.result.radiance += added;
  if (PathObserver* observer = scratch_->observer) [[unlikely]]
    observer->on_radiance(RadianceSource::direct, added, weight);
}

/// Fraction of a light sample's radiance that arrives: 0 behind anything opaque.
template <bool kMedia>
Vec3f PathTracer<kMedia>::light_through(const Ray& ray, const LightSample& light) {
  if constexpr (kMedia) {
    if ((frame_.shading.traits & kTraitCrossed) != 0)
      return Media::light_through_bodies(ray, light);
  }
  const auto traits = static_cast<std::uint8_t>(frame_.shading.traits &
                                                (kTraitAlpha | kTraitUnlit | kTraitStraight));
  if (traits == 0) {
    const TriangleId& target = light.triangle;
    const bool blocked =
        target == TriangleId{}
            ? frame_.accel.any_hit(ray)
            : frame_.accel.any_hit(ray, [&](const Hit& hit) { return hit.id != target; });
    return blocked ? Vec3f{} : medium_transmittance(ray);
  }
  ThinSurfaceStack& thin_surfaces = scratch_->thin_surfaces;
  thin_surfaces.passed = thin_surfaces.count = 0;
  const ShadowFilter filter{frame_.shading,  {sampler_, bounce(), RayKind::shadow},
                            light.direction, light.triangle,
                            traits,          &thin_surfaces,
                            ray.time,        &scratch_->passed};
  if (frame_.accel.any_hit(ray, filter)) return {};
  if (thin_surfaces.passed > kTransparencyLimit) {
    ++path_.result.limit_count;
    return {};
  }
  return thin_surfaces.transmittance() * medium_transmittance(ray);
}

/// Transmittance of the medium that the shadow ray is in. It cannot leave its body, because the
/// surfaces of solids block it.
template <bool kMedia>
Vec3f PathTracer<kMedia>::medium_transmittance(const Ray& ray) {
  if constexpr (kMedia) {
    if (medium_in(frame_.shading, media_.stack).present()) {
      MediumStack stack = media_.stack;
      return transmittance_across(frame_.shading, ray, {}, &stack, &media_.random);
    }
  }
  return {1, 1, 1};
}

/// Counts a scattering event and applies Russian roulette, with the probabilities of a path that
/// follows no guide: a guide leads to where more light is by as much as it lowers the throughput.
template <bool kMedia>
bool PathTracer<kMedia>::survives(float u) {
  ++path_.depth;
  const float survival = max_component(path_.throughput) * path_.unguided / kRouletteWeight;
  if (path_.depth > kRouletteDepth && !(survival >= 1)) {
    const bool survived = u < survival;
    if (survived) path_.throughput = path_.throughput / survival;
    if (PathObserver* observer = scratch_->observer) [[unlikely]]
      observer->on_roulette(survival, survived, path_.throughput);
    if (!survived) return false;
  }
  return true;
}

/// Sets the lobe that the path may follow from `position`. It replaces the diffuse lobe only,
/// because it does not know the shape of others.
template <bool kMedia>
void PathTracer<kMedia>::choose_lobe(const Bsdf& bsdf, const SurfacePoint& position) {
  lobe_ = frame_.guide->at(position.position, bsdf.frame.geometric_normal);
  lobe_.probability *= bsdf.cosine_probability;
}

/// Samples the BSDF or the guide, and applies Russian roulette. Returns false if the path ends.
template <bool kMedia>
bool PathTracer<kMedia>::draw_direction(const Bsdf& bsdf, BsdfSample* next) {
  const Vec4f u = sampler_.get_4d(dimensions::bsdf(bounce()));
  const bool scatters = lobe_.probability > 0 ? sample_guided(bsdf, lobe_, u, next, &path_.unguided)
                                              : sample_bsdf(bsdf, u.z, {u.x, u.y}, next);
  if (!scatters) return false;
  path_.throughput *= next->weight;
  if (PathObserver* observer = scratch_->observer) [[unlikely]]
    observer->on_scatter(*next, path_.throughput);
  return survives(u.w);
}

/// Takes the next of the lobes that a second path follows. Returns false if the path ends.
template <bool kMedia>
bool PathTracer<kMedia>::follow_lobe(const Bsdf& bsdf, BsdfSample* next) {
  const std::optional<DeltaLobe> lobe = next_lobe(path_.lobes, second_->lobes);
  if (!lobe || !(sample_delta(bsdf, *lobe, next) > 0)) return false;
  path_.throughput *= next->weight;
  ++path_.depth;
  if (PathObserver* observer = scratch_->observer) [[unlikely]]
    observer->on_scatter(*next, path_.throughput);
  return true;
}

/// Weight of light that the path finds, against the same light found by the other path of the
/// sample.
template <bool kMedia>
float PathTracer<kMedia>::spot_weight() const {
  if (second_) return path_.lobes == second_->lobes ? second_->weight : 0;
  if (path_.lobes == kNoLobes && direct_weight_ != 1) [[unlikely]]
    return direct_weight_;
  return path_.lobes == 0 || spots_.empty() ? 1 : spots_.weight(offset_, path_.lobes);
}

template <bool kMedia>
bool PathTracer<kMedia>::scatter(const ShadingPoint& point, const Bsdf& bsdf, const TriangleId& id,
                                 const SurfacePoint& position) {
  BsdfSample next;
  const bool continues = second_ ? follow_lobe(bsdf, &next) : draw_direction(bsdf, &next);
  if (!continues) return false;
  if constexpr (kMedia) {
    if (next.transmitted && bsdf.interface == Interface::solid)
      media_.stack.cross(body_of(point), point.front);
    media_.traversal.restart();
  }
  path_.from_camera = false;
  if (!next.delta) {
    path_.footprint = path_.growth = 0;
    path_.lobes = 0;
  } else if (path_.lobes != 0) {
    path_.lobes = with_lobe(path_.lobes, next.lobe);
  }
  path_.specular_bounce = next.delta;
  path_.pdf = next.pdf;
  path_.scattered_at = light_sample_context(bsdf, position, path_.ray.time);
  follow(spawn_ray(position, id, next.wi));
  return true;
}

}  // namespace

PathResult trace_path(const FrameContext& frame, const PathStart& start, PathScratch* scratch) {
  if (frame.shading.tracks_bodies) [[unlikely]]
    return PathTracer<true>(frame, start, scratch).trace(start.ray, start.first);
  return PathTracer<false>(frame, start, scratch).trace(start.ray, start.first);
}

}  // namespace tessera::render
