#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "worker/math/vector.h"

namespace tessera::render {

/// Where light is wanted: a point, and the side it is wanted from.
struct LightSampleContext {
  Vec3f point;
  Vec3f normal;             // unit; on the side that receives
  bool every_side = false;  // the surface also lets light through: `normal` tells nothing
  float time = 0;           // [0, 1] of the shutter's
};

/// What a light, or a group of lights, can give at most: all of it lies in the box, its brightest
/// directions lie within `normal_angle` of the axis, and it gives nothing beyond `emission_angle`
/// of those.
struct LightBounds {
  Vec3d box_min, box_max;
  Vec3d axis{0, 0, 1};        // unit
  double normal_angle = 0;    // radians, [0, pi]
  double emission_angle = 0;  // radians, [0, pi]
  bool both_sides = false;    // as much towards -axis
  double strength = 0;        // radiant intensity along the axis, W/sr or any one unit
};

/// A tree over lights that have a place: descends by chance towards those that matter at a point,
/// by bounds of distance, orientation and power. Eight children a node, weighed side by side.
///
/// Source: Conty Estevez and Kulla, "Importance sampling of many lights with adaptive tree
/// splitting", 2018 (cost and importance; no splitting). The same tree whatever built it.
class LightTree {
 public:
  LightTree() = default;
  /// One leaf for each light of positive strength. Requires finite bounds.
  explicit LightTree(const std::vector<LightBounds>& lights);

  bool empty() const { return nodes_.empty(); }

  struct Choice {
    std::uint32_t light = 0;  // index into the constructor's list
    double probability = 0;   // positive
  };
  /// Which light to sample for `receiver`; u in [0, 1), whose bits are used up from the top.
  /// Requires !empty().
  Choice choose(const LightSampleContext& receiver, double u) const;

  /// Probability with which choose() takes `light`: positive for every light of positive strength,
  /// 0 for others.
  double probability(const LightSampleContext& receiver, std::uint32_t light) const;

  /// About the irradiance of all lights at `receiver`, in strength per m^2; 0 if empty.
  double importance(const LightSampleContext& receiver) const;

  std::int64_t memory_bytes() const;

 private:
  static constexpr std::size_t kWidth = 8;
  static constexpr std::uint32_t kNone = ~0u;

  using LaneArray = std::array<float, kWidth>;

  /// Where a node or a light hangs: node 8 i + j is child j of node i; kNone: the root, or nothing.
  using Place = std::uint32_t;

  /// Bounds of up to eight children, as importances() reads them. Unused lanes have strength 0.
  struct alignas(32) Node {
    LaneArray centre_x{}, centre_y{}, centre_z{};
    LaneArray radius2{};  // of a sphere about the box
    LaneArray axis_x{}, axis_y{}, axis_z{};
    LaneArray cos_normal{}, sin_normal{}, cos_emission{};
    LaneArray both_sides{};                     // 1 or 0
    LaneArray strength{};                       // share of the whole
    std::array<std::uint32_t, kWidth> child{};  // node, or light where `leaves` has the lane's bit
    std::uint32_t leaves = 0;
    std::uint32_t count = 0;
    Place parent = kNone;
  };

  /// Running sums of the children's weights; the last is the total.
  using Weights = std::array<double, kWidth + 1>;

  class Builder;

  static void importances(const Node& node, const LightSampleContext& receiver, LaneArray& out);
  static Weights weights(const Node& node, const LightSampleContext& receiver);

  double total_ = 0;  // strength of all
  std::vector<Node> nodes_;
  std::vector<Place> leaves_;  // by light; kNone for lights without strength
};

}  // namespace tessera::render
