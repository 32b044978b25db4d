#include "worker/media/media.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "worker/math/elementary.h"
#include "worker/scene/moved_pose.h"
#include "worker/shading/surface/surface.h"

namespace tessera::render {
namespace {

/// A path that would take more than so many steps through one stretch is given up.
constexpr int kMaxSteps = 1 << 16;
/// Ratio tracking goes on by chance below this.
constexpr float kFaint = 0.1f;

/// Cuts the stretch down to the ball.
void clip(const Vec3f& center, float radius, MediumSegment* stretch) {
  const Vec3d from = stretch->origin - Vec3d(center);
  const double middle = -dot(from, stretch->direction);
  const Vec3d nearest = from + stretch->direction * middle;
  const double r = static_cast<double>(radius);
  const double half2 = r * r - dot(nearest, nearest);
  if (!(half2 > 0)) {
    stretch->end = stretch->begin;
    return;
  }
  const double half = std::sqrt(half2);
  stretch->begin = std::max(stretch->begin, middle - half);
  stretch->end = std::min(stretch->end, middle + half);
}

/// Cuts a stretch of a grid down to its box, which is all it has.
void clip_to_grid(MediumSegment* stretch) {
  const DensityGrid& grid = *stretch->medium->grid;
  Vec3d from = stretch->origin + stretch->medium->origin, along = stretch->direction;
  if (stretch->inwards) {
    from = transform_point(*stretch->inwards, stretch->origin);
    along = transform_vector(*stretch->inwards, stretch->direction);
  }
  for (int k = 0; k < 3; ++k) {
    const double a = (static_cast<double>(grid.low[k]) - from[k]) / along[k];
    const double b = (static_cast<double>(grid.high[k]) - from[k]) / along[k];
    // NaN (a ray in the box's face) cuts nothing.
    if (std::min(a, b) > stretch->begin) stretch->begin = std::min(a, b);
    if (std::max(a, b) < stretch->end) stretch->end = std::max(a, b);
  }
}

/// Steps through a medium as dense everywhere as an uneven one is anywhere.
class Steps {
 public:
  Steps(const MediumSegment& stretch, HashSequence* chance)
      : stretch_(stretch), chance_(*chance), t_(stretch.begin) {
    const MediumView& medium = *stretch.medium;
    densest_ =
        static_cast<double>(max_component(medium.extinction)) * static_cast<double>(medium.most);
  }

  /// To the next collision; false beyond the end.
  bool advance() {
    const float u = chance_.next();
    t_ -= static_cast<double>(elementary::log1p(-u)) / densest_;
    return t_ < stretch_.end;
  }

  double at() const { return t_; }

  /// Probability, by channel, that the collision is with something.
  Vec3f real() const {
    const MediumView& medium = *stretch_.medium;
    return medium.extinction * (stretch_.density(t_) / static_cast<float>(densest_));
  }

 private:
  const MediumSegment& stretch_;
  HashSequence& chance_;
  double t_, densest_;
};

/// To the space that the body's medium is given in, unless that is the world's.
std::optional<Affine3d> inwards_of(const ShadingScene& scene, const Body& body, float time) {
  const ProceduralTexture* procedure = body.material->medium.procedure;
  if (procedure != nullptr && procedure->space == ProceduralTexture::Space::world) return std::nullopt;
  const auto pose = pose_of(scene.source, *body.instance->source, time);
  return pose ? pose->world_to_object : body.instance->source->world_to_object;
}

}  // namespace

MediumSegment stretch_along(const ShadingScene& scene, const MediumStack& interior, const Ray& ray,
                      double begin, double end) {
  MediumSegment out;
  const Body* body = interior.top();
  out.medium = body != nullptr ? &body->material->medium : &scene.atmosphere;
  if (!out.medium->present()) return out;
  if (body != nullptr && !out.medium->even()) out.inwards = inwards_of(scene, *body, ray.time);
  out.origin = Vec3d(ray.origin);
  out.direction = Vec3d(ray.direction);
  out.begin = begin;
  out.end = end;
  if (body == nullptr && scene.atmosphere_radius < INFINITY) {
    clip(scene.atmosphere_center, scene.atmosphere_radius, &out);
  }
  if (out.medium->grid != nullptr) clip_to_grid(&out);
  return out;
}

Vec3f transmittance(const MediumSegment& stretch, HashSequence* chance) {
  if (stretch.empty()) return {1, 1, 1};
  if (stretch.medium->even()) {
    return beer_transmittance(stretch.medium->extinction, static_cast<float>(stretch.length()));
  }
  Vec3f passes{1, 1, 1};
  Steps steps(stretch, chance);
  for (int i = 0; steps.advance(); ++i) {
    if (i == kMaxSteps) return {};
    passes *= Vec3f{1, 1, 1} - steps.real();
    if (max_component(passes) < kFaint) {
      if (chance->next() < 0.5f) return {};
      passes *= 2.0f;
    }
  }
  return passes;
}

bool collides_unevenly(const MediumSegment& stretch, HashSequence* chance, Vec3f* throughput,
                       double* at) {
  const MediumView& medium = *stretch.medium;
  Steps steps(stretch, chance);
  for (int i = 0; steps.advance(); ++i) {
    if (i == kMaxSteps) {
      *throughput = {};
      return false;
    }
    const Vec3f real = steps.real(), w = max(*throughput, Vec3f{});
    const float sum = w.x + w.y + w.z;
    if (!(sum > 0)) return false;
    const float probability = clamp(dot(w, real) / sum, 0.0f, 1.0f);
    if (chance->next() < probability) {
      for (int k = 0; k < 3; ++k) {
        const float sigma = medium.extinction[k];
        (*throughput)[k] *= sigma > 0 ? real[k] / probability * (medium.scattering[k] / sigma) : 0;
      }
      *at = steps.at();
      return true;
    }
    *throughput *= (Vec3f{1, 1, 1} - real) / (1 - probability);
  }
  return false;
}

bool Crossings::add(const ShadingScene& scene, const Hit& hit, const Vec3f& direction, float time) {
  if (count_ == kMost) return false;
  const ShadingPoint point = surface_at(scene, hit, direction, time, moved_);
  all_[count_++] = {hit.t, hit.id, body_of(point), point.front};
  return true;
}

std::span<const Crossing> Crossings::in_order() {
  const auto end = all_.begin() + static_cast<std::ptrdiff_t>(count_);
  std::sort(all_.begin(), end, [](const Crossing& a, const Crossing& b) {
    return std::tie(a.t, a.id) < std::tie(b.t, b.id);
  });
  const auto last = std::unique(all_.begin(), end, [](const Crossing& a, const Crossing& b) {
    return a.t == b.t && a.id == b.id;
  });
  return {all_.begin(), last};
}

MediumStack interior_at_start(const ShadingScene& scene, const SceneAccel& accel, const Ray& ray,
                           Crossings* crossings) {
  MediumStack interior;
  if ((scene.traits & kTraitBody) == 0 || !scene.may_be_in_body(ray.origin)) return interior;
  crossings->clear();
  Ray onwards = ray;
  onwards.t_max = INFINITY;
  accel.any_hit(onwards, [&](const Hit& hit) {
    if ((scene.primitive(hit.id).traits & kTraitBody) == 0) return false;
    return !crossings->add(scene, hit, onwards.direction, onwards.time);
  });
  const std::span<const Crossing> met = crossings->in_order();
  // What is left last was entered first.
  for (std::size_t i = met.size(); i-- > 0;) {
    const bool first = std::none_of(met.begin(), met.begin() + static_cast<std::ptrdiff_t>(i),
                                    [&](const Crossing& c) { return c.body.id == met[i].body.id; });
    if (first && !met[i].inwards) interior.enter(met[i].body);
  }
  return interior;
}

Vec3f transmittance_across(const ShadingScene& scene, MediumStack interior, const Ray& ray,
                           std::span<const Crossing> crossed, HashSequence* chance) {
  const auto unit = static_cast<double>(length(ray.direction));
  Ray along = ray;
  along.direction = normalize(ray.direction);
  Vec3f passes{1, 1, 1};
  double from = 0;
  const auto pass_to = [&](double to) {
    passes *= transmittance(stretch_along(scene, interior, along, from, to), chance);
    from = to;
  };
  for (const Crossing& c : crossed) {
    const bool seen = c.body.material->rank != kBoundaryRank && !interior.hides(c.body);
    if (seen) return {};
    pass_to(static_cast<double>(c.t) * unit);
    interior.cross(c.body, c.inwards);
    if (!(max_component(passes) > 0)) return {};
  }
  pass_to(static_cast<double>(ray.t_max) * unit);
  return passes;
}

}  // namespace tessera::render
