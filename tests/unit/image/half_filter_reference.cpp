#include "tests/unit/image/half_filter_reference.h"

#include <cmath>
#include <functional>
#include <initializer_list>

#include "image/denoise/filter/filter_parameters.h"

namespace tessera::image {
namespace {

using P = FilterParameters;
constexpr std::size_t kTerms = kHalfFeatures + 1;

/// Reads planes at (x, y).
class Pixels {
 public:
  explicit Pixels(const Half& half) : half_(half) {}

  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(half_.width) +
           static_cast<std::size_t>(x);
  }
  float box(const Plane& plane, int x, int y, int radius) const {
    float sum = 0;
    for (int dy = -radius; dy <= radius; ++dy) {
      for (int dx = -radius; dx <= radius; ++dx) sum += plane[index(x + dx, y + dy)];
    }
    return sum * (1.0f / static_cast<float>((2 * radius + 1) * (2 * radius + 1)));
  }
  /// Calls visit(x, y) for all pixels at least `inset` from the border.
  void for_each(int inset, const std::function<void(int, int)>& visit) const {
    for (int y = inset; y < half_.height - inset; ++y) {
      for (int x = inset; x < half_.width - inset; ++x) visit(x, y);
    }
  }

 private:
  const Half& half_;
};

/// A colour image, its noise and how distances are weighed.
struct Weighing {
  ColourPlanes colour;
  Plane noise;
  float per_noise = 0, per_square = 0;

  float tolerance(std::size_t i) const {
    const float square =
        (colour[0][i] * colour[0][i] + colour[1][i] * colour[1][i]) + colour[2][i] * colour[2][i];
    return (per_noise * noise[i] + per_square * square) + P::kMinSquare;
  }
  float ratio(std::size_t p, std::size_t q) const {
    const float difference[3] = {colour[0][p] - colour[0][q], colour[1][p] - colour[1][q],
                                 colour[2][p] - colour[2][q]};
    const float square = square_of(difference[0], difference[1], difference[2]);
    const float ratio =
        (square - (noise[p] + std::fmin(noise[p], noise[q]))) / (tolerance(p) + tolerance(q));
    const float darker = std::fmin(square_of(colour[0][p], colour[1][p], colour[2][p]),
                                   square_of(colour[0][q], colour[1][q], colour[2][q]));
    return square <= P::kMaxContrast * darker && !(ratio < P::kMaxRatio) ? P::kMaxRatio : ratio;
  }
  static float square_of(float r, float g, float b) { return (r * r + g * g) + b * b; }
};

float patch_distance(const Pixels& pixels, const Weighing& guide, int x, int y, int dx, int dy) {
  const auto row = [&](int v) {
    const auto ratio = [&](int u) {
      return guide.ratio(pixels.index(u, v), pixels.index(u + dx, v + dy));
    };
    return (ratio(x - 1) + ratio(x)) + ratio(x + 1);
  };
  const float mean = ((row(y - 1) + row(y)) + row(y + 1)) * (1.0f / 9);
  return mean > 0 ? mean : 0;
}

float feature_distance(const Half& half, std::size_t p, std::size_t q) {
  const auto squares = [&](std::initializer_list<std::size_t> features) {
    float sum = 0;
    for (const std::size_t k : features) {
      const float d = half.features[k][p] - half.features[k][q];
      sum = std::fma(d, d, sum);
    }
    return sum;
  };
  const float depth = squares({6}) * half.depth_weight[p];
  const float normal = std::fma(squares({3, 4, 5}), half.normal_weight[p], depth);
  return std::fma(squares({0, 1, 2, 7}), half.albedo_weight[p], normal);
}

const Plane& stream(const StreamPair& pair, std::size_t k) {
  return k < 3 ? pair.a[k] : pair.b[k - 3];
}

void set(StreamPair& pair, std::size_t k, std::size_t i, float value) {
  Plane& plane = k < 3 ? pair.a[k] : pair.b[k - 3];
  plane[i] = value;
}

void zero_order(const Half& half, const Pixels& pixels, const Weighing& guide, int x, int y,
                StreamPair& out) {
  constexpr int kRadius = P::kWindowRadius;
  const std::size_t p = pixels.index(x, y);
  float total = 0, sums[6] = {};
  for (int dy = -kRadius; dy <= kRadius; ++dy) {
    for (int dx = -kRadius; dx <= kRadius; ++dx) {
      const std::size_t q = pixels.index(x + dx, y + dy);
      const float in_frame = p == q ? 1 : half.valid[q];
      const float weight = filter_weight(patch_distance(pixels, guide, x, y, dx, dy) +
                                         feature_distance(half, p, q)) *
                           in_frame;
      total += weight;
      for (std::size_t k = 0; k < 6; ++k)
        sums[k] = std::fma(weight, stream(half.streams, k)[q], sums[k]);
    }
  }
  for (std::size_t k = 0; k < 6; ++k) set(out, k, p, sums[k] / total);
}

/// Solves M v = e0 for a symmetric matrix, in place, by Cholesky's decomposition.
void solve(float (&m)[kTerms][kTerms], float (&v)[kTerms]) {
  const float total = m[0][0];
  for (std::size_t a = 1; a < kTerms; ++a) m[a][a] += P::kRidge * total;
  for (std::size_t a = 0; a < kTerms; ++a) {
    for (std::size_t b = 0; b <= a; ++b) {
      for (std::size_t k = 0; k < b; ++k) m[a][b] -= m[a][k] * m[b][k];
      if (b < a) m[a][b] /= m[b][b];
    }
    const float least = P::kMinPivot * total;
    m[a][a] = std::sqrt(m[a][a] > least ? m[a][a] : least);
  }
  for (std::size_t a = 0; a < kTerms; ++a) {
    v[a] = a == 0 ? 1.0f : 0.0f;
    for (std::size_t b = 0; b < a; ++b) v[a] -= m[a][b] * v[b];
    v[a] /= m[a][a];
  }
  for (std::size_t a = kTerms; a-- > 0;) {
    for (std::size_t b = a + 1; b < kTerms; ++b) v[a] -= m[b][a] * v[b];
    v[a] /= m[a][a];
  }
}

void first_order(const Half& half, const Pixels& pixels, const Weighing& guide, int x, int y,
                 StreamPair& out) {
  constexpr int kRadius = P::kRegressionRadius;
  const std::size_t p = pixels.index(x, y);
  const float depth = half.features[6][p], depth_scale = depth > 0 ? P::kDepthScale / depth : 0;
  struct Neighbour {
    std::size_t q;
    float weight, terms[kTerms];
  };
  std::vector<Neighbour> neighbours;
  float matrix[kTerms][kTerms] = {}, solution[kTerms] = {};
  for (int dy = -kRadius; dy <= kRadius; ++dy) {
    for (int dx = -kRadius; dx <= kRadius; ++dx) {
      const std::size_t q = pixels.index(x + dx, y + dy);
      Neighbour n{q, filter_weight(patch_distance(pixels, guide, x, y, dx, dy)), {1}};
      n.weight *= p == q ? 1 : half.valid[q];
      for (std::size_t k = 0; k < kHalfFeatures; ++k) {
        const float scale = k == 6            ? depth_scale
                            : k >= 3 && k < 6 ? P::kNormalScale
                                              : P::kAlbedoScale;
        n.terms[k + 1] = (half.features[k][q] - half.features[k][p]) * scale;
      }
      for (std::size_t a = 0; a < kTerms; ++a) {
        for (std::size_t b = 0; b <= a; ++b) {
          matrix[a][b] = std::fma(n.weight * n.terms[a], n.terms[b], matrix[a][b]);
        }
      }
      neighbours.push_back(n);
    }
  }
  solve(matrix, solution);
  float sums[6] = {};
  for (const Neighbour& n : neighbours) {
    float factor = solution[0];
    for (std::size_t a = 1; a < kTerms; ++a) factor = std::fma(solution[a], n.terms[a], factor);
    factor *= n.weight;
    for (std::size_t k = 0; k < 6; ++k)
      sums[k] = std::fma(factor, stream(half.streams, k)[n.q], sums[k]);
  }
  for (std::size_t k = 0; k < 6; ++k) set(out, k, p, sums[k]);
}

/// The mean of both streams and its variance, averaged over a box.
Weighing weighing_of(const Pixels& pixels, const StreamPair& pair, int radius, int inset) {
  Weighing guide;
  Plane variance(pair.a[0].size(), 0.0f);
  for (std::size_t c = 0; c < 3; ++c) {
    guide.colour[c].resize(variance.size());
    for (std::size_t i = 0; i < variance.size(); ++i) {
      const float difference = 0.5f * (pair.a[c][i] - pair.b[c][i]);
      guide.colour[c][i] = 0.5f * (pair.a[c][i] + pair.b[c][i]);
      variance[i] += difference * difference;
    }
  }
  guide.noise.resize(variance.size());
  pixels.for_each(inset, [&](int x, int y) {
    guide.noise[pixels.index(x, y)] = pixels.box(variance, x, y, radius);
  });
  return guide;
}

}  // namespace

FilteredHalf reference_filter_half(const Half& half) {
  const Pixels pixels(half);
  Weighing raw = weighing_of(pixels, half.streams, 1, 1);
  raw.per_noise = P::kGuideNoise;
  raw.per_square = P::kGuideTolerance;
  StreamPair smooth = half.streams;
  pixels.for_each(7, [&](int x, int y) { zero_order(half, pixels, raw, x, y, smooth); });
  Weighing guide = weighing_of(pixels, smooth, 2, 9);
  guide.per_noise = P::kFilterNoise;
  guide.per_square = P::kFilterTolerance;
  FilteredHalf result{guide.colour, {half.streams, half.streams}};
  pixels.for_each(2 * kHalfMargin, [&](int x, int y) {
    zero_order(half, pixels, guide, x, y, result.candidates.zero_order);
    first_order(half, pixels, guide, x, y, result.candidates.first_order);
  });
  return result;
}

}  // namespace tessera::image
