#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "worker/accel/solids/crossing_bounds.h"
#include "worker/accel/solids/solids.h"
#include "worker/geometry/ray.h"

namespace tessera::render {

/// Intersection of a ray with a CSG solid, from the crossings of the ray with the surfaces of its
/// operands. Crossings of different operands whose error bounds overlap are applied together, so
/// that coincident faces leave neither gaps nor sheets of zero thickness; the surface of the first
/// of these operands is visible. Source: S. Roth, "Ray casting for modeling solids", Computer
/// Graphics and Image Processing 18(2), 1982.
class CsgLine {
 public:
  /// Removes all crossings and prepares for a solid with this number of operands.
  void start(std::uint32_t operand_count);

  /// Adds a crossing with a shape's surface. All crossings of the line must be added, also those
  /// `behind` the origin, because they determine whether the origin is inside.
  void add_shape(std::uint32_t operand, const Hit& hit, const CrossingBounds& bounds, bool enters,
                 bool behind);

  /// Adds all hits of the ray on a closed mesh, in any order. A ray through an edge or corner is
  /// treated as if it passed beside it, always on the same side, so that each crossing counts once.
  void add_mesh(std::uint32_t operand, const Operand& mesh, const OperandLine& line, const Ray& ray,
                std::span<Hit> hits);

  /// Sets the crossing with the flat face of an operand on which the ray starts. Faces of other
  /// operands that coincide with it are behind the origin, also if rounding has put the origin
  /// before them.
  void start_on_face(std::uint32_t operand, const CrossingBounds& bounds) {
    origin_operand_ = operand;
    origin_face_ = bounds;
  }

  /// Appends the hits on the solid, in order and with increasing t: where the distance of two hits
  /// is too small for float, the t of the second is rounded up. Surfaces seen from behind are
  /// marked with kFlippedSide.
  void finish(std::span<const CsgStep> steps, std::vector<Hit>& hits);

 private:
  struct Crossing {
    CrossingBounds bounds;
    Hit hit;
    std::uint32_t operand;
    std::int32_t winding_change;  // 1 if the ray runs against the outward normal, -1 along it
  };

  /// Moves crossings that coincide with the face on which the ray starts behind the origin.
  void pass_origin_face();
  /// Returns the index after the crossings that coincide with `first`, by index in crossings_.
  std::size_t end_of_group(std::size_t first);
  /// Returns the first operand's crossing among those that change whether their operand is entered.
  const Crossing& visible_in(std::span<const Crossing> group) const;
  /// Evaluates the CSG expression for the current winding numbers.
  bool inside(std::span<const CsgStep> steps);

  std::vector<Crossing> crossings_;
  std::uint32_t origin_operand_ = 0;
  std::optional<CrossingBounds> origin_face_;  // of origin_operand_
  std::vector<std::size_t> latest_;            // crossing by operand, in end_of_group()
  std::vector<std::int32_t> winding_;          // winding number by operand; nonzero inside
  std::vector<std::int32_t> previous_winding_;
  std::vector<std::uint8_t> stack_;  // of the evaluation in inside()
};

}  // namespace tessera::render
