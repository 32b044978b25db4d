#include "worker/guide/guide.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

#include "worker/geometry/object_ray.h"
#include "worker/guide/octahedral.h"
#include "worker/guide/recentred.h"
#include "worker/guide/visible_region.h"

namespace tessera::render {
namespace {

/// Cells with more photons are divided. Measured: docs/notes/guiding.md.
constexpr std::size_t kMaxPhotons = 1024;
/// Photons of one way that an image is fitted to, at least.
constexpr std::size_t kMinWayPhotons = 16;
constexpr std::uint32_t kLeaf = 3, kUnguided = 4;  // axes of nodes that are not divided

int longest_axis(std::span<const Photon> photons) {
  Box3f box;
  for (const Photon& photon : photons) box.extend(photon.position);
  return largest_axis(box.hi - box.lo);
}

/// A total order, so that the photons of a cell have the same order everywhere.
bool is_before(const Photon& a, const Photon& b) {
  for (int k = 0; k < 3; ++k) {
    if (a.position[k] != b.position[k]) return a.position[k] < b.position[k];
  }
  for (int k = 0; k < 3; ++k) {
    if (a.direction[k] != b.direction[k]) return a.direction[k] < b.direction[k];
  }
  return a.flux != b.flux ? a.flux < b.flux : a.path < b.path;
}

struct Division {
  float plane;
  std::size_t below;  // number of photons
};

/// Moves the photons below a plane across the axis to the front. About half are below it; all if
/// they have the same coordinate along the axis.
Division divide_across(int axis, std::span<Photon> photons) {
  const auto middle = photons.begin() + static_cast<std::ptrdiff_t>(photons.size() / 2);
  const auto along = [axis](const Photon& a, const Photon& b) {
    return a.position[axis] < b.position[axis];
  };
  std::nth_element(photons.begin(), middle, photons.end(), along);
  float plane = middle->position[axis];
  // Many photons may lie in the plane, on a wall for instance: all of them belong above it.
  const auto is_below = [&](const Photon& photon) { return photon.position[axis] < plane; };
  if (std::none_of(photons.begin(), middle, is_below)) {
    plane = INFINITY;
    for (const Photon& photon : photons) {
      const float x = photon.position[axis];
      if (x > middle->position[axis] && x < plane) plane = x;
    }
  }
  const auto above = std::partition(photons.begin(), photons.end(), is_below);
  return {plane, static_cast<std::size_t>(above - photons.begin())};
}

/// The ways with enough photons in a part of space, but too few in one of the parts that it is
/// divided into: the first `below` photons and the others.
std::vector<std::uint64_t> ways_to_fit(std::span<const Photon> photons, std::size_t below) {
  std::map<std::uint64_t, std::array<std::size_t, 2>> counts;
  for (std::size_t i = 0; i < photons.size(); ++i) {
    if (photons[i].way != 0) ++counts[photons[i].way][i < below ? 0 : 1];
  }
  std::vector<std::uint64_t> ways;
  for (const auto& [way, count] : counts) {
    const std::size_t all = count[0] + count[1];
    if (all >= kMinWayPhotons && std::min(count[0], count[1]) < kMinWayPhotons) ways.push_back(way);
  }
  return ways;
}

/// The image that the photons of a way come from, among all photons of a part of space.
WayImage image_of(std::uint64_t way, std::span<const Photon> photons) {
  WayImage image;
  std::vector<Photon> of_way;
  double flux = 0, all = 0;
  for (const Photon& photon : photons) {
    all += double{photon.flux};
    if (photon.way != way) continue;
    flux += double{photon.flux};
    of_way.push_back(photon);
  }
  image.share = static_cast<float>(flux / all);
  if (const auto fit = fit_light_image(of_way)) image.fit = *fit;
  return image;
}

void for_each_index(const ParallelFor& parallel_for, std::size_t count,
                    const std::function<void(std::size_t)>& body) {
  parallel_for(static_cast<std::int64_t>(count),
               [&](std::int64_t i) { body(static_cast<std::size_t>(i)); });
}

template <typename T>
void append_bytes(const T& value, std::vector<std::byte>* bytes) {
  const auto* data = reinterpret_cast<const std::byte*>(&value);
  bytes->insert(bytes->end(), data, data + sizeof(T));
}

}  // namespace

Vec3f GuideLobe::sample(float choice, const Vec2f& u) const {
  float below = tree_share;
  for (const LightImage& image : images) {
    if (choice < below) break;
    below += image.share;
    // Rounded shares may end a little below 1.
    if (choice < below || &image == &images.back()) return image.sample(position, u);
  }
  const Vec2f point = sample_direction_tree(tree, u);
  return direction_from(offset, octahedral::direction_of_square(point), radius);
}

float GuideLobe::pdf(const Vec3f& direction) const {
  float density = 0;
  for (const LightImage& image : images) density += image.share * image.pdf(position, direction);
  if (!(tree_share > 0)) return density;
  const Recentred seen = recentred(offset, direction, radius);
  return density +
         tree_share * (direction_tree_density(tree, octahedral::square_of(seen.direction)) *
                       octahedral::density(seen.direction) * seen.scale);
}

void Guide::divide(std::span<Photon> photons, std::size_t node, CellRange part, Parts* parts) {
  const Range range = part.range;
  const std::size_t count = range.last - range.first;
  const std::span<Photon> all = photons.subspan(range.first, count);
  const int axis = longest_axis(all);
  const Division division = count > kMaxPhotons ? divide_across(axis, all) : Division{0, count};
  for (const std::uint64_t way : ways_to_fit(all, division.below)) {
    part.ways[way] = parts->ways.size();
    parts->ways.push_back({way, range});
  }
  if (division.below == count) {
    nodes_[node] = {0, kLeaf, static_cast<std::uint32_t>(parts->cells.size())};
    parts->cells.push_back(std::move(part));
    return;
  }
  const std::size_t middle = range.first + division.below;
  const std::size_t below = nodes_.size();
  nodes_[node] = {division.plane, static_cast<std::uint32_t>(axis),
                  static_cast<std::uint32_t>(below)};
  nodes_.resize(below + 2);
  divide(photons, below, {{range.first, middle}, part.ways}, parts);
  divide(photons, below + 1, {{middle, range.last}, std::move(part.ways)}, parts);
}

std::unique_ptr<const Guide> Guide::from_photons(std::vector<Photon> photons,
                                                 const ParallelFor& parallel_for) {
  auto guide = std::make_unique<Guide>();
  std::stable_sort(photons.begin(), photons.end(), [](const Photon& a, const Photon& b) {
    return facing(a.normal) < facing(b.normal);
  });
  Parts parts;
  guide->nodes_.resize(guide->roots_.size());
  std::size_t first = 0;
  for (std::size_t side = 0; side < guide->roots_.size(); ++side) {
    std::size_t last = first;
    while (last < photons.size() && facing(photons[last].normal) == side) ++last;
    guide->roots_[side] = static_cast<std::uint32_t>(side);
    guide->divide(photons, side, {{first, last}, {}}, &parts);
    first = last;
  }
  const auto photons_in = [&](const Range& range) {
    return std::span(photons).subspan(range.first, range.last - range.first);
  };
  for_each_index(parallel_for, parts.cells.size(), [&](std::size_t i) {
    const std::span<Photon> cell = photons_in(parts.cells[i].range);
    std::sort(cell.begin(), cell.end(), is_before);
  });
  std::vector<WayImage> images(parts.ways.size());
  for_each_index(parallel_for, images.size(), [&](std::size_t i) {
    images[i] = image_of(parts.ways[i].way, photons_in(parts.ways[i].range));
  });
  std::vector<CellFit> fits(parts.cells.size());
  for_each_index(parallel_for, fits.size(), [&](std::size_t i) {
    std::vector<WayImage> seen;
    for (const auto& [way, index] : parts.cells[i].ways) seen.push_back(images[index]);
    fits[i] = fit_cell(photons_in(parts.cells[i].range), seen);
  });
  for (const CellFit& fit : fits) guide->add_cell(fit);
  if (guide->trees_.empty() && guide->images_.empty()) return nullptr;
  for (const std::uint32_t root : guide->roots_) guide->remove_unguided(root);
  return guide;
}

void Guide::add_cell(const CellFit& fit) {
  cells_.push_back({fit.box, fit.centre, fit.radius, fit.probability, fit.saving, fit.tree_share,
                    static_cast<std::uint32_t>(trees_.size()),
                    static_cast<std::uint32_t>(images_.size()),
                    static_cast<std::uint32_t>(fit.images.size())});
  trees_.insert(trees_.end(), fit.tree.begin(), fit.tree.end());
  images_.insert(images_.end(), fit.images.begin(), fit.images.end());
}

/// Ends the tree where no cell is guided, so that at() is fast there. Returns whether one is.
bool Guide::remove_unguided(std::size_t node) {
  const KdNode here = nodes_[node];
  const bool guided = here.axis == kLeaf
                          ? cells_[here.below].probability > 0
                          : static_cast<int>(remove_unguided(here.below)) +
                                    static_cast<int>(remove_unguided(here.below + 1)) >
                                0;
  if (!guided) nodes_[node] = {0, kUnguided, 0};
  return guided;
}

/// The guided cell at a point; null if there is none.
const Guide::Cell* Guide::find(const Vec3f& position, const Vec3f& normal) const {
  const KdNode* node = &nodes_[roots_[facing(normal)]];
  while (node->axis < kLeaf) {
    const bool above = !(position[static_cast<int>(node->axis)] < node->plane);
    node = &nodes_[node->below + (above ? 1u : 0u)];
  }
  if (node->axis == kUnguided) return nullptr;
  const Cell& cell = cells_[node->below];
  return cell.box.contains(position) ? &cell : nullptr;
}

GuideLobe Guide::at(const Vec3f& position, const Vec3f& normal) const {
  const Cell* cell = find(position, normal);
  if (cell == nullptr) return {};
  return {cell->probability,
          cell->tree_share,
          cell->radius,
          position - cell->centre,
          trees_.data() + cell->tree,
          position,
          std::span(images_).subspan(cell->first_image, cell->image_count)};
}

float Guide::saving(const Vec3f& position, const Vec3f& normal) const {
  const Cell* cell = find(position, normal);
  return cell == nullptr ? 0 : cell->saving;
}

std::int64_t Guide::memory_bytes() const {
  return static_cast<std::int64_t>(nodes_.size() * sizeof(KdNode) + cells_.size() * sizeof(Cell) +
                                   trees_.size() * sizeof(DirectionNode) +
                                   images_.size() * sizeof(LightImage));
}

std::vector<std::byte> Guide::fingerprint() const {
  std::vector<std::byte> bytes;
  for (const KdNode& node : nodes_) append_bytes(node, &bytes);
  for (const Cell& cell : cells_) append_bytes(cell, &bytes);
  for (const DirectionNode& node : trees_) append_bytes(node, &bytes);
  for (const LightImage& image : images_) append_bytes(image, &bytes);
  return bytes;
}

}  // namespace tessera::render
