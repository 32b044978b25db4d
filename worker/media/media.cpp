#include "worker/media/media.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <vector>

#include "worker/math/elementary.h"
#include "worker/sampling/exponential_distance.h"
#include "worker/shading/surface/surface.h"

namespace tessera::render {
namespace {

/// Maximum number of tracking steps in one segment; paths that exceed it are terminated.
constexpr int kMaxSteps = 1 << 16;
/// Points of a segment at which the emission of varying density is evaluated.
constexpr int kEmissionPoints = 16;
/// Ratio tracking uses Russian roulette below this transmittance.
constexpr float kFaint = 0.1f;

/// Clips the segment to the ball.
void clip(const Vec3f& center, float radius, MediumSegment* segment) {
  const Vec3d from = segment->origin - Vec3d(center);
  const double middle = -dot(from, segment->direction);
  const Vec3d nearest = from + segment->direction * middle;
  const double r = static_cast<double>(radius);
  const double half2 = r * r - dot(nearest, nearest);
  if (!(half2 > 0)) {
    segment->end = segment->begin;
    return;
  }
  const double half = std::sqrt(half2);
  segment->begin = std::max(segment->begin, middle - half);
  segment->end = std::min(segment->end, middle + half);
}

/// Clips the segment to the box of its density grid, outside of which the density is zero.
void clip_to_grid(MediumSegment* segment) {
  const DensityGrid& grid = *segment->medium->grid;
  Vec3d from = segment->origin + segment->medium->origin, along = segment->direction;
  if (segment->inwards) {
    from = transform_point(*segment->inwards, segment->origin);
    along = transform_vector(*segment->inwards, segment->direction);
  }
  for (int k = 0; k < 3; ++k) {
    const double a = (static_cast<double>(grid.low[k]) - from[k]) / along[k];
    const double b = (static_cast<double>(grid.high[k]) - from[k]) / along[k];
    // NaN (a ray in a face of the box) clips nothing.
    if (std::min(a, b) > segment->begin) segment->begin = std::min(a, b);
    if (std::max(a, b) < segment->end) segment->end = std::max(a, b);
  }
}

/// Tentative collisions with a homogeneous medium of the maximum density.
class Steps {
 public:
  Steps(const MediumSegment& segment, HashSequence* random)
      : segment_(segment), random_(*random), t_(segment.begin) {
    const MediumView& medium = *segment.medium;
    densest_ = static_cast<double>(max_component(medium.extinction)) *
               static_cast<double>(medium.max_density);
  }

  /// Advances to the next tentative collision; false beyond the end.
  bool advance() {
    const float u = random_.next();
    t_ -= static_cast<double>(elementary::log1p(-u)) / densest_;
    return t_ < segment_.end;
  }

  double at() const { return t_; }

  /// Probability per channel that the collision is real.
  Vec3f real() const {
    const MediumView& medium = *segment_.medium;
    return medium.extinction * (segment_.density(t_) / static_cast<float>(densest_));
  }

 private:
  const MediumSegment& segment_;
  HashSequence& random_;
  double t_, densest_;
};

}  // namespace

MediumSegment segment_along(const ShadingScene& scene, const MediumStack& stack, const Ray& ray,
                            double begin, double end) {
  MediumSegment out;
  const Body* body = stack.top();
  out.medium = &medium_in(scene, stack);
  if (!out.medium->present()) return out;
  if (body != nullptr && !out.medium->is_homogeneous())
    out.inwards = medium_space(scene.source, *out.medium, *body->instance->source, ray.time);
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

Vec3f transmittance(const MediumSegment& segment, HashSequence* random) {
  if (segment.empty() || !(max_component(segment.medium->extinction) > 0)) return {1, 1, 1};
  if (segment.medium->is_homogeneous()) {
    return beer_transmittance(segment.medium->extinction, static_cast<float>(segment.length()));
  }
  Vec3f passes{1, 1, 1};
  Steps steps(segment, random);
  for (int i = 0; steps.advance(); ++i) {
    if (i == kMaxSteps) return {};
    passes *= Vec3f{1, 1, 1} - steps.real();
    if (max_component(passes) < kFaint) {
      if (random->next() < 0.5f) return {};
      passes *= 2.0f;
    }
  }
  return passes;
}

Vec3f emission_along(const MediumSegment& segment, HashSequence* random) {
  if (segment.empty()) return {};
  const MediumView& medium = *segment.medium;
  if (medium.is_homogeneous()) return emission_over(medium, static_cast<float>(segment.length()));
  const bool endless = !(segment.end < INFINITY);
  const double rate =
      endless ? static_cast<double>(least_extinction(medium) * medium.typical_density) : 0;
  const ExponentialDistance distances(rate, segment.begin, segment.end);
  const auto u = static_cast<double>(random->next());
  MediumSegment piece = segment;  // from one point to the next
  Vec3f arrives{1, 1, 1}, length;
  for (int i = 0; i < kEmissionPoints; ++i) {
    piece.end = distances.sample((i + u) / kEmissionPoints);
    arrives *= transmittance(piece, random);
    if (!(max_component(arrives) > 0)) break;
    const auto pdf = static_cast<float>(distances.pdf(piece.end) * kEmissionPoints);
    length += arrives * (segment.density(piece.end) / pdf);
    piece.begin = piece.end;
  }
  return medium.emission * length;
}

bool collides_heterogeneous(const MediumSegment& segment, HashSequence* random, Vec3f* throughput,
                            double* at) {
  const MediumView& medium = *segment.medium;
  Steps steps(segment, random);
  for (int i = 0; steps.advance(); ++i) {
    if (i == kMaxSteps) {
      *throughput = {};
      return false;
    }
    const Vec3f real = steps.real(), w = max(*throughput, Vec3f{});
    const float sum = w.x + w.y + w.z;
    if (!(sum > 0)) return false;
    const float probability = clamp(dot(w, real) / sum, 0.0f, 1.0f);
    if (random->next() < probability) {
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
  if (count_ == kMaxCrossings) return false;
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

namespace {

/// Returns whether the last crossing of the same body before `c` was in the same direction through
/// the same material: an edge that two triangles share, or shells that overlap.
bool repeats(std::span<const Crossing> before, const Crossing& c) {
  for (std::size_t i = before.size(); i-- > 0;) {
    const Crossing& b = before[i];
    if (b.body.id == c.body.id) return b.body.material == c.body.material && b.inwards == c.inwards;
  }
  return false;
}

}  // namespace

MediumStack initial_medium_stack(const ShadingScene& scene, const SceneAccel& accel, const Ray& ray,
                                 Crossings* crossings) {
  MediumStack stack;
  if ((scene.traits & kTraitBody) == 0 || !scene.may_be_in_body(ray.origin)) return stack;
  crossings->clear();
  Ray onwards = ray;
  onwards.t_max = INFINITY;
  const bool full = accel.any_hit(onwards, [&](const Hit& hit) {
    if ((scene.primitive(hit.id).traits & kTraitBody) == 0) return false;
    return !crossings->add(scene, hit, onwards.direction, onwards.time);
  });
  if (full) return stack;  // what was collected depends on the traversal
  const std::span<const Crossing> met = crossings->in_order();
  thread_local std::vector<Body> entered;  // and not left, without the stack's limit
  entered.clear();
  std::array<const Crossing*, MediumStack::kMaxDepth> left;
  std::size_t count = 0;
  for (std::size_t i = 0; i < met.size() && count < left.size(); ++i) {
    if (repeats(met.first(i), met[i])) continue;
    if (met[i].inwards) {
      entered.push_back(met[i].body);
      continue;
    }
    const std::size_t index = entry_left(entered, met[i].body);
    if (index < entered.size()) {
      entered.erase(entered.begin() + static_cast<std::ptrdiff_t>(index));
    } else {
      left[count++] = &met[i];
    }
  }
  while (count > 0) stack.enter(left[--count]->body);  // the body that is left last: entered first
  return stack;
}

Vec3f transmittance_across(const ShadingScene& scene, const Ray& ray,
                           std::span<const Crossing> crossed, MediumStack* stack,
                           HashSequence* random) {
  const auto unit = static_cast<double>(length(ray.direction));
  Ray along = ray;
  along.direction = normalize(ray.direction);
  Vec3f passes{1, 1, 1};
  double from = 0;
  const auto pass_to = [&](double to) {
    passes *= transmittance(segment_along(scene, *stack, along, from, to), random);
    from = to;
  };
  for (const Crossing& c : crossed) {
    const bool visible = c.body.material->rank != kBoundaryRank && !stack->hides(c.body);
    if (visible) return {};
    pass_to(static_cast<double>(c.t) * unit);
    stack->cross(c.body, c.inwards);
    if (!(max_component(passes) > 0)) return {};
  }
  pass_to(static_cast<double>(ray.t_max) * unit);
  return passes;
}

}  // namespace tessera::render
