#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "worker/math/vector.h"

namespace tessera::render {

struct SurfacePoint;

/// Shading point for light sampling.
struct LightSampleContext {
  Vec3f point;
  Vec3f normal;                           // unit; on the side that receives light
  bool every_side = false;                // light may come from all sides: ignore `normal`
  float time = 0;                         // [0, 1] of the exposure
  const SurfacePoint* surface = nullptr;  // where shadow rays leave from, at `point`; null in space
};

/// Bounds of a light or a group of lights: all of it lies in the box, its brightest directions lie
/// within `normal_angle` of the axis, and it emits nothing beyond `emission_angle` of those.
struct LightBounds {
  Vec3d box_min, box_max;
  Vec3d axis{0, 0, 1};        // unit
  double normal_angle = 0;    // radians, [0, pi]
  double emission_angle = 0;  // radians, [0, pi]
  bool both_sides = false;    // emits equally towards -axis
  double strength = 0;        // radiant intensity along the axis, W/sr or any common unit
};

/// Light bounding volume hierarchy, with eight children per node. Sampling descends with
/// probabilities that follow bounds of distance, orientation and power. The tree does not depend on
/// the number of threads that built it.
///
/// Source: Conty Estevez and Kulla, "Importance sampling of many lights with adaptive tree
/// splitting", 2018 (cost and importance, without splitting).
class LightTree {
 public:
  LightTree() = default;
  /// Builds one leaf for each light of positive strength. Requires finite bounds.
  explicit LightTree(const std::vector<LightBounds>& lights);

  bool empty() const { return nodes_.empty(); }

  struct Choice {
    std::uint32_t light = 0;  // index into the list given to the constructor
    double probability = 0;   // positive
  };
  /// Chooses a light for `context`; u in [0, 1), whose bits are consumed from the top. Requires
  /// !empty().
  Choice choose(const LightSampleContext& context, double u) const;

  /// Probability with which choose() returns `light`: positive for every light of positive
  /// strength, otherwise 0.
  double probability(const LightSampleContext& context, std::uint32_t light) const;

  /// Estimate of the irradiance of all lights at `context`, in strength per m^2; 0 if empty.
  double importance(const LightSampleContext& context) const;

  std::int64_t memory_bytes() const;

 private:
  static constexpr std::size_t kWidth = 8;
  static constexpr std::uint32_t kNone = ~0u;

  using LaneArray = std::array<float, kWidth>;

  /// Position of a node or a light: slot 8 i + j is child j of node i; kNone: the root, or none.
  using Slot = std::uint32_t;

  /// Bounds of up to eight children, in SIMD lanes. Unused lanes have strength 0.
  struct alignas(32) Node {
    LaneArray centre_x{}, centre_y{}, centre_z{};
    LaneArray radius2{};  // of a sphere around the box
    LaneArray axis_x{}, axis_y{}, axis_z{};
    LaneArray cos_normal{}, sin_normal{}, cos_emission{};
    LaneArray both_sides{};                     // 1 or 0
    LaneArray strength{};                       // fraction of the total
    std::array<std::uint32_t, kWidth> child{};  // node, or light where `leaves` has the lane's bit
    std::uint32_t leaves = 0;
    std::uint32_t count = 0;
    Slot parent = kNone;
  };

  /// Cumulative weights of the children; the last is the total.
  using Weights = std::array<double, kWidth + 1>;

  class Builder;

  static void importances(const Node& node, const LightSampleContext& context, LaneArray& out);
  static Weights weights(const Node& node, const LightSampleContext& context);

  double total_ = 0;  // total strength
  std::vector<Node> nodes_;
  std::vector<Slot> leaves_;  // by light; kNone for lights without strength
};

}  // namespace tessera::render
