#include "worker/render/spots/light_spots.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

namespace tessera::render {
namespace {

/// A spot matters to a pixel if the chance that a sample of the pixel finds it is at most this.
constexpr double kMaxChance = 0.25;
/// Where a spot covers more than this part of a filter, all of the filter is sampled. Spots with
/// more than this area, in areas of the filter, do not matter there: their light is not much
/// brighter than the picture.
constexpr double kMost = 0.75, kMaxArea = 256;
/// Parts of spots with less area count as none, square pixels.
constexpr double kMinArea = 1e-7;
/// Spots of a pixel, at most: those of the greatest weight.
constexpr std::size_t kMaxShares = 16;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// The interval of x in which a convex polygon has all points with low <= y <= high; empty (first >
/// second) if there are none.
std::pair<double, double> covered_between(std::span<const Vec2d> polygon, double low, double high) {
  std::pair<double, double> covered{-kInfinity, kInfinity};
  for (const double y : {low, high}) {
    double first = kInfinity, last = -kInfinity;
    for (std::size_t i = 0; i < polygon.size(); ++i) {
      const Vec2d &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
      if ((a.y < y) == (b.y < y)) continue;
      const double x = a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x);
      first = std::min(first, x);
      last = std::max(last, x);
    }
    covered = {std::max(covered.first, first), std::min(covered.second, last)};
  }
  return covered;
}

}  // namespace

AroundPolygon LightSpots::Pixel::around(const Share& share) const {
  return {std::span(all_->outlines_).subspan(share.first, share.count), share.centre, share.area};
}

LightSpots::Pixel::Density LightSpots::Pixel::density(const Vec2f& offset,
                                                      std::uint64_t lobes) const {
  Density density;
  for (const Share& share : shares_) {
    const LightSpot& spot = all_->spots_[share.spot];
    if (spot.lobes != lobes) continue;
    const double density_here =
        share.count == 0 ? double{all_->filter_.density(offset)} : around(share).density(offset);
    const double here = double{share.probability} * density_here;
    density.sampled += here;
    density.weighed += here / double{spot.probability};
  }
  return density;
}

float LightSpots::Pixel::weight(const Vec2f& offset, std::uint64_t lobes) const {
  const double usual{all_->filter_.density(offset)};
  if (!(usual > 0)) return 1;  // rounded to the end of the support, where sample() finds nothing
  return static_cast<float>(usual / (usual + density(offset, lobes).weighed));
}

LightSpots::Pixel::Second LightSpots::Pixel::sample(float choice, const Vec2f& u) const {
  const Share* share = shares_.data();
  for (; share != &shares_.back() && choice >= share->probability; ++share)
    choice -= share->probability;
  Second second;
  second.offset = share->count == 0 ? all_->filter_.sample(u) : around(*share).sample(u);
  second.lobes = all_->spots_[share->spot].lobes;
  const double usual{all_->filter_.density(second.offset)};
  const Density there = density(second.offset, second.lobes);
  if (!(there.sampled > 0)) return second;
  second.weight =
      static_cast<float>(usual * (there.weighed / (usual + there.weighed)) / there.sampled);
  return second;
}

void LightSpots::add_candidate(std::uint32_t spot, std::int32_t x, std::int32_t y,
                               std::vector<Candidate>* found) {
  const LightSpot& all = spots_[spot];
  std::vector<Vec2d> outline;
  for (const Vec2d& v : all.outline) outline.push_back({v.x - (x + 0.5), v.y - (y + 0.5)});
  const double half = double{filter_.width()} / 2;
  outline = part_in_square(outline, -half, half);
  const double area = area_of(outline);
  if (!(area > kMinArea)) return;
  const Vec2d centre = centre_of(outline);
  const double density{
      filter_.density({static_cast<float>(centre.x), static_cast<float>(centre.y)})};
  const double part = std::min(area * density, 1.0);
  const double weight = double{all.brightness} * part;
  if (!(weight > 0) || part * double{all.probability} > kMaxChance) return;
  Share share{spot, 0, static_cast<std::uint32_t>(outlines_.size()), 0, {}, 0};
  if (part > kMost) {
    if (all.area() > kMaxArea * filter_.area()) return;
  } else {
    share.count = static_cast<std::uint32_t>(outline.size());
    share.centre = centre;
    share.area = area;
    outlines_.insert(outlines_.end(), outline.begin(), outline.end());
  }
  const auto pixel =
      static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x);
  found->push_back({pixel, share, weight});
}

void LightSpots::add_candidates(std::uint32_t spot, std::int32_t height,
                                std::vector<Candidate>* found) {
  Vec2d low{kInfinity, kInfinity}, high{-kInfinity, -kInfinity};
  for (const Vec2d& v : spots_[spot].outline) {
    low = {std::min(low.x, v.x), std::min(low.y, v.y)};
    high = {std::max(high.x, v.x), std::max(high.y, v.y)};
  }
  const double half = double{filter_.width()} / 2;
  // The pixels whose filter reaches from `low` to `high`.
  const auto first = [&](double at, std::int32_t end) {
    return static_cast<std::int32_t>(
        clamp(std::ceil(at - half - 0.5), 0.0, static_cast<double>(end)));
  };
  const auto last = [&](double at, std::int32_t end) {
    return static_cast<std::int32_t>(
        clamp(std::floor(at + half - 0.5) + 1, 0.0, static_cast<double>(end)));
  };
  const LightSpot& all = spots_[spot];
  const bool counts_where_covered =
      double{all.probability} <= kMaxChance && all.area() <= kMaxArea * filter_.area();
  for (std::int32_t y = first(low.y, height); y < last(high.y, height); ++y) {
    const auto covered = covered_between(all.outline, y + 0.5 - half, y + 0.5 + half);
    for (std::int32_t x = first(low.x, width_); x < last(high.x, width_); ++x) {
      const bool is_covered = covered.first <= x + 0.5 - half && x + 0.5 + half <= covered.second;
      if (!is_covered || counts_where_covered) add_candidate(spot, x, y, found);
    }
  }
}

LightSpots::LightSpots(std::vector<LightSpot> spots, const PixelFilterSampler& filter,
                       std::int32_t width, std::int32_t height)
    : filter_(filter), width_(width), spots_(std::move(spots)) {
  std::vector<Candidate> found;
  for (std::size_t i = 0; i < spots_.size(); ++i)
    add_candidates(static_cast<std::uint32_t>(i), height, &found);
  std::stable_sort(found.begin(), found.end(), [](const Candidate& a, const Candidate& b) {
    return a.pixel != b.pixel ? a.pixel < b.pixel : a.weight > b.weight;
  });
  first_.assign(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) + 1, 0);
  for (std::size_t i = 0; i < found.size();) {
    std::size_t end = i, used = 0;
    double sum = 0;
    for (; end < found.size() && found[end].pixel == found[i].pixel; ++end) {
      if (used == kMaxShares) continue;
      sum += found[end].weight;
      ++used;
    }
    for (std::size_t k = i; k < i + used; ++k) {
      shares_.push_back(found[k].share);
      shares_.back().probability = static_cast<float>(found[k].weight / sum);
    }
    first_[found[i].pixel + 1] = static_cast<std::uint32_t>(used);
    i = end;
  }
  for (std::size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
}

LightSpots::Pixel LightSpots::at(std::int32_t x, std::int32_t y) const {
  const auto pixel =
      static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x);
  Pixel result;
  result.shares_ = std::span(shares_).subspan(first_[pixel], first_[pixel + 1] - first_[pixel]);
  result.all_ = this;
  return result;
}

std::int64_t LightSpots::memory_bytes() const {
  std::size_t vertices = outlines_.size();
  for (const LightSpot& spot : spots_) vertices += spot.outline.size();
  return static_cast<std::int64_t>(spots_.size() * sizeof(LightSpot) +
                                   first_.size() * sizeof(std::uint32_t) +
                                   shares_.size() * sizeof(Share) + vertices * sizeof(Vec2d));
}

}  // namespace tessera::render
