#include "worker/guide/photon_source.h"

#include <cmath>

#include "worker/geometry/bounds.h"
#include "worker/geometry/frame.h"
#include "worker/geometry/surface_point.h"
#include "worker/light/emitters/emissive_power.h"
#include "worker/light/emitters/punctual.h"
#include "worker/light/emitters/shape_light.h"
#include "worker/sampling/warp.h"
#include "worker/scene/visible_bounds.h"
#include "worker/shading/surface/surface.h"

namespace tessera::render {
namespace {

constexpr float kPi = warp::kPi;

Ray ray_from(const Vec3f& origin, const Vec3f& direction) {
  Ray ray;
  ray.origin = origin;
  ray.direction = direction;
  return ray;
}

/// A point of the disc around `centre` that faces along `axis`.
Vec3f disc_point(const Vec3f& centre, const Vec3f& axis, float radius, const Vec2f& u) {
  const Vec2f d = warp::disk(u);
  const Frame frame = Frame::from_normal(axis);
  return centre + (frame.s * d.x + frame.t * d.y) * radius;
}

}  // namespace

PhotonSource::PhotonSource(const Scene& scene, const ShadingScene& shading,
                           const LightSampler& lights)
    : scene_(scene), shading_(shading), lights_(lights) {
  const Box3d box = visible_bounds(scene);
  if (box.empty()) return;
  centre_ = Vec3f((box.lo + box.hi) * 0.5);
  radius_ = static_cast<float>(length(box.hi - box.lo) * 0.5);
  add_emitters();
  add_punctual();
  if (lights.environment() != nullptr) {
    add({Kind::environment, {}, 0, 0, {}},
        lights.environment()->power() * double{kPi} * double{radius_} * double{radius_});
  }
  choice_ = DiscreteDistribution(powers_);
}

void PhotonSource::add(const Light& light, double power) {
  if (!(power > 0) || !std::isfinite(power)) return;
  emitters_.push_back(light);
  powers_.push_back(power);
}

void PhotonSource::add_emitters() {
  EmittedRadiance radiance(scene_, shading_.textures);
  for (std::uint32_t i = 0; i < scene_.instances.size(); ++i) {
    const Instance& instance = scene_.instances[i];
    const Mesh& mesh = scene_.meshes[static_cast<std::size_t>(instance.mesh)];
    if (instance.operand || instance.flat) continue;
    for (std::uint32_t k = 0; k < mesh.primitives.size(); ++k) {
      const Primitive& p = mesh.primitives[k];
      const MaterialView& material = shading_.materials[static_cast<std::size_t>(p.material)];
      if (!material.emissive) continue;
      if (mesh.shape != nullptr) {
        add_shape(i, double{luminance(material.source->emission)});
        continue;
      }
      for (std::uint32_t t = 0; t < p.triangles.size(); ++t) {
        const auto& v = p.triangles[t];
        const double area = world_area({instance.object_to_world, instance.world_to_object,
                                        p.positions[v[0]], p.positions[v[1]], p.positions[v[2]]}) *
                            (material.source->double_sided ? 2 : 1);
        add({Kind::triangle, {i, k, t}, 0, static_cast<float>(area), {}},
            double{kPi} * area * radiance.at(p, v));
      }
    }
  }
}

void PhotonSource::add_shape(std::uint32_t instance, double radiance) {
  const Instance& placed = scene_.instances[instance];
  const Shape& shape = *scene_.meshes[static_cast<std::size_t>(placed.mesh)].shape;
  if (!shape.bounded()) return;
  const LightBounds box =
      ShapeLight(placed.object_to_world, placed.world_to_object, shape).bounds(radiance, false);
  const double radius = length(box.box_max - box.box_min) * 0.5;
  add({Kind::shape,
       {instance, 0, 0},
       0,
       static_cast<float>(radius),
       Vec3f((box.box_min + box.box_max) * 0.5)},
      radiance * 4 * double{kPi} * double{kPi} * radius * radius);
}

void PhotonSource::add_punctual() {
  for (std::size_t i = 0; i < scene_.lights.size(); ++i) {
    const PunctualLight& light = scene_.lights[i];
    const double strength{luminance(light.intensity)};
    double power = 4 * double{kPi} * strength;
    if (light.kind == PunctualLight::Kind::spot) {
      power *= 0.5 * (1 - double{light.cos_outer});
    } else if (light.kind == PunctualLight::Kind::directional) {
      power = double{kPi} * double{radius_} * double{radius_} * strength;
    }
    add({Kind::punctual, {}, i, 0, {}}, power);
  }
}

std::optional<PhotonSource::Emission> PhotonSource::emit(PhotonRandom* random) const {
  const DiscreteDistribution::Choice chosen = choice_.sample(random->next_double());
  const Light& light = emitters_[static_cast<std::size_t>(chosen.index)];
  std::optional<Emission> emission;
  switch (light.kind) {
    case Kind::triangle:
      emission = emit_triangle(light, random);
      break;
    case Kind::shape:
      emission = emit_shape(light, random);
      break;
    case Kind::punctual:
      emission = emit_punctual(scene_.lights[light.punctual], random);
      break;
    case Kind::environment:
      emission = emit_environment(random);
      break;
  }
  if (!emission) return emission;
  emission->light = combine(pack(light.triangle.instance, light.triangle.primitive),
                            static_cast<std::uint64_t>(light.kind));
  emission->flux *= static_cast<float>(1 / (double{chosen.pdf} * choice_.total()));
  if (!(luminance(emission->flux) > 0)) emission.reset();
  return emission;
}

PhotonSource::Emission PhotonSource::emit_triangle(const Light& light, PhotonRandom* random) const {
  const Vec2f at = warp::uniform_triangle(random->next_2d());
  Vec3f normal = surface_at(shading_, light.triangle, at.x, at.y, {0, 0, 1}).geometric_normal;
  const bool back = random->next() < 0.5f;
  const MaterialView& material =
      shading_.materials[static_cast<std::size_t>(shading_.primitive(light.triangle).material)];
  if (back && material.source->double_sided) normal = -normal;
  const Vec3f direction =
      Frame::from_normal(normal).to_world(warp::cosine_hemisphere(random->next_2d()));
  const ShadingPoint point = surface_at(shading_, light.triangle, at.x, at.y, -direction);
  Emission emission;
  emission.ray = spawn_ray(position_of(point), light.triangle, direction);
  emission.flux =
      emission_at(shading_, point, direction) * (coverage_at(shading_, point) * kPi * light.extent);
  return emission;
}

/// Follows a uniformly chosen line through the sphere around the shape from where it leaves the
/// shape.
std::optional<PhotonSource::Emission> PhotonSource::emit_shape(const Light& light,
                                                               PhotonRandom* random) const {
  const Instance& instance = scene_.instances[light.triangle.instance];
  const ShapeLight shape(instance.object_to_world, instance.world_to_object,
                         *scene_.meshes[static_cast<std::size_t>(instance.mesh)].shape);
  const Vec3f direction = normalize(warp::uniform_sphere(random->next_2d()));
  const Vec3f from = disc_point(light.centre + direction * (2 * light.extent), direction,
                                light.extent, random->next_2d());
  ShapeHit found;
  if (!shape.find(Vec3d(from), Vec3d(-direction), found)) return std::nullopt;
  const Vec3f p(found.point);
  const Hit hit = {
      static_cast<float>(found.t), {light.triangle.instance, 0, found.face}, p.x, p.y, p.z};
  const ShadingPoint point = surface_at(shading_, hit, -direction);
  Emission emission;
  emission.ray = spawn_ray(position_of(point), hit.id, direction);
  emission.flux =
      emission_at(shading_, point, direction) * (4 * kPi * kPi * light.extent * light.extent);
  return emission;
}

PhotonSource::Emission PhotonSource::emit_punctual(const PunctualLight& light,
                                                   PhotonRandom* random) const {
  Emission emission;
  emission.is_point = true;
  if (light.kind == PunctualLight::Kind::directional) {
    emission.ray = from_outside(light.direction, random);
    emission.flux = light.intensity * (kPi * radius_ * radius_);
    return emission;
  }
  const Vec2f u = random->next_2d();
  if (light.kind == PunctualLight::Kind::point) {
    emission.ray = ray_from(Vec3f(light.position), normalize(warp::uniform_sphere(u)));
    emission.flux = light.intensity * (4 * kPi);
    return emission;
  }
  const float height = (1 - light.cos_outer) * u.x;  // 1 - cosine
  const elementary::SinCosf around = elementary::sincos(2 * kPi * u.y);
  const float sine = std::sqrt(height * (2 - height));
  const Frame frame = Frame::from_normal(light.direction);
  emission.ray =
      ray_from(Vec3f(light.position),
               normalize(frame.to_world({sine * around.cos, sine * around.sin, 1 - height})));
  emission.flux =
      light.intensity * (spot_attenuation(1 - height, light.cos_inner, light.cos_outer) * 2 * kPi *
                         (1 - light.cos_outer));
  return emission;
}

PhotonSource::Emission PhotonSource::emit_environment(PhotonRandom* random) const {
  const EnvironmentMap& environment = *lights_.environment();
  Emission emission;
  if (environment.is_constant()) {
    const Vec3f towards = normalize(warp::uniform_sphere(random->next_2d()));
    emission.ray = from_outside(-towards, random);
    emission.flux = environment.radiance(towards) * (4 * kPi * kPi * radius_ * radius_);
    emission.is_found = false;
    return emission;
  }
  // Light sampling finds the part of the sky that exceeds the mean. The rest is left to BSDF
  // sampling, which seldom finds a window.
  const auto unsampled = static_cast<float>(environment.unsampled_share());
  const float area = kPi * radius_ * radius_;
  if (random->next() < unsampled) {
    const Vec3f towards = normalize(warp::uniform_sphere(random->next_2d()));
    emission.ray = from_outside(-towards, random);
    emission.flux =
        environment.unsampled(environment.radiance(towards)) * (4 * kPi * area / unsampled);
    emission.is_found = false;
    return emission;
  }
  const double u = random->next_double();
  const double v = random->next_double();
  const EnvironmentMap::Sample sample = environment.sample(u, v);
  if (!(sample.pdf > 0) || !(sample.pdf < INFINITY)) return emission;
  emission.ray = from_outside(-sample.direction, random);
  emission.flux = (sample.radiance - environment.unsampled(sample.radiance)) *
                  (area / sample.pdf / (1 - unsampled));
  return emission;
}

/// A ray from outside the scene through a point of the disc across the scene.
Ray PhotonSource::from_outside(const Vec3f& direction, PhotonRandom* random) const {
  const Vec3f start = centre_ - direction * (2 * radius_);
  return ray_from(disc_point(start, direction, radius_, random->next_2d()), direction);
}

}  // namespace tessera::render
