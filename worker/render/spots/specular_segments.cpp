#include "worker/render/spots/specular_segments.h"

#include <algorithm>

#include "worker/geometry/surface_point.h"
#include "worker/sampling/hash.h"
#include "worker/shading/bsdf/bsdf.h"

namespace tessera::render {
namespace {

constexpr std::int32_t kMaxSurfaces = 16;
constexpr float kMinThroughput = 0.0001f;
constexpr std::size_t kMaxSegments = 64;  // of a camera ray
/// A turn besides those of DeltaLobe: the ray passes the surface without a scattering event.
constexpr std::uint64_t kStraight = 3;

}  // namespace

struct SpecularTracer::End {
  TriangleId id;
  SurfacePoint position;
  bool only_passes = false;  // the surface is not seen here
  Bsdf bsdf;
  float straight = 0;  // luminance of the light that goes straight through
};

SpecularTracer::SpecularTracer(const ShadingScene& shading, const SceneAccel& accel,
                               std::int32_t max_depth)
    : shading_(shading), accel_(accel), max_surfaces_(std::min(max_depth, kMaxSurfaces)) {}

/// Sets the segment's length. Nullopt if no surface follows, or one that ends all paths.
std::optional<SpecularTracer::End> SpecularTracer::end_of(SpecularSegment* segment) {
  Hit hit;
  if (!accel_.closest_hit(segment->ray, hit)) return std::nullopt;
  segment->ray.t_max = hit.t;
  if (segment->surfaces >= max_surfaces_) return std::nullopt;
  const Vec3f& direction = segment->ray.direction;
  const ShadingPoint point = surface_at(shading_, hit, direction, 0, memory_);
  std::optional<End> end = End{hit.id, position_of(point), false, {}, 0};
  const MaterialView& material = *point.material;
  const bool is_boundary = (material.traits & kTraitCrossed) != 0 && material.rank == kBoundaryRank;
  if (material.source->unlit && segment->surfaces == 0) return std::nullopt;
  end->only_passes = material.source->unlit || is_boundary || coverage_at(shading_, point) < 0.5f;
  if (end->only_passes) return end;
  end->bsdf = bsdf_at(shading_, point, base_color_at(shading_, point), -direction);
  end->straight = luminance(straight_transmittance(end->bsdf));
  return end;
}

std::optional<SpecularSegment> SpecularTracer::next(const SpecularSegment& segment, const End& end,
                                                    std::uint64_t turn) const {
  SpecularSegment after = segment;
  Vec3f direction = segment.ray.direction;
  if (turn == kStraight) {
    if (!end.only_passes && !(end.straight > 0)) return std::nullopt;
    if (!end.only_passes) {
      after.throughput *= end.straight;
      after.probability *= end.straight / (end.straight + scattered_albedo(end.bsdf));
    }
  } else {
    const auto lobe = static_cast<DeltaLobe>(turn);
    BsdfSample sample;
    const float probability = end.only_passes ? 0 : sample_delta(end.bsdf, lobe, &sample);
    if (!(probability > 0)) return std::nullopt;
    direction = sample.wi;
    after.throughput *= luminance(sample.weight);
    after.probability *= probability;
    after.lobes = with_lobe(after.lobes, lobe);
  }
  after.ray = spawn_ray(end.position, end.id, direction);
  after.way = combine(combine(segment.way, pack(end.id.instance, end.id.primitive)), turn);
  after.turns |= turn << (2 * segment.surfaces);
  ++after.surfaces;
  return after;
}

void SpecularTracer::branch(SpecularSegment segment, std::vector<SpecularSegment>* segments) {
  if (segments->size() >= kMaxSegments) return;
  const std::optional<End> end = end_of(&segment);
  segments->push_back(segment);
  if (!end) return;
  for (std::uint64_t turn = 0; turn <= kStraight; ++turn) {
    const std::optional<SpecularSegment> after = next(segment, *end, turn);
    if (after && after->throughput >= kMinThroughput) branch(*after, segments);
  }
}

void SpecularTracer::trace(const Ray& camera_ray, std::vector<SpecularSegment>* segments) {
  SpecularSegment first;
  first.ray = camera_ray;
  branch(first, segments);
}

std::optional<SpecularSegment> SpecularTracer::follow(const Ray& camera_ray,
                                                      const SpecularSegment& like) {
  std::optional<SpecularSegment> segment = SpecularSegment{};
  segment->ray = camera_ray;
  while (segment->surfaces < like.surfaces) {
    const std::optional<End> end = end_of(&*segment);
    if (!end) return std::nullopt;
    segment = next(*segment, *end, like.turns >> (2 * segment->surfaces) & 3);
    if (!segment) return std::nullopt;
  }
  Hit hit;
  if (accel_.closest_hit(segment->ray, hit)) {
    segment->ray.t_max = hit.t;
    const Vec3f& direction = segment->ray.direction;
    const ShadingPoint point = surface_at(shading_, hit, direction, 0, memory_);
    if (point.material->emissive)
      segment->emitted = luminance(emission_at(shading_, point, -direction));
  }
  if (segment->way != like.way) return std::nullopt;
  return segment;
}

}  // namespace tessera::render
