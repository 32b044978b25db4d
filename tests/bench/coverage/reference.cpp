#include "tests/bench/coverage/reference.h"

#include <algorithm>
#include <cmath>

namespace tessera::bench {
namespace {

constexpr std::uint32_t kFirstReferenceSeed = 1'000'000'000;
constexpr int kReferenceSeeds = 16;

}  // namespace

absl::StatusOr<Reference> render_reference(testing::SeededRenderer& renderer,
                                           const contract::TileGrid& grid, std::int32_t spp) {
  testing::ImageMean frames;
  double squares = 0;
  for (int i = 0; i < kReferenceSeeds; ++i) {
    absl::Status status = renderer.use_seed(kFirstReferenceSeed + static_cast<std::uint32_t>(i));
    if (!status.ok()) return status;
    const Image image = testing::render_fixed(renderer, grid, spp / kReferenceSeeds, 0).image;
    frames.add(image);
    squares += testing::mean_luminance(image) * testing::mean_luminance(image) / kReferenceSeeds;
  }
  const double luminance = testing::mean_luminance(frames.mean());
  const double spread = std::max(squares - luminance * luminance, 0.0) / (kReferenceSeeds - 1);
  return Reference{frames.mean(), frames.variance(), luminance, std::sqrt(spread)};
}

double true_square(const Image& image, const Reference& reference, double m) {
  double sum = 0;
  for (std::size_t i = 0; i < image.size(); ++i) {
    const double difference = image[i] - reference.mean[i];
    sum += (difference * difference - reference.variance[i]) /
           (reference.mean[i] * reference.mean[i] + 0.01 * m * m);
  }
  return sum / static_cast<double>(image.size());
}

double scaled_variance(const Image& variance, const Reference& reference, double m) {
  double sum = 0;
  for (std::size_t i = 0; i < variance.size(); ++i) {
    sum += variance[i] / (reference.mean[i] * reference.mean[i] + 0.01 * m * m);
  }
  return sum / static_cast<double>(variance.size());
}

}  // namespace tessera::bench
