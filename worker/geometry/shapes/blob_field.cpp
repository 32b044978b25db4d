#include "worker/geometry/shapes/blob_field.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace tessera::render {
namespace {

/// Box around an ellipsoid with scaled radii, padded for rounding.
Box3d box_of(const Blob& blob, double scale) {
  const Vec3d half = blob.radii * (scale * (1 + 0x1p-40));
  return {blob.centre - half, blob.centre + half};
}

bool overlap(const Box3d& a, const Box3d& b) {
  return a.lo.x <= b.hi.x && b.lo.x <= a.hi.x && a.lo.y <= b.hi.y && b.lo.y <= a.hi.y &&
         a.lo.z <= b.hi.z && b.lo.z <= a.hi.z;
}

}  // namespace

BlobField::BlobField(std::vector<Blob> blobs, double threshold)
    : blobs_(std::move(blobs)), threshold_(threshold) {
  std::vector<std::uint32_t> all(blobs_.size());
  std::iota(all.begin(), all.end(), 0u);
  build(all);
  bounds_ = surface_box();
}

void BlobField::build(std::span<std::uint32_t> blobs) {
  const std::size_t index = nodes_.size();
  Node node;
  Box3d centres;
  for (const std::uint32_t i : blobs) {
    node.box.extend(box_of(blobs_[i], 1));
    centres.extend(blobs_[i].centre);
  }
  if (blobs.size() == 1) node.blob = blobs[0];
  nodes_.push_back(node);
  if (blobs.size() > 1) {
    const Vec3d size = centres.hi - centres.lo;
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    // A total order, so that the tree does not depend on the standard library's sort.
    std::sort(blobs.begin(), blobs.end(), [&](std::uint32_t a, std::uint32_t b) {
      return std::pair(blobs_[a].centre[axis], a) < std::pair(blobs_[b].centre[axis], b);
    });
    build(blobs.first(blobs.size() / 2));
    build(blobs.subspan(blobs.size() / 2));
  }
  nodes_[index].skip = static_cast<std::uint32_t>(nodes_.size());
}

/// At a point where the field reaches the threshold T, let S be the sum of the strengths of the
/// positive blobs there. One of these has (1 - r^2)^2 >= T / S, or else the field would be below T.
/// All of them meet its box, so S is at most the sum over all positive blobs that do.
Box3d BlobField::surface_box() const {
  Box3d out;
  for (const Blob& blob : blobs_) {
    if (!(blob.strength > 0)) continue;
    const Box3d box = box_of(blob, 1);
    double strengths = 0;
    each([&](const Box3d& other) { return overlap(box, other); },
         [&](const Blob& other) { strengths += std::max(other.strength, 0.0); });
    const double least = std::sqrt(threshold_ / strengths);
    if (least < 1) out.extend(box_of(blob, std::sqrt(1 - least)));
  }
  return out.empty() ? nodes_[0].box : out;
}

Vec3d BlobField::outward_gradient(const Vec3d& point) const {
  Vec3d sum;
  each([&](const Box3d& box) { return box.contains(point); },
       [&](const Blob& blob) {
         const Vec3d p = (point - blob.centre) / blob.radii;
         const double left = 1 - dot(p, p);
         if (left > 0) sum += p / blob.radii * (4 * blob.strength * left);
       });
  return sum;
}

}  // namespace tessera::render
