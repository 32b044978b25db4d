#include "worker/light/light_table.h"

#include <algorithm>
#include <cmath>

#include "worker/light/emissive_power.h"
#include "worker/light/punctual.h"
#include "worker/sampling/warp.h"
#include "worker/shading/surface.h"

namespace tessera::render {
namespace {

constexpr double kPi = 3.14159265358979323846;

/// The last entry whose lower edge is at or below u: entries without power are stepped over.
std::size_t find_entry(const std::vector<double>& cdf, double u) {
  return static_cast<std::size_t>(std::upper_bound(cdf.begin(), cdf.end() - 1, u) - cdf.begin()) -
         1;
}

Vec3d world_vertex(const Instance& instance, const Primitive& p, std::uint32_t v) {
  return transform_point(instance.object_to_world, Vec3d(p.positions[v]));
}

double triangle_area(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  return 0.5 * length(cross(b - a, c - a));
}

/// Flux per area a triangle gives off, as far as its material and textures tell. Texture sums are
/// made once per material.
class EmissionPower {
 public:
  EmissionPower(const Scene& scene, const TextureTable& textures)
      : scene_(scene), textures_(textures), sums_(scene.materials.size()) {}

  double at(const Primitive& p, const std::array<std::uint32_t, 3>& t) {
    const auto index = static_cast<std::size_t>(p.material);
    const Material& material = scene_.materials[index];
    const double power = luminance(material.emission) * (material.double_sided ? 2 * kPi : kPi);
    const TextureRef& ref = material.emissive_texture;
    if (!ref) return power;
    if (!sums_[index]) sums_[index] = std::make_unique<EmissiveTextureSums>(textures_, ref, scene_);
    const auto& uv = p.uv[ref.uv_set == 1 ? 1 : 0];
    if (uv.empty()) return power * sums_[index]->mean({}, {}, {});
    return power * sums_[index]->mean(uv[t[0]], uv[t[1]], uv[t[2]]);
  }

 private:
  const Scene& scene_;
  const TextureTable& textures_;
  std::vector<std::unique_ptr<EmissiveTextureSums>> sums_;  // by material
};

}  // namespace

LightTable::LightTable(const Scene& scene, const ShadingScene& shading)
    : shading_(shading), punctual_(scene.lights) {
  if (scene.has_environment) environment_ = std::make_unique<EnvironmentMap>(scene);
  cdf_.push_back(0);
  add_emitters(scene);
  add_punctual(scene);
  normalise();
  const bool varied_sky = environment_ != nullptr && !environment_->is_constant();
  if (varied_sky) environment_share_ = cdf_.empty() ? 1.0f : 0.5f;
}

void LightTable::add_entry(const Entry& entry, double power) {
  const bool usable = power > 0 && std::isfinite(power);
  entries_.push_back(entry);
  cdf_.push_back(cdf_.back() + (usable ? power : 0));
}

void LightTable::add_emitters(const Scene& scene) {
  EmissionPower power(scene, shading_.textures);
  for (std::size_t i = 0; i < scene.instances.size(); ++i) {
    const Instance& instance = scene.instances[i];
    const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
    slot_first_.push_back(static_cast<std::uint32_t>(slots_.size()));
    for (std::size_t k = 0; k < mesh.primitives.size(); ++k) {
      const Primitive& p = mesh.primitives[k];
      if (!shading_.materials[static_cast<std::size_t>(p.material)].emissive) {
        slots_.push_back(kNone);
        continue;
      }
      slots_.push_back(static_cast<std::int64_t>(entries_.size()));
      for (std::size_t t = 0; t < p.triangles.size(); ++t) {
        const auto& v = p.triangles[t];
        const double area =
            triangle_area(world_vertex(instance, p, v[0]), world_vertex(instance, p, v[1]),
                          world_vertex(instance, p, v[2]));
        Entry entry;
        entry.triangle = {static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(k),
                          static_cast<std::uint32_t>(t)};
        // Becomes probability / area once the total is known.
        const auto density = area > 0 ? static_cast<float>(1 / area) : INFINITY;
        const bool usable = density < INFINITY;  // slivers are left to chance hits
        entry.density = usable ? density : 0;
        add_entry(entry, usable ? area * power.at(p, v) : 0);
      }
    }
  }
}

void LightTable::add_punctual(const Scene& scene) {
  const Vec3d diagonal = scene.bounds_max - scene.bounds_min;
  const double radius2 = 0.25 * dot(diagonal, diagonal);
  for (std::size_t i = 0; i < scene.lights.size(); ++i) {
    const PunctualLight& light = scene.lights[i];
    double flux_per_intensity = 4 * kPi;
    if (light.kind == PunctualLight::Kind::spot)
      flux_per_intensity = 2 * kPi * (1 - light.cos_outer);
    if (light.kind == PunctualLight::Kind::directional) flux_per_intensity = kPi * radius2;
    Entry entry;
    entry.punctual = static_cast<std::int32_t>(i);
    entry.density = 1;
    add_entry(entry, luminance(light.intensity) * flux_per_intensity);
  }
}

void LightTable::normalise() {
  const double total = cdf_.back();
  if (!(total > 0) || !std::isfinite(total)) {
    cdf_.clear();
    entries_.clear();
    slots_.assign(slots_.size(), kNone);
    return;
  }
  const bool varied_sky = environment_ != nullptr && !environment_->is_constant();
  const double share = varied_sky ? 0.5 : 1;
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    const double probability = share * (cdf_[i + 1] - cdf_[i]) / total;
    entries_[i].density = static_cast<float>(probability * entries_[i].density);
  }
  for (double& c : cdf_) c /= total;
  cdf_.back() = 1;
}

bool LightTable::sample(const Vec3f& point, const LightRandom& u, LightSample* sample) const {
  LightRandom rest = u;
  if (environment_share_ > 0) {
    const double share = environment_share_;
    if (u.select < share) return sample_environment(u, sample);
    rest.select = (u.select - share) / (1 - share);
  }
  if (cdf_.empty()) return false;
  const Entry& entry = entries_[find_entry(cdf_, rest.select)];
  if (entry.punctual != kNone) return sample_point_light(entry, point, sample);
  return sample_emitter(entry, point, rest, sample);
}

bool LightTable::sample_environment(const LightRandom& u, LightSample* sample) const {
  const EnvironmentMap::Sample sky = environment_->sample(u.u1, u.u2);
  sample->direction = sky.direction;
  sample->distant = true;
  sample->triangle = TriangleId{};
  sample->pdf = environment_share_ * sky.pdf;
  if (!(sample->pdf > 0) || !(sample->pdf < INFINITY)) return false;
  sample->radiance_over_pdf = sky.radiance / sample->pdf;
  return max_component(sky.radiance) > 0;
}

bool LightTable::sample_point_light(const Entry& entry, const Vec3f& point,
                                    LightSample* sample) const {
  const PunctualLight& light = punctual_[static_cast<std::size_t>(entry.punctual)];
  const PunctualSample s = sample_punctual(light, point);
  sample->direction = s.direction;
  sample->distant = light.kind == PunctualLight::Kind::directional;
  sample->target = Vec3f(light.position);
  sample->triangle = TriangleId{};
  sample->pdf = 0;
  sample->radiance_over_pdf = s.irradiance / entry.density;
  return entry.density > 0 && max_component(s.irradiance) > 0;
}

bool LightTable::sample_emitter(const Entry& entry, const Vec3f& point, const LightRandom& u,
                                LightSample* sample) const {
  const Vec2f w = warp::uniform_triangle({static_cast<float>(u.u1), static_cast<float>(u.u2)});
  const TriangleId& id = entry.triangle;
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
  const ShadingPoint light = surface_at(shading_, id, w.x, w.y, sample->direction);
  const Vec3f radiance = emission_at(shading_, light) * coverage_at(shading_, light);
  if (!(max_component(radiance) > 0)) return false;
  const float cosine = std::fabs(dot(light.geometric_normal, sample->direction));
  sample->pdf = emitter_pdf(id, distance, cosine);
  if (!(sample->pdf > 0) || !(sample->pdf < INFINITY)) return false;
  sample->radiance_over_pdf = radiance / sample->pdf;
  return true;
}

float LightTable::emitter_pdf(const TriangleId& id, float distance, float cos_light) const {
  if (cdf_.empty()) return 0;
  const std::int64_t first = slots_[slot_first_[id.instance] + id.primitive];
  if (first == kNone) return 0;
  const float density = entries_[static_cast<std::size_t>(first) + id.triangle].density;
  if (!(cos_light > 0)) return INFINITY;
  return density * distance * distance / cos_light;
}

std::int64_t LightTable::memory_bytes() const {
  return static_cast<std::int64_t>(entries_.size() * sizeof(Entry) + cdf_.size() * sizeof(double) +
                                   slots_.size() * sizeof(std::int64_t)) +
         (environment_ == nullptr ? 0 : environment_->memory_bytes());
}

}  // namespace tessera::render
