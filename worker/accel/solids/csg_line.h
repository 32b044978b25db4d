#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "worker/accel/solids/solids.h"
#include "worker/geometry/ray.h"

namespace tessera::render {

/// Intersection of a ray with a CSG solid, from the crossings of the ray with the surfaces of its
/// operands. Crossings with equal t (as float) are applied together, so that coincident faces leave
/// neither gaps nor sheets of zero thickness; the surface of the first of these operands is
/// visible. Source: S. Roth, "Ray casting for modeling solids", Computer Graphics and Image
/// Processing 18(2), 1982.
class CsgLine {
 public:
  /// Removes all crossings and prepares for a solid with this number of operands.
  void start(std::uint32_t operand_count);

  /// Adds a crossing with a shape's surface. All crossings of the line must be added, also those
  /// `behind` the origin, because they determine whether the origin is inside.
  void add_shape(std::uint32_t operand, const Hit& hit, bool enters, bool behind);

  /// Adds all hits of the ray on a closed mesh, in any order. A ray through an edge or corner is
  /// treated as if it passed beside it, always on the same side, so that each crossing counts once.
  void add_mesh(std::uint32_t operand, const Operand& mesh, const Ray& ray, std::span<Hit> hits);

  /// Appends the hits on the solid, in order. Surfaces seen from behind are marked with
  /// kFlippedSide.
  void finish(std::span<const CsgStep> steps, std::vector<Hit>& hits);

 private:
  struct Crossing {
    Hit hit;
    std::uint32_t operand;
    std::int32_t winding_change;  // 1 if the ray runs against the outward normal, -1 along it
  };

  /// Evaluates the CSG expression for the current winding numbers.
  bool inside(std::span<const CsgStep> steps);

  std::vector<Crossing> crossings_;
  std::vector<std::int32_t> winding_;  // winding number by operand; nonzero inside
  std::vector<std::int32_t> previous_winding_;
  std::vector<std::uint8_t> stack_;  // of the evaluation in inside()
};

}  // namespace tessera::render
