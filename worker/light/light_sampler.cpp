#include "worker/light/light_sampler.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "worker/light/emitters/emissive_power.h"
#include "worker/light/emitters/moving_lights.h"
#include "worker/light/emitters/punctual.h"
#include "worker/sampling/warp.h"
#include "worker/scene/features.h"
#include "worker/shading/surface/surface.h"

namespace tessera::render {
namespace {

/// Triangles seen under more than about this solid angle (steradians) are sampled by solid angle.
constexpr double kNearSolidAngle = 0.1;
constexpr float kInfinity = std::numeric_limits<float>::infinity();

Vec3d world_vertex(const Instance& instance, const Primitive& p, std::uint32_t v) {
  return transform_point(instance.object_to_world, Vec3d(p.positions[v]));
}

PlacedTriangle placed(const Instance& instance, const Primitive& p, std::size_t t) {
  const auto& v = p.triangles[t];
  return {instance.object_to_world, instance.world_to_object, p.positions[v[0]], p.positions[v[1]],
          p.positions[v[2]]};
}

Corners corners_of(const Instance& instance, const Primitive& p, std::size_t t) {
  const auto& v = p.triangles[t];
  return {world_vertex(instance, p, v[0]), world_vertex(instance, p, v[1]),
          world_vertex(instance, p, v[2])};
}

}  // namespace

LightSampler::LightSampler(const Scene& scene, const ShadingScene& shading, LightSampling sampling)
    : shading_(shading), punctual_(scene.lights) {
  if (scene.has_environment) environment_ = std::make_unique<EnvironmentMap>(scene);
  if (sampling == LightSampling::none) return;
  std::vector<LightBounds> bounds;
  add_emitters(scene, bounds);
  add_volumes(scene, bounds);
  add_punctual(scene, bounds);
  tree_ = LightTree(bounds);
  const bool varies = environment_ != nullptr && !environment_->is_constant();
  if (varies) environment_irradiance_ = environment_->power() / 4;
}

void LightSampler::add_emitters(const Scene& scene, std::vector<LightBounds>& bounds) {
  EmittedRadiance radiance(scene, shading_.textures);
  for (std::uint32_t i = 0; i < scene.instances.size(); ++i) {
    const Instance& instance = scene.instances[i];
    const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
    slot_first_.push_back(static_cast<std::uint32_t>(slots_.size()));
    for (std::uint32_t k = 0; k < mesh.primitives.size(); ++k) {
      const auto material = static_cast<std::size_t>(mesh.primitives[k].material);
      // The visible part of a CSG operand is known only to rays: left to BSDF sampling.
      if (instance.operand || !shading_.materials[material].emissive) {
        slots_.push_back(kNone);
        continue;
      }
      slots_.push_back(static_cast<std::int64_t>(entries_.size()));
      if (mesh.shape != nullptr) {
        add_shape(scene, i, bounds);
      } else {
        add_triangles(scene, {i, k, 0}, radiance, bounds);
      }
    }
  }
}

/// Adds all triangles of a primitive, starting with `first`.
void LightSampler::add_triangles(const Scene& scene, const TriangleId& first,
                                 EmittedRadiance& radiance, std::vector<LightBounds>& bounds) {
  const Instance& instance = scene.instances[first.instance];
  const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
  const Primitive& p = mesh.primitives[first.primitive];
  const MaterialView& view = shading_.materials[static_cast<std::size_t>(p.material)];
  const Material& material = *view.source;
  const std::size_t first_entry = entries_.size();
  Entry entry;
  entry.triangle = first;
  entry.moves = entry.special = instance.motion != kNone || !mesh.keys.empty();
  entry.uniform = !material.emissive_texture && !view.extended &&
                  material.alpha_mode == AlphaMode::opaque && !shading_.assumes(kFeatureTextures);
  for (std::uint32_t t = 0; t < p.triangles.size(); ++t) {
    entry.triangle.triangle = t;
    LightBounds light = entry.moves ? bounds_of_moving(scene, entry.triangle)
                                    : bounds_of(corners_of(instance, p, t), instance.flips_winding);
    const double area = light.strength;
    const auto density = area > 0 ? static_cast<float>(1 / area) : kInfinity;
    const bool usable = density < kInfinity;  // slivers are left to BSDF sampling
    entry.density = usable ? density : 0;
    entry.centre = Vec3f((light.box_min + light.box_max) * 0.5);
    entry.reach2 = static_cast<float>(area / kNearSolidAngle);
    entry.normal = world_normal(placed(instance, p, t));
    light.both_sides = material.double_sided;
    light.strength = usable ? area * radiance.at(p, p.triangles[t]) : 0;
    if (!std::isfinite(light.strength)) light.strength = 0;
    entries_.push_back(entry);
    bounds.push_back(light);
  }
  if (!material.emissive_texture && !entry.moves) {
    merge_rectangles(instance, p, first_entry, bounds);
  }
}

namespace {

/// Corner with a right angle (in the world, up to 2^-20) of a triangle; 3 if there is none.
std::uint8_t right_angle_of(const std::array<Vec3d, 3>& v) {
  for (std::uint8_t k = 0; k < 3; ++k) {
    const Vec3d a = v[(k + 1u) % 3] - v[k], b = v[(k + 2u) % 3] - v[k];
    if (std::fabs(dot(a, b)) <= 0x1p-20 * std::sqrt(dot(a, a) * dot(b, b))) return k;
  }
  return 3;
}

}  // namespace

/// Merges two consecutive triangles that form a rectangle of uniform emission into one light: the
/// first represents both, the second has no strength of its own.
void LightSampler::merge_rectangles(const Instance& instance, const Primitive& p, std::size_t first,
                                    std::vector<LightBounds>& bounds) {
  for (std::size_t t = 0; t + 1 < p.triangles.size(); ++t) {
    LightBounds &a = bounds[first + t], &b = bounds[first + t + 1];
    if (!(a.strength > 0) || !(b.strength > 0)) continue;
    std::array<std::array<Vec3d, 3>, 2> v;
    for (std::size_t half = 0; half < 2; ++half) {
      for (std::size_t k = 0; k < 3; ++k) {
        v[half][k] = world_vertex(instance, p, p.triangles[t + half][k]);
      }
    }
    const std::uint8_t r = right_angle_of(v[0]), s = right_angle_of(v[1]);
    if (r == 3 || s == 3) continue;
    const Vec3d &next = v[0][(r + 1u) % 3], &last = v[0][(r + 2u) % 3];
    if (!(v[1][(s + 1u) % 3] == last) || !(v[1][(s + 2u) % 3] == next)) continue;
    const Vec3d off = v[1][s] - (next + last - v[0][r]);
    if (!(length(off) <= 0x1p-20 * length(next - last))) continue;
    Entry& entry = entries_[first + t];
    entry.other = static_cast<std::uint32_t>(t + 1);
    entry.right_angle = r;
    entry.other_right_angle = s;
    entry.density *= 0.5f;
    entry.centre = Vec3f((next + last) * 0.5);
    entry.uniform = entry.uniform && entry.normal == entries_[first + t + 1].normal;
    entries_[first + t + 1].merged = true;
    a.box_min = min(a.box_min, b.box_min);
    a.box_max = max(a.box_max, b.box_max);
    a.strength += b.strength;
    b.strength = 0;
    ++t;
  }
}

void LightSampler::add_shape(const Scene& scene, std::uint32_t instance,
                             std::vector<LightBounds>& bounds) {
  const Instance& placed = scene.instances[instance];
  const Mesh& mesh = scene.meshes[static_cast<std::size_t>(placed.mesh)];
  const Material& material = scene.materials[static_cast<std::size_t>(mesh.primitives[0].material)];
  Entry entry;
  entry.triangle = {instance, 0, 0};
  entry.shape = static_cast<std::int32_t>(shapes_.size());
  entry.special = true;
  entry.moves = placed.motion != kNone;
  shapes_.emplace_back(placed.object_to_world, placed.world_to_object, *mesh.shape);
  const double radiance = luminance(material.emission);
  LightBounds light = entry.moves ? bounds_of_moving(scene, placed, radiance, material.double_sided)
                                  : shapes_.back().bounds(radiance, material.double_sided);
  entry.centre = Vec3f((light.box_min + light.box_max) * 0.5);
  // That of a plane is infinite: left to BSDF sampling.
  if (!std::isfinite(light.strength)) light.strength = 0;
  entries_.push_back(entry);
  bounds.push_back(light);
}

void LightSampler::add_punctual(const Scene& scene, std::vector<LightBounds>& bounds) {
  std::vector<double> powers;  // parallel to distant_
  for (std::size_t i = 0; i < scene.lights.size(); ++i) {
    const PunctualLight& light = scene.lights[i];
    Entry entry;
    entry.punctual = static_cast<std::int32_t>(i);
    entry.density = 1;
    entry.special = entry.moves = !light.keys.empty();
    LightBounds b = entry.moves ? bounds_of_moving(light) : bounds_of(light, light);
    entry.centre = Vec3f((b.box_min + b.box_max) * 0.5);
    if (!std::isfinite(b.strength)) b.strength = 0;
    if (light.kind == PunctualLight::Kind::directional && b.strength > 0) {
      distant_.push_back(static_cast<std::uint32_t>(entries_.size()));
      powers.push_back(b.strength);
      b.strength = 0;  // no leaf of the tree, because it has no position
    }
    entries_.push_back(entry);
    bounds.push_back(b);
  }
  distant_choice_ = DiscreteDistribution(powers);
}

/// Weights by estimated irradiance, each at least 2^-10 of the largest.
LightSampler::Shares LightSampler::shares(const LightSampleContext& context) const {
  const bool environment = environment_irradiance_ > 0, distant = !distant_.empty(),
             tree = !tree_.empty();
  if (environment + distant + tree <= 1)
    return {environment ? 1.0 : 0, distant ? 1.0 : 0, tree ? 1.0 : 0};
  const double near = tree_.importance(context);
  const double importance = std::isfinite(near) ? near : std::numeric_limits<double>::max();
  const double largest = std::max({environment_irradiance_, distant_choice_.total(), importance});
  const auto weight = [largest](bool present, double w) {
    return present ? std::max(w / largest, 0x1p-10) : 0;
  };
  Shares s{weight(environment, environment_irradiance_), weight(distant, distant_choice_.total()),
           weight(tree, importance)};
  const double sum = s.environment + s.distant + s.tree;
  return {s.environment / sum, s.distant / sum, s.tree / sum};
}

bool LightSampler::sample(const LightSampleContext& context, const LightRandom& u,
                          LightSample* sample) const {
  const Shares s = shares(context);
  double rest = u.select;
  if (rest < s.environment) return sample_environment(static_cast<float>(s.environment), u, sample);
  rest -= s.environment;
  if (rest < s.distant) {
    return sample_distant(rest / s.distant, context.time, static_cast<float>(s.distant), sample);
  }
  if (!(s.tree > 0)) return false;
  const double select = clamp((rest - s.distant) / s.tree, 0.0, 1 - 0x1p-53);
  const LightTree::Choice choice = tree_.choose(context, select);
  const Entry& entry = entries_[choice.light];
  const auto probability = static_cast<float>(s.tree * choice.probability);
  if (entry.special) [[unlikely]]
    return sample_special(entry, probability, context, u, sample);
  if (entry.punctual != kNone) {
    const PunctualLight& light = punctual_[static_cast<std::size_t>(entry.punctual)];
    return sample_point_light(light, light, probability, context.point, sample);
  }
  return sample_emitter(entry, probability, context.point, u, sample);
}

bool LightSampler::sample_distant(double u, float time, float share, LightSample* sample) const {
  const DiscreteDistribution::Choice choice = distant_choice_.sample(u);
  const Entry& entry = entries_[distant_[static_cast<std::size_t>(choice.index)]];
  const PunctualLight& light = punctual_[static_cast<std::size_t>(entry.punctual)];
  sample->direction =
      -(entry.moves ? pose_of(shading_.source, light, time).direction : light.direction);
  sample->distant = true;
  sample->triangle = TriangleId{};
  sample->pdf = 0;
  const float probability = share * choice.pdf;
  sample->radiance_over_pdf = light.intensity / probability;
  return probability > 0 && max_component(light.intensity) > 0;
}

bool LightSampler::sample_environment(float share, const LightRandom& u,
                                      LightSample* sample) const {
  const EnvironmentMap::Sample environment = environment_->sample(u.u1, u.u2);
  sample->direction = environment.direction;
  sample->distant = true;
  sample->triangle = TriangleId{};
  sample->pdf = share * environment.pdf;
  if (!(sample->pdf > 0) || !(sample->pdf < INFINITY)) return false;
  sample->radiance_over_pdf = environment.radiance / sample->pdf;
  return max_component(environment.radiance) > 0;
}

bool LightSampler::sample_point_light(const PunctualLight& light, const PunctualPose& pose,
                                      float share, const Vec3f& point, LightSample* sample) {
  const PunctualSample s = sample_punctual(light, pose, point);
  sample->direction = s.direction;
  sample->distant = false;
  sample->target = Vec3f(pose.position);
  sample->triangle = TriangleId{};
  sample->pdf = 0;
  sample->radiance_over_pdf = s.irradiance / share;
  return share > 0 && max_component(s.irradiance) > 0;
}

/// Corner of a triangle of the entry's primitive, relative to `point`.
Vec3d LightSampler::corner_from(const Entry& entry, std::uint32_t triangle, std::size_t corner,
                                const Vec3f& point) const {
  const Affine3d& object_to_world =
      shading_.instances[entry.triangle.instance].source->object_to_world;
  const PrimitiveView& p = shading_.primitive(entry.triangle);
  return transform_point(object_to_world, Vec3d(p.positions[p.triangles[triangle][corner]])) -
         Vec3d(point);
}

bool LightSampler::may_be_near(const Entry& entry, const Vec3f& point) const {
  const Vec3f d = entry.centre - point;
  return dot(d, d) < entry.reach2;
}

/// The triangle as seen from `point`; with zero solid angle if it is sampled by area instead.
SphericalTriangle LightSampler::near_triangle(const Entry& entry, const Vec3f& point) const {
  if (!may_be_near(entry, point)) return {};
  const std::uint32_t t = entry.triangle.triangle;
  const auto seen = SphericalTriangle::seen_from_origin(corner_from(entry, t, 0, point),
                                                        corner_from(entry, t, 1, point),
                                                        corner_from(entry, t, 2, point));
  return seen.is_near() ? seen : SphericalTriangle{};
}

/// The rectangle as seen from `point`, starting at the first triangle's right angle.
SphericalRectangle LightSampler::near_rectangle(const Entry& entry, const Vec3f& point) const {
  if (!may_be_near(entry, point)) return {};
  const std::uint32_t t = entry.triangle.triangle;
  const std::size_t r = entry.right_angle;
  const Vec3d corner = corner_from(entry, t, r, point);
  const SphericalRectangle seen(corner, corner_from(entry, t, (r + 1) % 3, point) - corner,
                                corner_from(entry, t, (r + 2) % 3, point) - corner);
  return seen.is_near() ? seen : SphericalRectangle();
}

LightSampler::LightPoint LightSampler::sample_point_on(const Entry& entry, const Vec3f& point,
                                                       const LightRandom& u) const {
  LightPoint light_point{entry.triangle, {}, 0};
  if (entry.other == kNoTriangle) {
    const SphericalTriangle seen = near_triangle(entry, point);
    light_point.solid_angle = seen.solid_angle;
    light_point.weights =
        seen.solid_angle > 0
            ? seen.barycentrics_at(seen.sample(u.u1, u.u2))
            : warp::uniform_triangle({static_cast<float>(u.u1), static_cast<float>(u.u2)});
    return light_point;
  }
  const SphericalRectangle seen = near_rectangle(entry, point);
  light_point.solid_angle = seen.solid_angle();
  std::array<double, 2> at = {u.u1, u.u2};
  if (light_point.solid_angle > 0) at = seen.sample(u.u1, u.u2);
  std::size_t corner = entry.right_angle;
  if (at[0] + at[1] > 1) {  // the second triangle is parametrised from its opposite end
    light_point.triangle.triangle = entry.other;
    corner = entry.other_right_angle;
    at = {1 - at[0], 1 - at[1]};
  }
  std::array<double, 3> weights{};
  weights[corner] = 1 - at[0] - at[1];
  weights[(corner + 1) % 3] = at[0];
  weights[(corner + 2) % 3] = at[1];
  light_point.weights = {static_cast<float>(weights[1]), static_cast<float>(weights[2])};
  return light_point;
}

LightSampler::Emitted LightSampler::emitted(const Entry& entry, const LightPoint& light_point,
                                            const Vec3f& direction) const {
  if (entry.uniform) {
    const Material& m =
        *shading_.materials[shading_.primitive(light_point.triangle).material].source;
    const float along = dot(entry.normal, direction);
    return {along < 0 || m.double_sided ? m.emission : Vec3f{}, std::fabs(along)};
  }
  const ShadingPoint light = surface_at(shading_, light_point.triangle, light_point.weights.x,
                                        light_point.weights.y, direction);
  return {emission_at(shading_, light, -direction) * coverage_at(shading_, light),
          std::fabs(dot(light.geometric_normal, direction))};
}

bool LightSampler::sample_emitter(const Entry& entry, float share, const Vec3f& point,
                                  const LightRandom& u, LightSample* sample) const {
  const LightPoint light_point = sample_point_on(entry, point, u);
  const TriangleId& id = light_point.triangle;
  const Vec2f& w = light_point.weights;
  const InstanceView& instance = shading_.instances[id.instance];
  const PrimitiveView& p = shading_.primitive(id);
  const auto& v = p.triangles[id.triangle];
  const Vec3f a = p.positions[v[0]], b = p.positions[v[1]], c = p.positions[v[2]];
  sample->target = transform_point(instance.object_to_world, a + (b - a) * w.x + (c - a) * w.y);
  const Vec3f to_light = sample->target - point;
  const float distance = length(to_light);
  sample->direction = normalize(to_light);
  sample->distant = false;
  sample->triangle = id;
  const auto [radiance, cosine] = emitted(entry, light_point, sample->direction);
  if (!(max_component(radiance) > 0)) return false;
  sample->pdf = light_point.solid_angle > 0
                    ? static_cast<float>(share / light_point.solid_angle)
                    : solid_angle_density(share * entry.density, distance, cosine);
  if (!(sample->pdf > 0) || !(sample->pdf < INFINITY)) return false;
  sample->radiance_over_pdf = radiance / sample->pdf;
  return true;
}

float LightSampler::emitter_pdf(const LightSampleContext& context, const TriangleId& id,
                                float distance, float cos_light) const {
  if (tree_.empty()) return 0;
  const std::int64_t first = slots_[slot_first_[id.instance] + id.primitive];
  if (first == kNone) return 0;
  const bool shape = entries_[static_cast<std::size_t>(first)].shape != kNone;
  auto light = static_cast<std::uint32_t>(first) + (shape ? 0 : id.triangle);
  if (entries_[light].merged) --light;
  const double share = shares(context).tree * tree_.probability(context, light);
  if (!(share > 0)) return 0;
  const Entry& entry = entries_[light];
  if (entry.special) [[unlikely]]
    return special_pdf(entry, share, context, id, distance, cos_light);
  const double solid_angle = entry.other == kNoTriangle
                                 ? near_triangle(entry, context.point).solid_angle
                                 : near_rectangle(entry, context.point).solid_angle();
  if (solid_angle > 0) return static_cast<float>(share / solid_angle);
  return solid_angle_density(static_cast<float>(share) * entry.density, distance, cos_light);
}

std::int64_t LightSampler::memory_bytes() const {
  return static_cast<std::int64_t>(entries_.size() * sizeof(Entry) +
                                   slots_.size() * sizeof(std::int64_t) +
                                   volumes_.size() * sizeof(VolumeLight)) +
         tree_.memory_bytes() + (environment_ == nullptr ? 0 : environment_->memory_bytes());
}

}  // namespace tessera::render
