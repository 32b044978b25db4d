#include "worker/geometry/shapes/blobs/blob_cells.h"

#include <bit>
#include <cmath>
#include <tuple>
#include <utility>

namespace tessera::render {
namespace {

/// Cells with fewer partial blobs are not halved: more cells would cost more than they save.
constexpr std::size_t kEnough = 32;
/// Memory for cells. Of 10,000 blobs that all overlap, a cell then has about 1,000 partial ones.
constexpr std::size_t kBytesPerBlob = 4096;

struct SquaredRadii {
  BlobLanes least, greatest;
};

/// r^2 over a box, where r is 1 at the surface of each blob.
SquaredRadii radii_over(const FourBlobs& blobs, const BlobVectors& centre,
                        const BlobVectors& half) {
  const BlobVectors d = centre - blobs.centre;
  const BlobVectors apart = {larger(d.x, -d.x), larger(d.y, -d.y), larger(d.z, -d.z)};
  const BlobVectors gap = apart - half, far = (apart + half) * blobs.scale;
  const BlobLanes none = spread(0);
  const BlobVectors near =
      BlobVectors{larger(gap.x, none), larger(gap.y, none), larger(gap.z, none)} * blobs.scale;
  return {dot(near, near), dot(far, far)};
}

}  // namespace

struct BlobCells::Builder {
  /// A part of the tree that may still be halved.
  struct Part {
    std::uint32_t node;
    std::size_t depth;
    Box3d box;
    BlobCell cell;

    std::size_t bytes() const {
      return sizeof(Part) + cell.partial_count * sizeof(cell.partial[0]);
    }
    /// Orders parts by the number of partial blobs; a total order.
    bool operator<(const Part& other) const {
      return std::tuple(cell.partial_count, other.node) <
             std::tuple(other.cell.partial_count, node);
    }
  };

  std::span<const Blob> blobs;
  double threshold;
  BlobCells& tree;
  std::vector<Part> parts;  // a heap
  std::size_t bytes = 0;    // of the parts

  void build();
  void sort_blobs(BlobCell& cell) const;
  void settle(Part part);
  bool split(Part& part);
};

/// Sorts a cell's partial blobs into those that contain it, those that miss it and the others.
void BlobCells::Builder::sort_blobs(BlobCell& cell) const {
  const BlobVectors centre = spread(cell.centre), half = spread(cell.half);
  const BlobLanes one = spread(1), none = spread(0);
  BlobLanes low = none, high = none;
  BlobIndex* to = cell.partial.data();
  for (std::size_t i = 0; i < cell.partial_count; i += 4) {
    const BlobIndex* from = &cell.partial[i];
    const FourBlobs four = tree.four(from);
    const auto [least, greatest] = radii_over(four, centre, half);
    const BlobLanes around = at_least(one, greatest);
    const BlobLanes others = without(around, above(one, least));
    const BlobLanes most = only(others, four.strength * ((one - least) * (one - least)));
    low += smaller(most, none);
    high += larger(most, none);
    for (std::uint32_t left = bits(around); left != 0; left &= left - 1) {
      const BlobIndex whole = from[std::countr_zero(left)];
      if (whole == tree.no_blob()) continue;
      cell.whole.add(tree.units_[whole], cell.centre, cell.half);
      cell.has_whole = true;
    }
    to = copy_chosen(from, bits(others), to);
  }
  cell.partial_range = {total(low), total(high)};
  cell.set_partial_count(static_cast<std::size_t>(to - cell.partial.data()), tree.no_blob());
}

/// Sorts the blobs around a part, and keeps the part if the surface may pass through it.
void BlobCells::Builder::settle(Part part) {
  BlobCell& cell = part.cell;
  cell.centre = (part.box.lo + part.box.hi) * 0.5;
  cell.half = (part.box.hi - part.box.lo) * 0.5;
  sort_blobs(cell);
  const FieldRange range = cell.whole.range();
  if (range.high + cell.partial_range.high < threshold) {
    tree.nodes_[part.node].next = kOutside;
  } else if (range.low + cell.partial_range.low > threshold) {
    tree.nodes_[part.node].next = kInside;
  } else {
    cell.partial.shrink_to_fit();
    bytes += part.bytes();
    parts.push_back(std::move(part));
    std::push_heap(parts.begin(), parts.end());
  }
}

/// Halves a part along its longest axis. Returns false if no number lies between its ends.
bool BlobCells::Builder::split(Part& part) {
  const Vec3d size = part.cell.half;
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  const double plane = part.cell.centre[axis];
  if (!(part.box.lo[axis] < plane && plane < part.box.hi[axis])) return false;
  const auto next = static_cast<std::uint32_t>(tree.nodes_.size());
  tree.nodes_[part.node] = {plane, next, axis};
  tree.nodes_.resize(next + 2);
  for (const bool upper : {false, true}) {
    Part child = {next + (upper ? 1u : 0u), part.depth + 1, part.box, part.cell};
    (upper ? child.box.lo : child.box.hi)[axis] = plane;
    child.cell.whole.take_half(axis, upper);
    settle(std::move(child));
  }
  return true;
}

void BlobCells::Builder::build() {
  Part root{};
  for (std::uint32_t i = 0; i < blobs.size(); ++i) {
    root.box.extend(blobs[i].box(1));
    root.cell.partial.push_back(static_cast<BlobIndex>(i));
    const Blob& blob = blobs[i];
    tree.units_.push_back({blob.centre, Vec3d{1, 1, 1} / blob.radii, blob.strength});
  }
  tree.units_.emplace_back();
  root.cell.set_partial_count(blobs.size(), tree.no_blob());
  tree.box_ = root.box;
  tree.nodes_.resize(1);
  settle(std::move(root));
  std::vector<Part> leaves;
  while (!parts.empty()) {
    std::pop_heap(parts.begin(), parts.end());
    Part part = std::move(parts.back());
    parts.pop_back();
    const bool may_split = part.cell.partial_count > kEnough && part.depth < kMaxDepth &&
                           bytes < kBytesPerBlob * blobs.size();
    if (may_split) bytes -= part.bytes();
    if (!may_split || !split(part)) leaves.push_back(std::move(part));
  }
  tree.cells_.reserve(leaves.size());
  for (Part& leaf : leaves) {
    tree.nodes_[leaf.node].next = static_cast<std::uint32_t>(tree.cells_.size());
    tree.cells_.push_back(std::move(leaf.cell));
  }
}

BlobCells::BlobCells(std::span<const Blob> blobs, double threshold) {
  if (blobs.size() > kFew) Builder{blobs, threshold, *this, {}}.build();
}

/// The argument of BlobField's surface_box(), in each cell by itself: in a cell without whole
/// blobs, only the partial ones count.
Box3d BlobCells::surface_box(std::span<const Blob> blobs, double threshold) const {
  Box3d out;
  for (const BlobCell& cell : cells_) {
    const Box3d box = {cell.centre - cell.half * (1 + 0x1p-40),
                       cell.centre + cell.half * (1 + 0x1p-40)};
    if (cell.has_whole) {
      out.extend(box);
      continue;
    }
    double strengths = 0;
    const std::span<const BlobIndex> partial(cell.partial.data(), cell.partial_count);
    for (const BlobIndex i : partial) strengths += std::max(blobs[i].strength, 0.0);
    for (const BlobIndex i : partial) {
      if (!(blobs[i].strength > 0)) continue;
      const Box3d reach = blobs[i].box_above(threshold / strengths);
      const Box3d both = {max(box.lo, reach.lo), min(box.hi, reach.hi)};
      if (!both.empty()) out.extend(both);
    }
  }
  return out;
}

const BlobCell* BlobCells::find(const Vec3d& point) const {
  if (!box_.contains(point)) return nullptr;
  const Node* node = nodes_.data();
  while (node->axis != kLeaf) {
    node = &nodes_[node->next + (point[node->axis] < node->plane ? 0 : 1)];
  }
  return node->next < cells_.size() ? &cells_[node->next] : nullptr;
}

}  // namespace tessera::render
