#include "worker/render/frame_renderer.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <tuple>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "contract/hilbert.h"
#include "worker/accel/traversal/thread_counts.h"
#include "worker/guide/guide.h"
#include "worker/guide/photon_trace.h"
#include "worker/light/light_sampler.h"
#include "worker/render/camera/camera_rays.h"
#include "worker/render/float_control.h"
#include "worker/render/path/motion_vectors.h"
#include "worker/render/path/path_tracer.h"
#include "worker/render/pixel_sums.h"
#include "worker/render/spots/lens_spots.h"
#include "worker/render/spots/light_spots.h"
#include "worker/sampling/dimensions.h"
#include "worker/sampling/sampler.h"
#include "worker/scene/features.h"
#include "worker/shading/surface/shading_scene.h"

namespace tessera::render {
namespace {

constexpr std::int64_t kPixelsPerChunk = 64;  // fixed size of a body of the parallel loop

/// Counters of the pixels of a chunk, summed in chunk order so that threads do not matter.
struct ChunkTotals {
  double clamped_energy = 0, truncated_energy = 0;
  std::int64_t limit_count = 0;
  std::vector<contract::DroppedSamples> dropped;
  contract::TraversalCounts cost;
};

/// One unit while it is rendered.
struct UnitWork {
  contract::PixelRect rect;
  contract::Pass pass;
  std::vector<contract::GridPoint> order;  // along the Hilbert curve
  contract::FilmBlock* block;
};

class PathTracingFrame final : public FrameRenderer {
 public:
  PathTracingFrame(Scene scene, const contract::RenderSettings& settings, std::int32_t frame,
                   const ParallelFor& parallel_for, const FrameRenderer* before,
                   const TraceOptions& tracing);

  contract::FilmBlock render(const contract::PixelRect& rect, const contract::Pass& pass,
                             std::int32_t pass_index,
                             const ParallelFor& parallel_for) const override;
  Sample trace_sample(std::int32_t x, std::int32_t y, std::int32_t sample,
                      PathObserver& observer) const override;
  Timings timings() const override { return timings_; }
  const SceneAccel& accel() const override { return accel_; }

 private:
  void render_chunk(const UnitWork& unit, std::int64_t chunk, ChunkTotals* totals) const;
  void store(const UnitWork& unit, std::size_t pixel, const PixelSums& sums,
             ChunkTotals* totals) const;
  void store_first_hit(const PathResult& path, std::size_t pixel, contract::FilmBlock* block) const;

  Timings timings_;  // first member: filled while the others are constructed
  const Scene scene_;
  const ShadingScene shading_;
  const CameraRays camera_;
  const SceneAccel accel_;
  const LightSampler lights_;
  const std::unique_ptr<const MotionVectors> motion_;  // null unless its layer is requested
  const std::unique_ptr<const Guide> guide_;  // null unless the job asks for it and it gains
  const PixelFilterSampler filter_;
  const std::unique_ptr<const LightSpots> spots_;  // null unless the job is guided and has spots
  const std::unique_ptr<const LensSpots> lens_spots_;
  const FrameContext context_;
  const float clamp_at_;
  const std::uint32_t aovs_;
};

std::size_t vertex_bytes(const SharedArray<Primitive>& primitives) {
  std::size_t bytes = 0;
  for (const Primitive& p : primitives) {
    bytes +=
        (p.positions.size() + p.normals.size()) * sizeof(Vec3f) + p.tangents.size() * sizeof(Vec4f);
  }
  return bytes;
}

/// Memory of the pose of another frame that `scene` does not share.
std::size_t pose_bytes(const Scene* pose, const Scene& scene) {
  if (pose == nullptr) return 0;
  std::size_t bytes = pose->instances.size() * sizeof(Instance);
  for (std::size_t i = 0; i < pose->meshes.size(); ++i) {
    const SharedArray<Primitive>& primitives = pose->meshes[i].primitives;
    const bool shared = i < scene.meshes.size() && primitives.shares(scene.meshes[i].primitives);
    if (!shared) bytes += vertex_bytes(primitives);
  }
  return bytes;
}

std::int64_t scene_bytes(const Scene& scene) {
  std::size_t bytes = 0;
  for (const Image& image : scene.images) {
    bytes += image.u8.size() + image.u16.size() * 2 + image.f32.size() * 4;
  }
  for (const Mesh& mesh : scene.meshes) {
    for (const Primitive& p : mesh.primitives) {
      bytes += p.positions.size() * sizeof(Vec3f) + p.triangles.size() * sizeof(p.triangles[0]) +
               p.normals.size() * sizeof(Vec3f) + p.tangents.size() * sizeof(Vec4f) +
               (p.uv[0].size() + p.uv[1].size()) * sizeof(Vec2f) + p.colors.size() * sizeof(Vec4f);
    }
    for (const SharedArray<Primitive>& key : mesh.keys) bytes += vertex_bytes(key);
  }
  bytes += pose_bytes(scene.before.get(), scene) + pose_bytes(scene.after.get(), scene);
  for (const auto& motion : scene.motions) bytes += motion.size() * sizeof(Affine3d);
  return static_cast<std::int64_t>(bytes + scene.instances.size() * sizeof(Instance));
}

/// Counted BVHs share nothing with `before`: refitting would make the counts depend on which frames
/// a worker has rendered.
SceneAccel timed_accel(const Scene& scene, const ParallelFor& parallel_for,
                       const FrameRenderer* before, const TraceOptions& tracing, double* seconds) {
  const auto start = std::chrono::steady_clock::now();
  SceneAccel accel =
      tracing.override_accelerator
          ? SceneAccel(tracing.override_accelerator(scene))
          : SceneAccel(scene, parallel_for, tracing,
                       before == nullptr || tracing.counted ? nullptr : &before->accel());
  *seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return accel;
}

TraceOptions with_counts(TraceOptions tracing, std::uint32_t aovs) {
  tracing.counted = tracing.counted || (aovs & contract::kAovTraversalCost) != 0;
  return tracing;
}

CameraRays camera_rays(const Scene& scene, const contract::RenderSettings& settings,
                       const TraceOptions& tracing) {
  CameraRays rays(scene.camera, settings.width, settings.height, tracing.assumed_features);
  // The scene's box is that of one time and without planes, and an atmosphere fills the way to it.
  const bool planes = std::any_of(scene.meshes.begin(), scene.meshes.end(), [](const Mesh& mesh) {
    return mesh.shape != nullptr && !mesh.shape->bounded();
  });
  if (!rays.moves() && scene.key_times.empty() && !scene.atmosphere && !planes) {
    rays.start_near(scene.bounds_min, scene.bounds_max);
  }
  return rays;
}

std::unique_ptr<const MotionVectors> motion_vectors(const Scene& scene,
                                                    const contract::RenderSettings& settings) {
  if (scene.before == nullptr || scene.after == nullptr) return nullptr;
  return std::make_unique<const MotionVectors>(scene, settings.width, settings.height);
}

/// A ParallelFor that checks the floating-point mode of the thread before each body.
ParallelFor checked(const ParallelFor& parallel_for) {
  return [&parallel_for](std::int64_t count, const std::function<void(std::int64_t)>& body) {
    parallel_for(count, [&body](std::int64_t i) {
      require_ieee_floats("before a part of the guide");
      body(i);
    });
  };
}

/// Camera rays to random points of the full frame.
std::vector<Ray> views(const CameraRays& camera, const contract::RenderSettings& settings,
                       std::int32_t frame) {
  constexpr std::int32_t kViews = 4096;
  std::vector<Ray> rays;
  for (std::int32_t i = 0; i < kViews; ++i) {
    const Sampler sampler(settings.seed, frame, -1, -1, i);
    const Vec2f at = sampler.get_2d(dimensions::kFilter);
    const Vec2f lens = sampler.get_2d(dimensions::kLens);
    CameraRay ray{{}, {0, 0, 1}, -1};
    const double x{at.x}, y{at.y};
    camera.ray(x * settings.width, y * settings.height, lens, &ray);
    if (ray.t_max < 0) continue;
    rays.push_back({ray.origin, ray.direction, ray.t_max});
  }
  return rays;
}

std::unique_ptr<const Guide> guide_of(PhotonScene scene, const CameraRays& camera,
                                      const contract::RenderSettings& settings,
                                      const ParallelFor& parallel_for) {
  if (!settings.is_guided()) return nullptr;
  const std::vector<Ray> rays = views(camera, settings, scene.frame);
  scene.camera_rays = rays;
  scene.pixels = std::int64_t{settings.width} * settings.height;
  return build_guide(scene, checked(parallel_for));
}

/// Returns whether samples of the frame may have second paths.
bool has_second_paths(const Scene& scene, const contract::RenderSettings& settings) {
  return settings.is_guided() && scene.key_times.empty() && scene.camera.keys.empty();
}

/// Lights out of focus; null if the frame has none.
std::unique_ptr<const LensSpots> lens_spots(const SpotSearch& search, const LightSampler& lights,
                                            const PixelFilterSampler& filter,
                                            const contract::RenderSettings& settings) {
  const Scene& scene = search.shading.source;
  if (!has_second_paths(scene, settings) || !(search.camera.lens().radius > 0)) return nullptr;
  std::vector<LensSpot> found = find_lens_spots(
      search.camera, SpecularTracer(search.shading, search.accel, settings.max_depth),
      searched_lights(scene, search.shading, lights));
  auto spots = std::make_unique<LensSpots>(std::move(found), search.camera, filter, settings.width,
                                           settings.height);
  if (spots->empty()) return nullptr;
  return spots;
}

/// Spots of a guided frame; null if it has none, or moves or has a lens.
std::unique_ptr<const LightSpots> light_spots(SpotSearch search, const LightSampler& lights,
                                              const PixelFilterSampler& filter,
                                              const contract::RenderSettings& settings,
                                              const ParallelFor& parallel_for) {
  const Scene& scene = search.shading.source;
  if (!has_second_paths(scene, settings) || search.camera.takes_lens()) return nullptr;
  search.width = settings.width;
  search.height = settings.height;
  search.max_depth = settings.max_depth;
  search.margin = settings.filter_width / 2;
  auto spots = std::make_unique<LightSpots>(
      find_spots(search, searched_lights(scene, search.shading, lights), checked(parallel_for)),
      filter, settings.width, settings.height);
  if (spots->empty()) return nullptr;
  return spots;
}

PathTracingFrame::PathTracingFrame(Scene scene, const contract::RenderSettings& settings,
                                   std::int32_t frame, const ParallelFor& parallel_for,
                                   const FrameRenderer* before, const TraceOptions& tracing)
    : scene_(std::move(scene)),
      shading_(scene_, tracing.assumed_features),
      camera_(camera_rays(scene_, settings, tracing)),
      accel_(timed_accel(scene_, parallel_for, before, with_counts(tracing, settings.aovs),
                         &timings_.accel_build_seconds)),
      lights_(scene_, shading_),
      motion_(motion_vectors(scene_, settings)),
      guide_(guide_of({scene_,
                       shading_,
                       accel_,
                       lights_,
                       settings.max_depth,
                       settings.seed,
                       frame,
                       !scene_.key_times.empty(),
                       {},
                       0},
                      camera_, settings, parallel_for)),
      filter_(settings.filter, settings.filter_width),
      spots_(light_spots({shading_, accel_, camera_}, lights_, filter_, settings, parallel_for)),
      lens_spots_(lens_spots({shading_, accel_, camera_}, lights_, filter_, settings)),
      context_{shading_,
               accel_,
               lights_,
               camera_,
               filter_,
               settings.background,
               {settings.background_color[0], settings.background_color[1],
                settings.background_color[2]},
               settings.max_depth,
               settings.cull_backfaces,
               settings.seed,
               frame,
               settings.aovs,
               !scene_.key_times.empty() || !scene_.camera.keys.empty() ||
                   shading_.assumes(kFeatureMotion),
               guide_.get(),
               spots_.get(),
               lens_spots_.get(),
               motion_.get()},
      clamp_at_(static_cast<float>(settings.clamp)),
      aovs_(settings.aovs) {
  timings_.memory_bytes = scene_bytes(scene_) + shading_.memory_bytes + accel_.memory_bytes() +
                          lights_.memory_bytes() +
                          (guide_ == nullptr ? 0 : guide_->memory_bytes()) +
                          (spots_ == nullptr ? 0 : spots_->memory_bytes()) +
                          (lens_spots_ == nullptr ? 0 : lens_spots_->memory_bytes());
}

contract::FilmBlock PathTracingFrame::render(const contract::PixelRect& rect,
                                             const contract::Pass& pass, std::int32_t pass_index,
                                             const ParallelFor& parallel_for) const {
  contract::FilmBlockShape shape;
  shape.width = rect.width;
  shape.height = rect.height;
  shape.aovs = aovs_;
  shape.first_pass = pass_index == 0;
  contract::FilmBlock block = contract::FilmBlock::zeros(shape);
  const UnitWork unit{rect, pass, contract::hilbert_curve(rect.width, rect.height), &block};
  const std::int64_t chunks = (shape.pixel_count() + kPixelsPerChunk - 1) / kPixelsPerChunk;
  std::vector<ChunkTotals> totals(static_cast<std::size_t>(chunks));
  contract::TraversalCounts cost = thread_traversal_counts();
  parallel_for(chunks, [&](std::int64_t chunk) {
    render_chunk(unit, chunk, &totals[static_cast<std::size_t>(chunk)]);
  });
  for (const ChunkTotals& t : totals) {
    block.clamped_energy += t.clamped_energy;
    block.truncated_energy += t.truncated_energy;
    block.transparency_limit_count += static_cast<std::uint64_t>(t.limit_count);
    block.dropped.insert(block.dropped.end(), t.dropped.begin(), t.dropped.end());
    cost += t.cost;
  }
  thread_traversal_counts() = cost;
  std::sort(block.dropped.begin(), block.dropped.end(), [](const auto& a, const auto& b) {
    return std::tie(a.pixel, a.replicate) < std::tie(b.pixel, b.replicate);
  });
  return block;
}

FrameRenderer::Sample PathTracingFrame::trace_sample(std::int32_t x, std::int32_t y,
                                                     std::int32_t sample,
                                                     PathObserver& observer) const {
  require_ieee_floats("before a sample");
  PathScratch scratch;
  scratch.observer = &observer;
  const PathId id{x, y, sample};
  PathResult result;
  trace_paths(context_, std::span(&id, 1), &scratch, &result);
  return {{result.radiance.x, result.radiance.y, result.radiance.z}, result.alpha};
}

void PathTracingFrame::render_chunk(const UnitWork& unit, std::int64_t chunk,
                                    ChunkTotals* totals) const {
  require_ieee_floats("before some pixels of a unit");
  const contract::TraversalCounts before = thread_traversal_counts();
  PathScratch scratch;
  const auto first = static_cast<std::size_t>(chunk * kPixelsPerChunk);
  const std::size_t pixels = std::min<std::size_t>(kPixelsPerChunk, unit.order.size() - first);
  const auto samples = static_cast<std::size_t>(unit.pass.sample_count);
  PixelSums sums;
  // Packets group samples of neighbouring pixels when each pixel has few.
  for (std::size_t begin = 0; begin < pixels * samples; begin += kPacketSize) {
    const std::size_t count = std::min<std::size_t>(kPacketSize, pixels * samples - begin);
    std::array<PathId, kPacketSize> ids;
    std::array<PathResult, kPacketSize> paths;
    for (std::size_t i = 0; i < count; ++i) {
      const contract::GridPoint at = unit.order[first + (begin + i) / samples];
      ids[i] = {unit.rect.x + at.x, unit.rect.y + at.y,
                unit.pass.first_sample + static_cast<std::int32_t>((begin + i) % samples)};
    }
    trace_paths(context_, std::span(ids).first(count), &scratch, paths.data());
    for (std::size_t i = 0; i < count; ++i) {
      const contract::GridPoint at = unit.order[first + (begin + i) / samples];
      const auto pixel =
          static_cast<std::size_t>(at.y) * static_cast<std::size_t>(unit.rect.width) +
          static_cast<std::size_t>(at.x);
      if (ids[i].sample == 0 && unit.block->shape.first_pass) {
        store_first_hit(paths[i], pixel, unit.block);
      }
      sums.add(paths[i], ids[i].sample, clamp_at_);
      if ((begin + i) % samples + 1 < samples) continue;
      store(unit, pixel, sums, totals);
      sums = PixelSums();
    }
  }
  totals->cost = thread_traversal_counts() - before;
  require_ieee_floats("after some pixels of a unit");
}

void PathTracingFrame::store(const UnitWork& unit, std::size_t pixel, const PixelSums& sums,
                             ChunkTotals* totals) const {
  sums.store(pixel, unit.block);
  totals->clamped_energy += sums.clamped_energy();
  totals->truncated_energy += sums.truncated_energy();
  totals->limit_count += sums.limit_count();
  for (int r = 0; r < contract::kReplicates; ++r) {
    if (sums.dropped(r) == 0) continue;
    totals->dropped.push_back(
        {static_cast<std::uint32_t>(pixel), static_cast<std::uint32_t>(r), sums.dropped(r)});
  }
}

/// Stores depth, position and ids of sample 0; misses stay 0.
void PathTracingFrame::store_first_hit(const PathResult& path, std::size_t pixel,
                                       contract::FilmBlock* block) const {
  const CameraHit& hit = path.hit;
  if (!hit.present) return;
  if (!block->depth.empty()) {
    const double depth =
        camera_.moves() ? camera_.at(hit.time).depth(hit.position) : camera_.depth(hit.position);
    block->depth[pixel] = static_cast<float>(depth);
  }
  if (!block->position.empty()) {
    const Vec3f p = Vec3f(Vec3d(hit.position) + scene_.center);
    block->position[3 * pixel] = p.x;
    block->position[3 * pixel + 1] = p.y;
    block->position[3 * pixel + 2] = p.z;
  }
  if (!block->motion.empty()) {
    std::copy(hit.motion.begin(), hit.motion.end(),
              block->motion.begin() + static_cast<std::ptrdiff_t>(4 * pixel));
  }
  if (!block->ids.empty()) {
    block->ids[3 * pixel] = static_cast<std::uint32_t>(hit.node) + 1;
    block->ids[3 * pixel + 1] = static_cast<std::uint32_t>(hit.material) + 1;
    block->ids[3 * pixel + 2] = static_cast<std::uint32_t>(hit.primitive) + 1;
  }
}

}  // namespace

absl::StatusOr<std::unique_ptr<FrameRenderer>> FrameRenderer::create(
    Scene scene, const contract::RenderSettings& settings, std::int32_t frame,
    const ParallelFor& parallel_for, const FrameRenderer* before, const TraceOptions& tracing) {
  if (settings.width < 1 || settings.height < 1) {
    return absl::InvalidArgumentError(
        absl::StrCat("render settings: size ", settings.width, "x", settings.height));
  }
  if (settings.max_depth < 1 || settings.max_depth > 255) {
    return absl::InvalidArgumentError(
        absl::StrCat("render settings: max depth ", settings.max_depth, " is not in [1, 255]"));
  }
  if (!(settings.filter_width > 0) || !(settings.filter_width <= 64)) {
    return absl::InvalidArgumentError(
        absl::StrCat("render settings: filter width ", settings.filter_width, " px"));
  }
  if (scene.materials.empty()) {
    return absl::InvalidArgumentError("scene: no materials; the default material is missing");
  }
  return std::make_unique<PathTracingFrame>(std::move(scene), settings, frame, parallel_for, before,
                                            tracing);
}

}  // namespace tessera::render
