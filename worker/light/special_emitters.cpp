// Sampling of shapes and of moving lights, at the time of the context.

#include <cmath>

#include "worker/geometry/surface_point.h"
#include "worker/light/emitters/moving_lights.h"
#include "worker/light/emitters/punctual.h"
#include "worker/light/emitters/spherical_triangle.h"
#include "worker/light/light_sampler.h"
#include "worker/sampling/warp.h"
#include "worker/shading/surface/surface.h"

namespace tessera::render {
namespace {

/// Density over solid angle of uniform sampling, chosen with probability `share`; 0 for an empty
/// set.
float density_over(double share, double solid_angle) {
  return solid_angle > 0 ? static_cast<float>(share / solid_angle) : 0;
}

/// Samples a direction to a shape and returns the solid angle of its bounding proxy; 0 if it
/// misses.
///
/// The shape is sought from where the shadow ray starts, off the receiving surface: the rounded
/// position of a receiver on the shape itself may lie on its other side.
double aim_at(const ShapeLight& emitter, const TriangleId& id, const LightSampleContext& context,
              const LightRandom& u, Hit* hit, LightSample* sample) {
  const Vec3d from(context.point);
  const double solid_angle = emitter.solid_angle(from);
  if (!(solid_angle > 0)) return 0;
  const Vec3d direction = emitter.sample(from, u.u1, u.u2);
  sample->direction = Vec3f(direction);
  const Vec3d start = context.surface == nullptr
                          ? from
                          : Vec3d(offset_ray_origin(*context.surface, sample->direction));
  ShapeHit found;
  if (!emitter.find(start, direction, found)) return 0;
  const Vec3f p(found.point);
  *hit = {static_cast<float>(found.t), {id.instance, 0, found.face}, p.x, p.y, p.z};
  sample->target = Vec3f(start + direction * found.t);
  sample->distant = false;
  sample->triangle = hit->id;
  return solid_angle;
}

/// Sets the sample's radiance from the emission at the light. False if there is none.
bool take_emission(const ShadingScene& scene, const ShadingPoint& light, LightSample* sample) {
  const Vec3f radiance = emission_at(scene, light, -sample->direction) * coverage_at(scene, light);
  if (!(max_component(radiance) > 0) || !(sample->pdf > 0) || !(sample->pdf < INFINITY)) {
    return false;
  }
  sample->radiance_over_pdf = radiance / sample->pdf;
  return true;
}

/// A moving triangle as seen from a point at a time.
struct SeenCorners {
  Corners corners;
  SphericalTriangle seen;
  float density = 0;  // per area; 0 if the area is too small

  SeenCorners(const Corners& at, const Vec3d& from)
      : corners(at),
        seen(SphericalTriangle::seen_from_origin(at[0] - from, at[1] - from, at[2] - from)) {
    const auto per_area = static_cast<float>(2 / length(cross(at[1] - at[0], at[2] - at[0])));
    if (per_area < INFINITY) density = per_area;
  }
};

}  // namespace

bool LightSampler::sample_special(const Entry& entry, float share,
                                  const LightSampleContext& context, const LightRandom& u,
                                  LightSample* sample) const {
  if (entry.volume != kNone) {
    return sample_volume(volumes_[static_cast<std::size_t>(entry.volume)], share, context, u,
                         sample);
  }
  if (!entry.moves) return sample_shape(entry, share, context, u, sample);
  if (entry.punctual != kNone) {
    const PunctualLight& light = punctual_[static_cast<std::size_t>(entry.punctual)];
    return sample_point_light(light, pose_of(shading_.source, light, context.time), share,
                              context.point, sample);
  }
  return entry.shape != kNone ? sample_moving_shape(entry, share, context, u, sample)
                              : sample_moving_triangle(entry, share, context, u, sample);
}

bool LightSampler::sample_shape(const Entry& entry, float share, const LightSampleContext& context,
                                const LightRandom& u, LightSample* sample) const {
  const ShapeLight& emitter = shapes_[static_cast<std::size_t>(entry.shape)];
  Hit hit;
  const double solid_angle = aim_at(emitter, entry.triangle, context, u, &hit, sample);
  if (!(solid_angle > 0)) return false;
  sample->pdf = density_over(double{share}, solid_angle);
  return take_emission(shading_, surface_at(shading_, hit, sample->direction), sample);
}

bool LightSampler::sample_moving_shape(const Entry& entry, float share,
                                       const LightSampleContext& context, const LightRandom& u,
                                       LightSample* sample) const {
  const InstanceView& instance = shading_.instances[entry.triangle.instance];
  const auto pose = pose_of(shading_.source, *instance.source, context.time);
  if (!pose) return false;
  const ShapeLight emitter(pose->object_to_world, pose->world_to_object, *instance.shape);
  Hit hit;
  const double solid_angle = aim_at(emitter, entry.triangle, context, u, &hit, sample);
  if (!(solid_angle > 0)) return false;
  sample->pdf = density_over(double{share}, solid_angle);
  MovedSurface memory;
  return take_emission(shading_, moved_at(shading_, hit, sample->direction, context.time, memory),
                       sample);
}

bool LightSampler::sample_moving_triangle(const Entry& entry, float share,
                                          const LightSampleContext& context, const LightRandom& u,
                                          LightSample* sample) const {
  const TriangleId& id = entry.triangle;
  const auto corners = corners_of(shading_.source, id, context.time);
  if (!corners) return false;
  const auto& [a, b, c] = *corners;
  const Vec3d from(context.point);
  const SeenCorners light(*corners, from);
  const bool near = light.seen.is_near();
  const Vec2f w =
      near ? light.seen.barycentrics_at(light.seen.sample(u.u1, u.u2))
           : warp::uniform_triangle({static_cast<float>(u.u1), static_cast<float>(u.u2)});
  const Vec3d place = a + (b - a) * static_cast<double>(w.x) + (c - a) * static_cast<double>(w.y);
  sample->direction = Vec3f(normalize(place - from));
  sample->target = Vec3f(place);
  sample->distant = false;
  sample->triangle = id;
  const Hit hit = {0, id, 1 - w.x - w.y, w.x, w.y};
  MovedSurface memory;
  const ShadingPoint point = moved_at(shading_, hit, sample->direction, context.time, memory);
  sample->pdf =
      near ? density_over(double{share}, light.seen.solid_angle)
           : solid_angle_density(share * light.density, static_cast<float>(length(place - from)),
                                 std::fabs(dot(point.geometric_normal, sample->direction)));
  return take_emission(shading_, point, sample);
}

float LightSampler::special_pdf(const Entry& entry, double share, const LightSampleContext& context,
                                const TriangleId& id, float distance, float cos_light) const {
  const Vec3d from(context.point);
  if (!entry.moves) {
    return density_over(share, shapes_[static_cast<std::size_t>(entry.shape)].solid_angle(from));
  }
  const InstanceView& instance = shading_.instances[id.instance];
  if (entry.shape != kNone) {
    const auto pose = pose_of(shading_.source, *instance.source, context.time);
    if (!pose) return 0;
    const ShapeLight emitter(pose->object_to_world, pose->world_to_object, *instance.shape);
    return density_over(share, emitter.solid_angle(from));
  }
  const auto corners = corners_of(shading_.source, id, context.time);
  if (!corners) return 0;
  const SeenCorners light(*corners, from);
  if (light.seen.is_near()) return density_over(share, light.seen.solid_angle);
  return solid_angle_density(static_cast<float>(share) * light.density, distance, cos_light);
}

}  // namespace tessera::render
