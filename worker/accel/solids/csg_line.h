#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "worker/accel/solids/solids.h"
#include "worker/geometry/ray.h"

namespace tessera::render {

/// A ray through the operands of a CSG solid: where it passes through each of their surfaces, and
/// from that where it passes through that of the solid. Crossings at the same t (as float) happen
/// at once, so that faces which coincide leave no gap and no film of no thickness; of such, the
/// first operand's surface is seen.
/// Source: S. Roth, "Ray casting for modeling solids", Computer Graphics and Image Processing
/// 18(2), 1982.
class CsgLine {
 public:
  void start(std::uint32_t operand_count);

  /// A crossing of a shape's surface; all of the line's are wanted. Those `behind` the start only
  /// tell where it is.
  void add_shape(std::uint32_t operand, const Hit& hit, bool enters, bool behind);

  /// All hits of the ray ahead on a closed mesh, in any order. Which of the triangles at an edge or
  /// a corner count is decided as if the ray passed beside it, for all in the same direction, so
  /// that each passage counts once.
  void add_mesh(std::uint32_t operand, const Operand& mesh, const Ray& ray, std::span<Hit> hits);

  /// Appends the hits on the solid, in order; those of surfaces seen from behind are marked
  /// (kFlippedSide).
  void finish(std::span<const CsgStep> steps, std::vector<Hit>& hits);

 private:
  struct Crossing {
    Hit hit;
    std::uint32_t operand;
    std::int32_t change;  // of the operand's winding: 1 against the outward normal, -1 along it
  };

  bool inside(std::span<const CsgStep> steps);

  std::vector<Crossing> crossings_;
  std::vector<std::int32_t> winding_;  // by operand: not 0 inside
  std::vector<std::int32_t> before_;
  std::vector<std::uint8_t> results_;
};

}  // namespace tessera::render
