#include "worker/render/pixel_sums.h"

#include <cmath>
#include <limits>

namespace tessera::render {
namespace {

float limited(float value, float limit, double* removed) {
  if (!(value > limit)) return value;
  *removed += static_cast<double>(value) - limit;
  return limit;
}

/// Rounds once; sums beyond the range of float become its maximum, so that the film has no
/// infinity.
float rounded(double sum) {
  constexpr double kLargest = std::numeric_limits<float>::max();
  return static_cast<float>(clamp(sum, -kLargest, kLargest));
}

void store_vector(const Vec3d& sum, std::size_t pixel, std::vector<float>* plane) {
  (*plane)[3 * pixel] = rounded(sum.x);
  (*plane)[3 * pixel + 1] = rounded(sum.y);
  (*plane)[3 * pixel + 2] = rounded(sum.z);
}

}  // namespace

void PixelSums::add(const PathResult& path, std::int32_t sample, float clamp_at) {
  const auto replicate = static_cast<std::size_t>(sample % contract::kReplicates);
  limit_count_ += path.limit_count;
  cost_ += {static_cast<double>(path.cost.rays), static_cast<double>(path.cost.nodes),
            static_cast<double>(path.cost.primitives)};
  const CameraHit& hit = path.hit;
  if (!is_finite(path.radiance) || !is_finite(hit.albedo) || !is_finite(hit.normal) ||
      !std::isfinite(hit.depth)) {
    ++dropped_[replicate];
    return;
  }
  if (is_finite(path.truncated)) {
    truncated_energy_ +=
        Vec3d(path.truncated).x + Vec3d(path.truncated).y + Vec3d(path.truncated).z;
  }
  Vec3f c = path.radiance;
  if (clamp_at > 0) {
    c.x = limited(c.x, clamp_at, &clamped_energy_);
    c.y = limited(c.y, clamp_at, &clamped_energy_);
    c.z = limited(c.z, clamp_at, &clamped_energy_);
  }
  rgb_[replicate] += Vec3d(c);
  alpha_ += path.alpha;
  if (!hit.present) return;
  hits_ += 1;
  albedo_ += Vec3d(hit.albedo);
  normal_ += Vec3d(hit.normal);
  const float values[contract::kFeatures] = {hit.albedo.x, hit.albedo.y, hit.albedo.z, hit.normal.x,
                                             hit.normal.y, hit.normal.z, hit.depth,    1};
  for (std::size_t k = 0; k < contract::kFeatures; ++k) features_[replicate][k] += values[k];
}

void PixelSums::store(std::size_t pixel, contract::FilmBlock* block) const {
  for (std::size_t r = 0; r < contract::kReplicates; ++r) {
    store_vector(rgb_[r], contract::kReplicates * pixel + r, &block->rgb);
  }
  block->alpha[pixel] = static_cast<float>(alpha_);
  if (!block->albedo.empty()) store_vector(albedo_, pixel, &block->albedo);
  if (!block->normal.empty()) store_vector(normal_, pixel, &block->normal);
  if (!block->traversal_cost.empty()) store_vector(cost_, pixel, &block->traversal_cost);
  if (!block->features.empty()) {
    float* to = &block->features[contract::kReplicates * contract::kFeatures * pixel];
    for (const auto& replicate : features_) {
      for (const double sum : replicate) *to++ = rounded(sum);
    }
  }
  if (!block->hits.empty()) block->hits[pixel] = static_cast<float>(hits_);
}

}  // namespace tessera::render
