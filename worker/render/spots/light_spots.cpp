#include "worker/render/spots/light_spots.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "worker/math/elementary.h"

namespace tessera::render {
namespace {

constexpr float kPi = 3.14159274f;
/// Two thirds of the samples are uniform in the ellipse, the others beyond it with a density that
/// falls with the sixth power of the distance.
constexpr float kInside = 2.0f / 3;
/// Spots of a pixel, at most: those of the greatest weight.
constexpr std::size_t kMaxShares = 16;

/// Distance from the centre, relative to the ellipse.
float distance_for(float u) {
  if (u < kInside) return std::sqrt(u / kInside);
  // Beyond q the share is q^-4 / 3.
  const float q2 = 1 / std::sqrt((1 - u) / (1 - kInside));
  return std::sqrt(q2);
}

/// Weight of a spot for a pixel: the light that it adds, more than that where the filter is low.
double weight(const LightSpot& spot, const PixelFilterSampler& filter, double x, double y) {
  const float peak = filter.density({0, 0});
  const float here =
      filter.density({static_cast<float>(spot.x - x), static_cast<float>(spot.y - y)});
  return double{spot.brightness} * spot.area() * double{std::max(here, peak * 1e-3f)};
}

}  // namespace

double LightSpots::Pixel::density_of(const LightSpot& spot, const Vec2f& offset) const {
  if (all_->is_wide(spot)) return double{all_->filter_.density(offset)};
  const double qx = (double{offset.x} + x_ - spot.x) / spot.a;
  const double qy = (double{offset.y} + y_ - spot.y - spot.b * qx) / spot.c;
  const double q2 = qx * qx + qy * qy;
  const double inside = double{kInside} / spot.area();
  return q2 < 1 ? inside : inside / (q2 * q2 * q2);
}

LightSpots::Pixel::Density LightSpots::Pixel::density(const Vec2f& offset,
                                                      std::uint64_t lobes) const {
  Density density;
  for (const Share& share : shares_) {
    const LightSpot& spot = all_->spots_[share.spot];
    if (spot.lobes != lobes) continue;
    const double here = double{share.probability} * density_of(spot, offset);
    density.sampled += here;
    density.weighed += here / double{spot.probability};
  }
  return density;
}

Vec2f LightSpots::Pixel::sample_in(const LightSpot& spot, const Vec2f& u) const {
  if (all_->is_wide(spot)) return all_->filter_.sample(u);
  const float q = distance_for(u.x);
  const elementary::SinCosf angle = elementary::sincos(2 * kPi * u.y);
  const double qx{q * angle.cos}, qy{q * angle.sin};
  return {static_cast<float>(spot.x - x_ + spot.a * qx),
          static_cast<float>(spot.y - y_ + spot.b * qx + spot.c * qy)};
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
  const LightSpot& spot = all_->spots_[share->spot];
  Second second;
  second.offset = sample_in(spot, u);
  second.lobes = spot.lobes;
  const double usual{all_->filter_.density(second.offset)};
  const Density there = density(second.offset, spot.lobes);
  if (!(there.sampled > 0)) return second;
  second.weight =
      static_cast<float>(usual * (there.weighed / (usual + there.weighed)) / there.sampled);
  return second;
}

LightSpots::LightSpots(std::vector<LightSpot> spots, const PixelFilterSampler& filter,
                       std::int32_t width, std::int32_t height)
    : filter_(filter), width_(width), spots_(std::move(spots)) {
  const double half = double{filter.width()} / 2;
  struct Entry {
    std::size_t pixel;
    std::uint32_t spot;
    double weight;
  };
  std::vector<Entry> entries;
  for (std::size_t i = 0; i < spots_.size(); ++i) {
    const LightSpot& spot = spots_[i];
    const double wide = half + spot.a, high = half + std::sqrt(spot.b * spot.b + spot.c * spot.c);
    const auto first = [](double low, std::int32_t end) {
      return static_cast<std::int32_t>(clamp(std::ceil(low - 0.5), 0.0, static_cast<double>(end)));
    };
    const std::int32_t left = first(spot.x - wide, width), right = first(spot.x + wide, width);
    const std::int32_t top = first(spot.y - high, height), bottom = first(spot.y + high, height);
    for (std::int32_t y = top; y < bottom; ++y) {
      for (std::int32_t x = left; x < right; ++x) {
        const auto pixel = static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                           static_cast<std::size_t>(x);
        entries.push_back(
            {pixel, static_cast<std::uint32_t>(i), weight(spot, filter, x + 0.5, y + 0.5)});
      }
    }
  }
  std::stable_sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
    return a.pixel != b.pixel ? a.pixel < b.pixel : a.weight > b.weight;
  });
  first_.assign(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) + 1, 0);
  for (std::size_t i = 0; i < entries.size();) {
    std::size_t end = i, used = 0;
    double sum = 0;
    for (; end < entries.size() && entries[end].pixel == entries[i].pixel; ++end) {
      if (used == kMaxShares) continue;
      sum += entries[end].weight;
      ++used;
    }
    for (std::size_t k = i; k < i + used; ++k)
      shares_.push_back({entries[k].spot, static_cast<float>(entries[k].weight / sum)});
    first_[entries[i].pixel + 1] = static_cast<std::uint32_t>(used);
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
  result.x_ = x + 0.5;
  result.y_ = y + 0.5;
  return result;
}

std::int64_t LightSpots::memory_bytes() const {
  return static_cast<std::int64_t>(spots_.size() * sizeof(LightSpot) +
                                   first_.size() * sizeof(std::uint32_t) +
                                   shares_.size() * sizeof(Share));
}

}  // namespace tessera::render
