#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace tessera::image {

/// Σ over pixels and channels of an estimated squared error ÷ (d² + 0.01 m²), and the estimated
/// variance of this sum, at least what it is for dependent halves.
struct ErrorEstimate {
  double scaled = 0, spread = 0;

  void add(const ErrorEstimate& other) {
    scaled += other.scaled;
    spread += other.spread;
  }
};

/// Sums over the pixels of a region. They estimate the part of its squared error that is common to
/// all of its pixels: with errors e, Σe² over N pixels is at least (Σe)² ÷ N.
///
/// The error of a filter that drops rare bright samples is hardly visible in single pixels, because
/// few pixels are hit in both streams that measure it. Many pixels together are hit in both.
struct RegionSums {
  /// All values are divided by √(d² + 0.01 m²) of their pixel.
  struct Channel {
    std::array<double, 2> first{}, second{};  // Σ(d₁ − y) of streams 2, 3; Σ(d₂ − y) of 0, 1
    double between = 0;                       // Σ(d₁ − d₂)
    /// Estimated variance of each of the sums `first`, and of each of the sums `second`.
    double first_noise = 0, second_noise = 0;
  };
  std::array<Channel, 3> channels;
  std::int64_t pixels = 0;

  void add(const RegionSums& other);
  /// 0 for a region without pixels.
  ErrorEstimate estimate() const;
};

/// Sides of the square regions: 4, 8, … pixels. Regions are aligned to the frame's top left.
constexpr std::size_t kRegionSides = 5;
constexpr std::size_t kLeastRegionSide = 4;

/// The regions of a part of a frame that begins at multiples of the largest side.
class RegionGrid {
 public:
  RegionGrid(std::size_t width, std::size_t height);

  /// The smallest region that contains a pixel of the part.
  RegionSums& at(std::size_t x, std::size_t y) {
    return regions_[y / kLeastRegionSide * columns_ + x / kLeastRegionSide];
  }
  /// Adds the estimates of the regions of each size to `estimates`, and the sums of the whole part
  /// to `whole`. Call it once: it joins the regions.
  void add_to(std::array<ErrorEstimate, kRegionSides>& estimates, RegionSums& whole);

 private:
  void double_side();

  std::size_t columns_, rows_;
  std::vector<RegionSums> regions_;
};

}  // namespace tessera::image
