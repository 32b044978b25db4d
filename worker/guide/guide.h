#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <vector>

#include "worker/accel/scene_accel.h"
#include "worker/geometry/bounds.h"
#include "worker/guide/cell_fit.h"
#include "worker/guide/direction_tree.h"
#include "worker/guide/light_image.h"
#include "worker/guide/photon.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// The distribution of directions that a guide proposes at one point.
struct GuideLobe {
  float probability = 0;  // of sampling it instead of the BSDF; 0: unset
  float tree_share = 1;   // probability of the tree, and that of each image is its own share
  float radius = 0;       // recentred.h
  Vec3f offset;           // of the point from the centre of its cell
  const DirectionNode* tree = nullptr;
  Vec3f position;  // of the point
  std::span<const LightImage> images;

  /// Unit direction for u in [0, 1)^2. `choice` in [0, 1) chooses the tree or an image.
  Vec3f sample(float choice, const Vec2f& u) const;
  /// Density of sample() over solid angle at a unit direction.
  float pdf(const Vec3f& direction) const;
};

/// Where light comes from that light sampling does not find: distributions of directions in cells
/// of space, made from photons. Immutable.
///
/// Surfaces are divided by the axis that their normal is closest to, then by a k-d tree into cells
/// with about equal numbers of photons. Each has a quadtree of directions, and images of lights
/// (light_image.h). The result depends on the order of the photons, not on the number of threads.
class Guide {
 public:
  /// Null if no cell gains from guiding.
  static std::unique_ptr<const Guide> from_photons(std::vector<Photon> photons,
                                                   const ParallelFor& parallel_for);

  /// The lobe at a point of a surface with the geometric normal `normal` on the viewer's side.
  GuideLobe at(const Vec3f& position, const Vec3f& normal) const;

  /// Relative variance of a sample at a point that following the guide there removes, an estimate.
  float saving(const Vec3f& position, const Vec3f& normal) const;

  std::int64_t memory_bytes() const;

  /// Bytes that differ if any lobe differs, for tests.
  std::vector<std::byte> fingerprint() const;

 private:
  /// Inner node: points below `plane` on `axis` are in node `below`, others in the one after it.
  /// Leaf: axis 3, and `below` is a cell. Axis 4: no cell below is guided.
  struct KdNode {
    float plane = 0;
    std::uint32_t axis = 3, below = 0;
  };
  struct Cell {
    Box3f box;
    Vec3f centre;
    float radius = 0, probability = 0, saving = 0, tree_share = 0;
    std::uint32_t tree = 0;                          // index of its root in trees_
    std::uint32_t first_image = 0, image_count = 0;  // in images_
  };
  /// A part of space, by the photons in it.
  struct Range {
    std::size_t first, last;
  };
  /// The photons of one way in a part of space, enough for an image.
  struct WayRange {
    std::uint64_t way;
    Range range;
  };
  /// A cell to be fitted, and for each way the least part around it that has enough photons.
  struct CellRange {
    Range range;
    std::map<std::uint64_t, std::size_t> ways;  // index into Parts::ways
  };
  struct Parts {
    std::vector<WayRange> ways;
    std::vector<CellRange> cells;
  };

  void divide(std::span<Photon> photons, std::size_t node, CellRange part, Parts* parts);
  void add_cell(const CellFit& fit);
  bool remove_unguided(std::size_t node);
  const Cell* find(const Vec3f& position, const Vec3f& normal) const;

  std::array<std::uint32_t, 6> roots_{};  // index of a node for each axis and sign
  std::vector<KdNode> nodes_;
  std::vector<Cell> cells_;
  std::vector<DirectionNode> trees_;
  std::vector<LightImage> images_;
};

}  // namespace tessera::render
