#include "image/denoise/half_filter.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "image/denoise/filter_parameters.h"

namespace tessera::image {
namespace {

using P = FilterParameters;
constexpr std::size_t kLanes = 8;
constexpr std::size_t kTerms = kHalfFeatures + 1;          // of the regression: 1 and the features
constexpr std::size_t kPairs = kTerms * (kTerms + 1) / 2;  // of the normal matrix, row by row
constexpr std::size_t kSides = 6;                          // right-hand sides: two streams of RGB
constexpr std::int32_t kGuideInset = 7, kNoiseInset = 9;
constexpr int kPatch = 1;

/// kLanes neighbouring pixels of a row. GCC does not make vectors of loops this short.
using Lanes = float __attribute__((vector_size(kLanes * sizeof(float))));

Lanes load_lanes(const float* from) {
  Lanes lanes;
  std::memcpy(&lanes, from, sizeof lanes);
  return lanes;
}

std::size_t size_of(std::int32_t value) {
  return static_cast<std::size_t>(value);
}

/// What distances are measured on: colours, their noise, and the tolerance of each pixel.
struct Guidance {
  std::array<const float*, 3> colour{};
  const float* noise = nullptr;
  Plane tolerance;
};

Guidance guidance(const ColourPlanes& colour, const Plane& noise, float per_noise,
                  float per_square) {
  Guidance guide;
  for (std::size_t c = 0; c < 3; ++c) guide.colour[c] = colour[c].data();
  guide.noise = noise.data();
  guide.tolerance.resize(noise.size());
  for (std::size_t i = 0; i < noise.size(); ++i) {
    const float square =
        (colour[0][i] * colour[0][i] + colour[1][i] * colour[1][i]) + colour[2][i] * colour[2][i];
    guide.tolerance[i] = (per_noise * noise[i] + per_square * square) + P::kMinSquare;
  }
  return guide;
}

/// Adds up (2 radius + 1)² neighbours, row by row, and divides by their number. Defined `radius`
/// further in than `in`.
Plane box_mean(const Plane& in, std::int32_t width, std::int32_t height, std::int32_t radius,
               std::int32_t inset) {
  Plane out(in.size());
  const float scale = 1.0f / static_cast<float>((2 * radius + 1) * (2 * radius + 1));
  const std::size_t begin = size_of(inset), end = size_of(width - inset);
  for (std::int32_t y = inset; y < height - inset; ++y) {
    float* to = &out[size_of(y) * size_of(width)];
    for (std::int32_t dy = -radius; dy <= radius; ++dy) {
      for (std::int32_t dx = -radius; dx <= radius; ++dx) {
        const float* from = &in[size_of(y + dy) * size_of(width)] + dx;
        for (std::size_t x = begin; x < end; ++x) to[x] += from[x];
      }
    }
    for (std::size_t x = begin; x < end; ++x) to[x] *= scale;
  }
  return out;
}

/// Filters the rows of a half with windows of one radius.
class WindowFilter {
 public:
  WindowFilter(const Half& half, const Guidance& guide, int radius, std::int32_t inset)
      : half_(half),
        guide_(guide),
        radius_(radius),
        begin_(size_of(inset)),
        count_(size_of(half.width - 2 * inset)),
        side_(size_of(2 * radius + 1)),
        patches_(3 * side_ * side_ * count_),
        ratio_(count_ + 2),
        sums_(7 * count_),
        features_(count_),
        ones_(count_, 1.0f) {}

  /// Zero-order filter of rows [inset, height - inset); with `first_order`, the regression too.
  void run(StreamPair& zero_order, StreamPair* first_order) {
    const auto inset = static_cast<std::int32_t>(begin_);
    weights_.resize((first_order != nullptr ? side_ * side_ : 1) * count_);
    for (std::int32_t y = inset - kPatch; y < half_.height - inset + kPatch; ++y) {
      add_patches(y);
      if (y >= inset + kPatch) filter_row(y - kPatch, zero_order, first_order);
    }
  }

 private:
  /// Sums of three ratios beside each other for each offset: a row of the 3x3 patches.
  float* patch(std::int32_t y, std::size_t offset) {
    return &patches_[(size_of(y) % 3 * side_ * side_ + offset) * count_];
  }

  void add_patches(std::int32_t y) {
    std::size_t offset = 0;
    for (int dy = -radius_; dy <= radius_; ++dy) {
      for (int dx = -radius_; dx <= radius_; ++dx, ++offset) {
        add_patch(row(y) - 1, row(y + dy) - 1 + dx, patch(y, offset));
      }
    }
  }

  /// Index of the first filtered pixel of a row.
  std::ptrdiff_t row(std::int32_t y) const {
    return static_cast<std::ptrdiff_t>(size_of(y) * size_of(half_.width) + begin_);
  }

  /// Squared difference of colours beyond what noise explains, relative to the tolerance.
  void add_patch(std::ptrdiff_t p, std::ptrdiff_t q, float* sums) {
    const float *p0 = guide_.colour[0] + p, *p1 = guide_.colour[1] + p, *p2 = guide_.colour[2] + p;
    const float *q0 = guide_.colour[0] + q, *q1 = guide_.colour[1] + q, *q2 = guide_.colour[2] + q;
    const float *noise_p = guide_.noise + p, *noise_q = guide_.noise + q;
    const float *tolerance_p = guide_.tolerance.data() + p,
                *tolerance_q = guide_.tolerance.data() + q;
    float* ratio = ratio_.data();
    for (std::size_t x = 0; x < count_ + 2; ++x) {
      const float d0 = p0[x] - q0[x], d1 = p1[x] - q1[x], d2 = p2[x] - q2[x];
      const float noise = noise_p[x] + (noise_p[x] < noise_q[x] ? noise_p[x] : noise_q[x]);
      ratio[x] = (((d0 * d0 + d1 * d1) + d2 * d2) - noise) / (tolerance_p[x] + tolerance_q[x]);
    }
    for (std::size_t x = 0; x < count_; ++x) sums[x] = (ratio[x] + ratio[x + 1]) + ratio[x + 2];
  }

  /// Squared difference of the features, relative to the tolerance of the pixel at p.
  void compare_features(std::ptrdiff_t p, std::ptrdiff_t q) {
    float* out = features_.data();
    const auto square = [&](std::size_t k, std::size_t x) {
      const float* plane = half_.features[k].data();
      const float d =
          plane[p + static_cast<std::ptrdiff_t>(x)] - plane[q + static_cast<std::ptrdiff_t>(x)];
      return d * d;
    };
    const float *albedo = half_.albedo_weight.data() + p, *normal = half_.normal_weight.data() + p,
                *depth = half_.depth_weight.data() + p;
    for (std::size_t x = 0; x < count_; ++x) {
      out[x] = ((square(0, x) + square(1, x)) + (square(2, x) + square(7, x))) * albedo[x];
    }
    for (std::size_t x = 0; x < count_; ++x) {
      out[x] += ((square(3, x) + square(4, x)) + square(5, x)) * normal[x];
    }
    for (std::size_t x = 0; x < count_; ++x) out[x] += square(6, x) * depth[x];
  }

  void filter_row(std::int32_t y, StreamPair& zero_order, StreamPair* first_order) {
    std::fill(sums_.begin(), sums_.end(), 0.0f);
    std::size_t offset = 0;
    for (int dy = -radius_; dy <= radius_; ++dy) {
      for (int dx = -radius_; dx <= radius_; ++dx, ++offset)
        add_offset(y, dx, dy, offset, first_order != nullptr);
    }
    const float* weight = sums_.data();
    for (std::size_t k = 0; k < kSides; ++k) {
      Plane& plane = k < 3 ? zero_order.a[k] : zero_order.b[k - 3];
      float* to = plane.data() + row(y);
      const float* sum = &sums_[(k + 1) * count_];
      for (std::size_t x = 0; x < count_; ++x) to[x] = sum[x] / weight[x];
    }
    if (first_order == nullptr) return;
    for (std::size_t x = 0; x < count_; x += kLanes) regress(y, x, *first_order);
  }

  /// Adds the neighbours at (dx, dy) of a row. The pixel itself has weight 1.
  void add_offset(std::int32_t y, int dx, int dy, std::size_t offset, bool keeps) {
    const std::ptrdiff_t p = row(y), q = row(y + dy) + dx;
    compare_features(p, q);
    const float *above = patch(y - 1, offset), *here = patch(y, offset),
                *below = patch(y + 1, offset);
    const bool centre = dx == 0 && dy == 0;
    const float* in_frame = centre ? ones_.data() : half_.valid.data() + q;
    float *features = features_.data(), *total = sums_.data();
    float* kept = &weights_[keeps ? offset * count_ : 0];
    for (std::size_t x = 0; x < count_; ++x) {
      const float colour = positive_part(((above[x] + here[x]) + below[x]) * (1.0f / 9));
      kept[x] = filter_weight(colour) * in_frame[x];
      features[x] = filter_weight(colour + features[x]) * in_frame[x];
    }
    for (std::size_t x = 0; x < count_; ++x) total[x] += features[x];
    for (std::size_t k = 0; k < kSides; ++k) {
      const float* from = stream(k) + q;
      float* sum = &sums_[(k + 1) * count_];
      for (std::size_t x = 0; x < count_; ++x) sum[x] += features[x] * from[x];
    }
  }

  const float* stream(std::size_t k) const {
    return (k < 3 ? half_.streams.a[k] : half_.streams.b[k - 3]).data();
  }

  /// Normal matrix of kLanes pixels, and the solution for the constant term.
  struct Equations {
    Lanes matrix[kPairs] = {}, solution[kTerms] = {};

    Lanes& at(std::size_t a, std::size_t b) { return matrix[a * (a + 1) / 2 + b]; }
  };

  /// Calls visit(q, weights) for the neighbours at even distance from the corner of the window:
  /// half of them are enough, at half the time.
  template <typename Visit>
  void for_each_neighbour(std::ptrdiff_t p, std::size_t x, const Visit& visit) const {
    constexpr int kRadius = P::kRegressionRadius;
    for (int dy = -kRadius; dy <= kRadius; ++dy) {
      const int odd = (dy + kRadius) % 2 != 0 ? 1 : 0;
      for (int dx = -kRadius + odd; dx <= kRadius; dx += 2) {
        const std::size_t offset = size_of(dy + radius_) * side_ + size_of(dx + radius_);
        visit(p + dy * std::ptrdiff_t{half_.width} + dx,
              load_lanes(&weights_[offset * count_ + x]));
      }
    }
  }

  /// The regression's value at a pixel is linear in the neighbours' colours: their factors are
  /// weight · solution · terms.
  void regress(std::int32_t y, std::size_t x, StreamPair& out) const {
    Equations equations;
    const std::ptrdiff_t p = row(y) + static_cast<std::ptrdiff_t>(x);
    const Lanes depth = load_lanes(half_.features[6].data() + p);
    const Lanes depth_scale = depth > 0 ? P::kDepthScale / depth : 0 * depth;
    for_each_neighbour(p, x, [&](std::ptrdiff_t q, Lanes weight) {
      add_equation(p, q, weight, depth_scale, equations);
    });
    solve(equations);
    Lanes sums[kSides] = {};
    for_each_neighbour(p, x, [&](std::ptrdiff_t q, Lanes weight) {
      Lanes terms[kTerms];
      find_terms(p, q, depth_scale, terms);
      Lanes factor = equations.solution[0];
      for (std::size_t a = 1; a < kTerms; ++a) factor += equations.solution[a] * terms[a];
      factor *= weight;
      for (std::size_t k = 0; k < kSides; ++k) sums[k] += factor * load_lanes(stream(k) + q);
    });
    for (std::size_t k = 0; k < kSides; ++k) {
      std::memcpy((k < 3 ? out.a[k] : out.b[k - 3]).data() + p, &sums[k], sizeof sums[k]);
    }
  }

  /// The scaled differences of the features; terms[0], which is 1, is left out.
  void find_terms(std::ptrdiff_t p, std::ptrdiff_t q, Lanes depth_scale,
                  Lanes (&terms)[kTerms]) const {
    for (std::size_t k = 0; k < kHalfFeatures; ++k) {
      const float* plane = half_.features[k].data();
      const Lanes difference = load_lanes(plane + q) - load_lanes(plane + p);
      terms[k + 1] = k == 6 ? difference * depth_scale
                            : difference * (k >= 3 && k < 6 ? P::kNormalScale : P::kAlbedoScale);
    }
  }

  void add_equation(std::ptrdiff_t p, std::ptrdiff_t q, Lanes weight, Lanes depth_scale,
                    Equations& equations) const {
    Lanes terms[kTerms];
    find_terms(p, q, depth_scale, terms);
    equations.matrix[0] += weight;
    std::size_t pair = 1;
    for (std::size_t a = 1; a < kTerms; ++a) {
      const Lanes weighted = weight * terms[a];
      equations.matrix[pair++] += weighted;
      for (std::size_t b = 1; b <= a; ++b) equations.matrix[pair++] += weighted * terms[b];
    }
  }

  /// Solves for the unit vector of the constant term by Cholesky's decomposition, with a ridge.
  static void solve(Equations& equations) {
    const Lanes total = equations.at(0, 0), least = P::kMinPivot * total;
    for (std::size_t a = 1; a < kTerms; ++a) equations.at(a, a) += P::kRidge * total;
    for (std::size_t a = 0; a < kTerms; ++a) {
      for (std::size_t b = 0; b <= a; ++b) {
        Lanes& entry = equations.at(a, b);
        for (std::size_t k = 0; k < b; ++k) entry -= equations.at(a, k) * equations.at(b, k);
        if (b < a) {
          entry /= equations.at(b, b);
          continue;
        }
        entry = entry > least ? entry : least;
        for (std::size_t l = 0; l < kLanes; ++l) entry[l] = std::sqrt(entry[l]);
      }
    }
    equations.solution[0] += 1;
    for (std::size_t a = 0; a < kTerms; ++a) {
      Lanes& value = equations.solution[a];
      for (std::size_t b = 0; b < a; ++b) value -= equations.at(a, b) * equations.solution[b];
      value /= equations.at(a, a);
    }
    for (std::size_t a = kTerms; a-- > 0;) {
      Lanes& value = equations.solution[a];
      for (std::size_t b = a + 1; b < kTerms; ++b)
        value -= equations.at(b, a) * equations.solution[b];
      value /= equations.at(a, a);
    }
  }

  const Half& half_;
  const Guidance& guide_;
  const int radius_;
  const std::size_t begin_, count_, side_;
  std::vector<float> patches_, ratio_, sums_, features_, ones_, weights_;
};

StreamPair empty_pair(std::size_t pixels) {
  StreamPair pair;
  for (Plane& plane : pair.a) plane.resize(pixels);
  for (Plane& plane : pair.b) plane.resize(pixels);
  return pair;
}

/// Mean of both streams, and its variance summed over the channels.
void mean_and_noise(const StreamPair& pair, ColourPlanes& mean, Plane& noise) {
  const std::size_t pixels = pair.a[0].size();
  noise.assign(pixels, 0);
  for (std::size_t c = 0; c < 3; ++c) {
    mean[c].resize(pixels);
    for (std::size_t i = 0; i < pixels; ++i) {
      const float difference = 0.5f * (pair.a[c][i] - pair.b[c][i]);
      mean[c][i] = 0.5f * (pair.a[c][i] + pair.b[c][i]);
      noise[i] += difference * difference;
    }
  }
}

}  // namespace

void prepare(const std::array<Plane, kHalfFeatures>& features_a,
             const std::array<Plane, kHalfFeatures>& features_b, Half& half) {
  const std::size_t pixels = features_a[0].size();
  Plane spread[3];  // of albedo and hits, normal, depth
  for (Plane& plane : spread) plane.assign(pixels, 0);
  for (std::size_t k = 0; k < kHalfFeatures; ++k) {
    half.features[k].resize(pixels);
    Plane& sum = spread[k == 6 ? 2 : k >= 3 && k < 6 ? 1 : 0];
    for (std::size_t i = 0; i < pixels; ++i) {
      const float difference = 0.5f * (features_a[k][i] - features_b[k][i]);
      half.features[k][i] = 0.5f * (features_a[k][i] + features_b[k][i]);
      sum[i] += difference * difference;
    }
  }
  for (Plane& plane : spread) plane = box_mean(plane, half.width, half.height, 1, 1);
  half.albedo_weight.resize(pixels);
  half.normal_weight.resize(pixels);
  half.depth_weight.resize(pixels);
  for (std::size_t i = 0; i < pixels; ++i) {
    const float depth = half.features[6][i];
    half.albedo_weight[i] = 1 / (P::kAlbedoSquare + 2 * spread[0][i]);
    half.normal_weight[i] = 1 / (P::kNormalSquare + 2 * spread[1][i]);
    half.depth_weight[i] = 1 / ((P::kDepthSquare * depth * depth + 2 * spread[2][i]) + 1e-12f);
  }
}

FilteredHalf filter_half(const Half& half) {
  const std::size_t pixels = half.valid.size();
  ColourPlanes mean;
  Plane noise;
  mean_and_noise(half.streams, mean, noise);
  noise = box_mean(noise, half.width, half.height, 1, 1);
  StreamPair smooth = empty_pair(pixels);
  const Guidance raw = guidance(mean, noise, P::kGuideNoise, P::kGuideTolerance);
  WindowFilter(half, raw, P::kGuideRadius, kGuideInset).run(smooth, nullptr);

  FilteredHalf result;
  mean_and_noise(smooth, result.guide, noise);
  noise = box_mean(noise, half.width, half.height, 2, kNoiseInset);
  result.zero_order = empty_pair(pixels);
  result.first_order = empty_pair(pixels);
  const Guidance guide = guidance(result.guide, noise, P::kFilterNoise, P::kFilterTolerance);
  WindowFilter(half, guide, P::kFilterRadius, kFilterInset)
      .run(result.zero_order, &result.first_order);
  return result;
}

}  // namespace tessera::image
