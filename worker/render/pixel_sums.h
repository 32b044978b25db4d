#pragma once

#include <array>
#include <cstdint>

#include "contract/film_block.h"
#include "worker/math/vector.h"
#include "worker/render/path/path_tracer.h"

namespace tessera::render {

/// Sums of one pixel over the samples of a pass, in double, in sample order.
class PixelSums {
 public:
  /// Adds sample `sample` (its index in the whole job). `clamp_at` > 0 limits each channel.
  /// Non-finite samples are dropped and counted.
  void add(const PathResult& path, std::int32_t sample, float clamp_at);

  /// Rounds the sums into pixel `pixel` of `block`, whose arrays have been allocated.
  void store(std::size_t pixel, contract::FilmBlock* block) const;

  double clamped_energy() const { return clamped_energy_; }
  double truncated_energy() const { return truncated_energy_; }
  std::uint32_t dropped(int replicate) const {
    return dropped_[static_cast<std::size_t>(replicate)];
  }
  std::int64_t limit_count() const { return limit_count_; }

 private:
  std::array<Vec3d, contract::kReplicates> rgb_;
  std::array<std::uint32_t, contract::kReplicates> dropped_{};
  double alpha_ = 0, hits_ = 0, clamped_energy_ = 0, truncated_energy_ = 0;
  Vec3d albedo_, normal_, cost_;
  std::array<std::array<double, contract::kFeatures>, contract::kReplicates> features_{};
  std::int64_t limit_count_ = 0;
};

}  // namespace tessera::render
