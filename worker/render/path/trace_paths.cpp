#include <array>
#include <cstddef>
#include <memory>

#include "worker/accel/traversal/thread_counts.h"
#include "worker/render/path/single_path.h"
#include "worker/render/spots/lens_spots.h"
#include "worker/sampling/dimensions.h"

namespace tessera::render {
namespace {

/// Makes t_max negative for paths without a camera ray, so that they hit nothing.
template <bool kMoves>
Ray camera_ray(const FrameContext& frame, const PathId& id, const Sampler& sampler,
               const Vec2f& offset) {
  Vec2f lens;
  if (frame.camera.takes_lens()) [[unlikely]]
    lens = sampler.get_2d(dimensions::kLens);
  CameraRay camera{{}, {0, 0, 1}, -1};
  Ray ray;
  if constexpr (kMoves) ray.time = sampler.get_4d(dimensions::kFilter).z;
  const double x = id.x + 0.5 + static_cast<double>(offset.x);
  const double y = id.y + 0.5 + static_cast<double>(offset.y);
  if (kMoves && frame.camera.moves()) {
    frame.camera.at(ray.time).ray(x, y, lens, &camera);
  } else {
    frame.camera.ray(x, y, lens, &camera);
  }
  ray.origin = camera.origin;
  ray.direction = camera.direction;
  ray.t_max = camera.t_max;
  return ray;
}

/// Creates the samplers and camera rays of the paths. `kMoves` is frame.moves. Not inlined, so that
/// static frames do not carry the constants of moving ones.
template <bool kMoves>
__attribute__((noinline)) void begin_paths(const FrameContext& frame, std::span<const PathId> ids,
                                           std::span<Sampler> samplers, std::span<Ray> rays) {
  for (std::size_t i = 0; i < ids.size(); ++i) {
    const PathId& id = ids[i];
    samplers[i] = Sampler(frame.seed, frame.frame, id.x, id.y, id.sample);
    const Vec2f offset = frame.filter.sample(samplers[i].get_2d(dimensions::kFilter));
    rays[i] = camera_ray<kMoves>(frame, id, samplers[i], offset);
  }
}

/// Starts a second path of a sample: its random numbers are those of a pixel outside the image,
/// which no other path has.
PathStart second_start(const FrameContext& frame, const PathId& id) {
  return {Sampler(frame.seed, frame.frame, ~id.x, id.y, id.sample), {}};
}

/// Traces the second path of a sample and adds what it finds.
void add_second_path(const FrameContext& frame, const PathStart& second, PathScratch* scratch,
                     PathResult* result) {
  if (PathObserver* observer = scratch->observer) [[unlikely]]
    observer->on_second_path(second.second->offset);
  const PathResult found = trace_path(frame, second, scratch);
  result->radiance += found.radiance;
  result->limit_count += found.limit_count;
}

/// Traces a path, and a second one from the same point of the film that looks for a light out of
/// focus.
PathResult trace_lens_sample(const FrameContext& frame, const PathId& id, PathStart start,
                             PathScratch* scratch) {
  const LensSpots::Pixel spots = frame.lens_spots->at(id.x, id.y);
  if (spots.empty()) return trace_path(frame, start, scratch);
  const Vec2f offset = frame.filter.sample(start.sampler.get_2d(dimensions::kFilter));
  const double x = id.x + 0.5 + static_cast<double>(offset.x);
  const double y = id.y + 0.5 + static_cast<double>(offset.y);
  const Vec2d slope = frame.camera.slope_at(x, y);
  start.direct_weight = spots.weight(
      aperture_point(frame.camera.lens(), start.sampler.get_2d(dimensions::kLens)), slope);
  PathResult result = trace_path(frame, start, scratch);
  PathStart second = second_start(frame, id);
  const Vec4f u = second.sampler.get_4d(dimensions::kFilter);
  const LensSpots::Pixel::Second through = spots.sample(u.z, {u.x, u.y}, slope);
  CameraRay ray{{}, {0, 0, 1}, -1};
  if (!(through.weight > 0) || !frame.camera.ray_through(x, y, through.point, &ray)) return result;
  second.ray.origin = ray.origin;
  second.ray.direction = ray.direction;
  second.ray.t_max = ray.t_max;
  second.second = LightSpots::Pixel::Second{offset, kNoLobes, through.weight};
  add_second_path(frame, second, scratch, &result);
  return result;
}

/// Traces a path, and a second one that looks for the lights in the spots around its pixel.
PathResult trace_sample(const FrameContext& frame, const PathId& id, PathStart start,
                        PathScratch* scratch) {
  if (frame.lens_spots != nullptr) [[unlikely]]
    return trace_lens_sample(frame, id, start, scratch);
  if (frame.spots == nullptr) return trace_path(frame, start, scratch);
  start.spots = frame.spots->at(id.x, id.y);
  if (start.spots.empty()) return trace_path(frame, start, scratch);
  start.offset = frame.filter.sample(start.sampler.get_2d(dimensions::kFilter));
  PathResult result = trace_path(frame, start, scratch);
  PathStart second = second_start(frame, id);
  const Vec4f u = second.sampler.get_4d(dimensions::kFilter);
  second.second = start.spots.sample(u.z, {u.x, u.y});
  if (!(second.second->weight > 0)) return result;
  second.ray = camera_ray<false>(frame, id, second.sampler, second.second->offset);
  if (second.ray.t_max < 0) return result;
  add_second_path(frame, second, scratch, &result);
  return result;
}

/// Returns whether every surface blocks camera rays.
bool takes_packets(const FrameContext& frame) {
  const unsigned traits = kTraitAlpha | (frame.cull_backfaces ? kTraitOneSided : 0u);
  return (frame.shading.traits & traits) == 0 && frame.accel.takes_packets();
}

}  // namespace

void trace_paths(const FrameContext& frame, std::span<const PathId> ids, PathScratch* scratch,
                 PathResult* results) {
  std::array<Sampler, kPacketSize> samplers;
  std::array<Ray, kPacketSize> rays;
  frame.moves ? begin_paths<true>(frame, ids, samplers, rays)
              : begin_paths<false>(frame, ids, samplers, rays);
  std::array<Hit, kPacketSize> hits;  // invalid triangle on a miss
  const bool known = takes_packets(frame);
  if (frame.shading.tracks_bodies && scratch->crossings == nullptr) {
    scratch->crossings = std::make_unique<Crossings>();
  }
  if (known) frame.accel.closest_hits(std::span(rays).first(ids.size()), hits.data());
  const bool counted = (frame.aovs & contract::kAovTraversalCost) != 0;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (rays[i].t_max < 0) [[unlikely]] {
      results[i] = {};
      continue;
    }
    const Hit* first = known ? &hits[i] : nullptr;
    const contract::TraversalCounts before =
        counted ? thread_traversal_counts() : contract::TraversalCounts{};
    results[i] = trace_sample(frame, ids[i], {samplers[i], rays[i], first}, scratch);
    if (counted) [[unlikely]]
      results[i].cost = thread_traversal_counts() - before;
  }
}

}  // namespace tessera::render
