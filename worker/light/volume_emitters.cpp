// Sampling of emissive media that fill bodies.

#include <algorithm>
#include <array>
#include <cmath>

#include "worker/light/light_sampler.h"
#include "worker/sampling/exponential_distance.h"
#include "worker/sampling/hash.h"

namespace tessera::render {
namespace {

/// Points of a ray among which one is chosen in a medium of varying density.
constexpr std::size_t kCandidates = 8;

/// A point of a ray and the radiance that it stands for: emission over its density per metre.
struct EmittingPoint {
  double distance = 0;
  Vec3f radiance;
};

/// Samples by transmittance or uniformly with equal probability: the body may fill only a far part
/// of the chord, where the density of the former alone would be tiny.
EmittingPoint sample_homogeneous(const MediumView& medium, const ShapeLight::Chord& chord,
                                 double u) {
  const auto rate = static_cast<double>(least_extinction(medium));
  const ExponentialDistance near(rate, chord.begin, chord.end), anywhere(0, chord.begin, chord.end);
  const double t = u < 0.5 ? near.sample(2 * u) : anywhere.sample(2 * u - 1);
  const double pdf = 0.5 * (near.pdf(t) + anywhere.pdf(t));
  return {t, medium.emission * static_cast<float>(1 / pdf)};
}

/// Chooses one of several points, one per stratum of the chord, in proportion to their density.
/// `density(t)` is that at distance t.
template <typename Density>
EmittingPoint sample_heterogeneous(const MediumView& medium, const ShapeLight::Chord& chord,
                                   const LightRandom& u, const Density& density) {
  const double step = (chord.end - chord.begin) / kCandidates;
  std::array<double, kCandidates + 1> sums{};
  const auto at = [&](std::size_t i) {
    return chord.begin + (static_cast<double>(i) + u.u3) * step;
  };
  for (std::size_t i = 0; i < kCandidates; ++i) {
    sums[i + 1] = sums[i] + static_cast<double>(density(at(i)));
  }
  const double chosen = sums.back() * (static_cast<double>(mix(u.bits) >> 11) * 0x1p-53);
  std::size_t i = 0;
  while (i + 1 < kCandidates && !(chosen < sums[i + 1])) ++i;
  return {at(i), medium.emission * static_cast<float>(sums.back() * step)};
}

}  // namespace

/// Adds the bodies whose surface is the invisible boundary of an emissive medium. Light does not
/// leave a visible solid straight, and the extent of a CSG solid is known only to rays: both are
/// left to BSDF sampling.
void LightSampler::add_volumes(const Scene& scene, std::vector<LightBounds>& bounds) {
  const auto shines = [](const MaterialView& m) {
    return m.rank == kBoundaryRank && m.medium.emits();
  };
  const auto& materials = shading_.materials;
  if (std::none_of(materials.begin(), materials.end(), shines)) return;
  MeshBoxes boxes(scene);
  for (std::uint32_t i = 0; i < scene.instances.size(); ++i) {
    if (scene.instances[i].operand) continue;
    const Mesh& mesh = scene.meshes[static_cast<std::size_t>(scene.instances[i].mesh)];
    const std::size_t first = volumes_.size();
    for (const Primitive& p : mesh.primitives) {
      const MaterialView& material = materials[static_cast<std::size_t>(p.material)];
      const bool added = std::any_of(
          volumes_.begin() + static_cast<std::ptrdiff_t>(first), volumes_.end(),
          [&material](const VolumeLight& light) { return &light.material() == &material; });
      if (shines(material) && !added) add_volume(scene, i, material, boxes, bounds);
    }
  }
}

void LightSampler::add_volume(const Scene& scene, std::uint32_t instance,
                              const MaterialView& material, MeshBoxes& boxes,
                              std::vector<LightBounds>& bounds) {
  auto volume = VolumeLight::make(scene, shading_.instances[instance], material, boxes);
  if (!volume) return;
  LightBounds light = volume->bounds();
  if (!std::isfinite(light.strength)) light.strength = 0;
  Entry entry;
  entry.volume = static_cast<std::int32_t>(volumes_.size());
  entry.special = true;
  entry.centre = Vec3f((light.box_min + light.box_max) * 0.5);
  volume_entries_.push_back(static_cast<std::uint32_t>(entries_.size()));
  volumes_.push_back(*std::move(volume));
  entries_.push_back(entry);
  bounds.push_back(light);
}

/// Samples a direction, whose density is over solid angle, and one point of the line in which the
/// medium would shine along it.
bool LightSampler::sample_volume(const VolumeLight& light, float share,
                                 const LightSampleContext& context, const LightRandom& u,
                                 LightSample* sample) const {
  const Vec3d from(context.point);
  const double solid_angle = light.hull().solid_angle(from);
  if (!(solid_angle > 0)) return false;
  const Vec3d direction = light.hull().sample(from, u.u1, u.u2);
  const auto chord = light.hull().chord(from, direction);
  if (!chord) return false;
  EmittingPoint point;
  if (light.medium().is_homogeneous()) {
    point = sample_homogeneous(light.medium(), *chord, u.u3);
  } else {
    const auto space =
        medium_space(shading_.source, light.medium(), *light.instance().source, context.time);
    point = sample_heterogeneous(light.medium(), *chord, u, [&](double t) {
      return density_at(light.medium(), space ? &*space : nullptr, from + direction * t);
    });
  }
  sample->direction = Vec3f(direction);
  sample->target = Vec3f(from + direction * point.distance);
  sample->distant = false;
  sample->triangle = TriangleId{};
  sample->body = light.instance().body;
  sample->filling = &light.material();
  sample->pdf = static_cast<float>(static_cast<double>(share) / solid_angle);
  if (!(sample->pdf > 0) || !(sample->pdf < INFINITY)) return false;
  sample->radiance_over_pdf = point.radiance / sample->pdf;
  return max_component(point.radiance) > 0;
}

const VolumeLight* LightSampler::find_volume(std::uint32_t body,
                                             const MaterialView& material) const {
  const auto before = [](const VolumeLight& light, std::uint32_t b) {
    return light.instance().body < b;
  };
  auto found = std::lower_bound(volumes_.begin(), volumes_.end(), body, before);
  for (; found != volumes_.end() && found->instance().body == body; ++found) {
    if (&found->material() == &material) return &*found;
  }
  return nullptr;
}

float LightSampler::volume_pdf(const LightSampleContext& context, const VolumeLight& light) const {
  if (tree_.empty()) return 0;
  const std::uint32_t entry = volume_entries_[static_cast<std::size_t>(&light - volumes_.data())];
  const double share = shares(context).tree * tree_.probability(context, entry);
  const double solid_angle = light.hull().solid_angle(Vec3d(context.point));
  return solid_angle > 0 ? static_cast<float>(share / solid_angle) : 0;
}

}  // namespace tessera::render
