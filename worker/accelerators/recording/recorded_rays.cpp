#include "worker/accelerators/recording/recorded_rays.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "worker/render/frame_renderer.h"
#include "worker/sampling/hash.h"

namespace tessera::render {
namespace {

/// Lights are distinguished if their distance exceeds this fraction of the scene's size.
constexpr double kLightShare = 1.0 / 32;
constexpr std::int32_t kPixelsAcross = 128;
constexpr std::int32_t kDepth = 3;

std::uint64_t cell_of(const Vec3f& p, float scale) {
  std::uint64_t cell = 0;
  for (int k = 0; k < 3; ++k) {
    const float x = clamp(std::floor(p[k] * scale), -1e6f, 1e6f);
    cell = cell * 2097152 + static_cast<std::uint64_t>(static_cast<std::int64_t>(x) + 1048576);
  }
  return cell;
}

/// Answers as SceneAccel does and records all queries. Not thread-safe.
class RayRecorder final : public Accelerator {
 public:
  /// `rays` must outlive the recorder.
  RayRecorder(const Scene& scene, RecordedRays* rays);

  bool closest_hit(const Ray& ray, const HitFilter* filter, Hit& hit) const override;
  bool any_hit(const Ray& ray, const HitFilter* filter) const override;
  std::size_t memory_bytes() const override;

 private:
  std::uint32_t light_of(const Ray& ray) const;

  SceneAccel accel_;
  float light_scale_;  // two lights closer than its inverse count as one
  RecordedRays* rays_;
  mutable std::uint32_t depth_ = 0;
};

RayRecorder::RayRecorder(const Scene& scene, RecordedRays* rays)
    : accel_(scene, sequential()), rays_(rays) {
  const double size = max_abs(scene.bounds_max - scene.bounds_min);
  light_scale_ = size > 0 ? static_cast<float>(1 / (kLightShare * size)) : 1;
}

std::uint32_t RayRecorder::light_of(const Ray& ray) const {
  const bool ends = ray.t_max < std::numeric_limits<float>::max();
  const std::uint64_t cell = ends ? cell_of(ray.origin + ray.direction * ray.t_max, light_scale_)
                                  : ~cell_of(normalize(ray.direction), 4);
  return static_cast<std::uint32_t>(combine(cell, 0));
}

bool RayRecorder::closest_hit(const Ray& ray, const HitFilter* filter, Hit& hit) const {
  const bool camera = ray.origin_triangle == TriangleId{};  // all other rays leave a surface
  depth_ = camera ? 0 : depth_ + 1;
  (camera ? rays_->camera : rays_->bounces).push_back(ray);
  const bool found =
      filter == nullptr ? accel_.closest_hit(ray, hit) : accel_.closest_hit(ray, hit, *filter);
  Ray& visible = rays_->visible.emplace_back(ray);
  if (found) visible.t_max = hit.t;
  return found;
}

bool RayRecorder::any_hit(const Ray& ray, const HitFilter* filter) const {
  rays_->shadows.push_back({ray, depth_, light_of(ray)});
  return filter == nullptr ? accel_.any_hit(ray) : accel_.any_hit(ray, *filter);
}

std::size_t RayRecorder::memory_bytes() const {
  return static_cast<std::size_t>(accel_.memory_bytes());
}

}  // namespace

absl::StatusOr<RecordedRays> record_rays(const Scene& scene, contract::RenderSettings settings) {
  settings.height = std::max(1, kPixelsAcross * settings.height / settings.width);
  settings.height = std::min(settings.height, kPixelsAcross);
  settings.width = kPixelsAcross;
  settings.max_depth = kDepth;
  settings.aovs = 0;
  settings.guiding = false;  // no rays of photons
  RecordedRays rays;
  const TraceOptions recording(best_isa(), [&rays](const Scene& of) {
    return std::make_unique<const RayRecorder>(of, &rays);
  });
  const auto frame = FrameRenderer::create(scene, settings, 0, sequential(), nullptr, recording);
  if (!frame.ok()) return frame.status();
  (*frame)->render({0, 0, settings.width, settings.height}, contract::Pass{0, 1}, 0, sequential());
  return rays;
}

}  // namespace tessera::render
