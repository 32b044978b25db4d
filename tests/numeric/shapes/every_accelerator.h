#pragma once

#include <algorithm>
#include <memory>
#include <vector>

#include "tests/numeric/geometry/geometry_scenes.h"
#include "worker/accelerators/structure_accelerator.h"

namespace tessera::render::testing {

/// The production BVHs and all other structures over one scene.
class EveryAccelerator {
 public:
  explicit EveryAccelerator(const Scene& scene) {
    own_.emplace_back(scene, in_order(), Isa::avx2);
    if (best_isa() == Isa::avx512) own_.emplace_back(scene, in_order(), Isa::avx512);
    for (const accelerators::Structure& structure : accelerators::structures()) {
      others_.push_back(std::make_unique<accelerators::StructureAccelerator>(scene, structure));
    }
  }

  /// Number of results that differ from the hits by brute force in any bit.
  int wrong_results(const Ray& ray, const std::vector<Hit>& expected) const {
    int wrong = 0;
    Hit hit;
    const auto check_closest = [&](bool hits) {
      if (hits == expected.empty() || (hits && !same_bits(hit, expected[0]))) ++wrong;
    };
    for (const SceneAccel& accel : own_) {
      check_closest(accel.closest_hit(ray, hit));
      if (accel.any_hit(ray) == expected.empty()) ++wrong;
    }
    for (const auto& accel : others_) {
      check_closest(accel->closest_hit(ray, nullptr, hit));
      const std::vector<Hit> all = accel->all_hits(ray);
      if (!std::equal(all.begin(), all.end(), expected.begin(), expected.end(), same_bits)) ++wrong;
    }
    return wrong;
  }

 private:
  std::vector<SceneAccel> own_;
  std::vector<std::unique_ptr<accelerators::StructureAccelerator>> others_;
};

}  // namespace tessera::render::testing
