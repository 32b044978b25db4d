#include "image/denoise/half_filter.h"

#include <immintrin.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <initializer_list>
#include <utility>

#include "image/denoise/filter_parameters.h"

namespace tessera::image {
namespace {

using P = FilterParameters;
constexpr std::size_t kLanes = 8;
constexpr std::size_t kTerms = kHalfFeatures + 1;          // of the regression: 1 and the features
constexpr std::size_t kPairs = kTerms * (kTerms + 1) / 2;  // of the normal matrix, row by row
constexpr std::size_t kSides = 6;                          // right-hand sides: two streams of RGB
constexpr std::int32_t kGuideInset = 8, kNoiseInset = 10;  // the rest a multiple of kLanes
constexpr int kPatch = 1;

/// kLanes neighbouring pixels of a row. GCC does not make vectors of loops this short.
using Lanes = float __attribute__((vector_size(kLanes * sizeof(float))));

Lanes load_lanes(const float* from) {
  Lanes lanes;
  std::memcpy(&lanes, from, sizeof lanes);
  return lanes;
}

void store_lanes(Lanes lanes, float* to) {
  std::memcpy(to, &lanes, sizeof lanes);
}

/// a · b + c, rounded once.
Lanes multiply_add(Lanes a, Lanes b, Lanes c) {
  return _mm256_fmadd_ps(a, b, c);
}

std::size_t size_of(std::int32_t value) {
  return static_cast<std::size_t>(value);
}

/// Inputs of the distance between patches: colours, their noise, and the tolerance of each pixel.
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
        ratio_(count_ + 2) {}

  /// Zero-order filter of rows [inset, height - inset); with `first_order`, the regression too.
  void run(StreamPair& zero_order, StreamPair* first_order) {
    const auto inset = static_cast<std::int32_t>(begin_);
    for (std::int32_t y = inset - kPatch; y < half_.height - inset + kPatch; ++y) {
      add_patches(y);
      if (y < inset + kPatch) continue;
      for (std::size_t x = 0; x < count_; x += kLanes) {
        filter(y - kPatch, x, zero_order);
        if (first_order != nullptr) regress(y - kPatch, x, *first_order);
      }
    }
  }

 private:
  /// Sums of three ratios beside each other: a row of the 3x3 patches. For kLanes pixels from x on,
  /// all offsets in turn.
  float* patch(std::int32_t y, std::size_t x) {
    return &patches_[(size_of(y) % 3 * count_ + x) * side_ * side_];
  }

  void add_patches(std::int32_t y) {
    std::size_t offset = 0;
    for (int dy = -radius_; dy <= radius_; ++dy) {
      for (int dx = -radius_; dx <= radius_; ++dx, ++offset) {
        add_ratios(row(y) - 1, row(y + dy) - 1 + dx);
        for (std::size_t x = 0; x < count_; x += kLanes) {
          const float* ratio = &ratio_[x];
          store_lanes((load_lanes(ratio) + load_lanes(ratio + 1)) + load_lanes(ratio + 2),
                      patch(y, x) + kLanes * offset);
        }
      }
    }
  }

  /// Index of the first filtered pixel of a row.
  std::ptrdiff_t row(std::int32_t y) const {
    return static_cast<std::ptrdiff_t>(size_of(y) * size_of(half_.width) + begin_);
  }

  /// Squared difference of colours beyond what noise explains, relative to the tolerance.
  void add_ratios(std::ptrdiff_t p, std::ptrdiff_t q) {
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
  }

  /// Features of kLanes pixels, and their tolerances.
  struct Features {
    Lanes value[kHalfFeatures], albedo_weight, normal_weight, depth_weight;
  };

  Features features_at(std::ptrdiff_t p) const {
    Features at;
    for (std::size_t k = 0; k < kHalfFeatures; ++k) {
      at.value[k] = load_lanes(half_.features[k].data() + p);
    }
    at.albedo_weight = load_lanes(half_.albedo_weight.data() + p);
    at.normal_weight = load_lanes(half_.normal_weight.data() + p);
    at.depth_weight = load_lanes(half_.depth_weight.data() + p);
    return at;
  }

  /// Squared difference of the features, relative to the tolerance of the pixels `at`.
  static Lanes feature_distance(const Features& at, const float* const (&planes)[kHalfFeatures],
                                std::ptrdiff_t q) {
    Lanes difference[kHalfFeatures];
    for (std::size_t k = 0; k < kHalfFeatures; ++k)
      difference[k] = at.value[k] - load_lanes(planes[k] + q);
    const auto squares = [&](std::initializer_list<std::size_t> features) {
      Lanes sum = {};
      for (const std::size_t k : features) sum = multiply_add(difference[k], difference[k], sum);
      return sum;
    };
    const Lanes depth = squares({6}) * at.depth_weight;
    const Lanes normal = multiply_add(squares({3, 4, 5}), at.normal_weight, depth);
    return multiply_add(squares({0, 1, 2, 7}), at.albedo_weight, normal);
  }

  /// Mean distance of the colours of two patches: of kLanes pixels from x on, and of their
  /// neighbours at one offset.
  struct Patches {
    const float *above, *here, *below;

    Lanes distance(std::size_t offset) const {
      const std::size_t at = offset * kLanes;
      const Lanes mean =
          ((load_lanes(above + at) + load_lanes(here + at)) + load_lanes(below + at)) * (1.0f / 9);
      return mean > 0 ? mean : Lanes{};
    }
  };

  Patches patches_at(std::int32_t y, std::size_t x) {
    return {patch(y - 1, x), patch(y, x), patch(y + 1, x)};
  }

  /// Share of a neighbour's weight that counts: 0 outside the frame; the pixel itself has weight 1.
  Lanes in_frame(std::ptrdiff_t p, std::ptrdiff_t q) const {
    return q == p ? Lanes{} + 1 : load_lanes(half_.valid.data() + q);
  }

  /// Filters kLanes pixels.
  void filter(std::int32_t y, std::size_t x, StreamPair& out) {
    const std::ptrdiff_t p = row(y) + static_cast<std::ptrdiff_t>(x);
    const Features at = features_at(p);
    const Patches patches = patches_at(y, x);
    const float *planes[kHalfFeatures], *streams[kSides];
    for (std::size_t k = 0; k < kHalfFeatures; ++k) planes[k] = half_.features[k].data();
    for (std::size_t k = 0; k < kSides; ++k) streams[k] = stream(k);
    Lanes total = {}, sums[kSides] = {};
    std::size_t offset = 0;
    for (int dy = -radius_; dy <= radius_; ++dy) {
      for (int dx = -radius_; dx <= radius_; ++dx, ++offset) {
        const std::ptrdiff_t q = p + dy * std::ptrdiff_t{half_.width} + dx;
        const Lanes distance = patches.distance(offset) + feature_distance(at, planes, q);
        const Lanes weight = filter_weight(distance) * in_frame(p, q);
        total += weight;
        for (std::size_t k = 0; k < kSides; ++k)
          sums[k] = multiply_add(weight, load_lanes(streams[k] + q), sums[k]);
      }
    }
    for (std::size_t k = 0; k < kSides; ++k) {
      store_lanes(sums[k] / total, (k < 3 ? out.a[k] : out.b[k - 3]).data() + p);
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

  /// A neighbour that the regression is fitted to: its weight by colour alone, and the scaled
  /// differences of the features, without term 0, which is 1.
  struct Neighbour {
    std::ptrdiff_t position;
    Lanes weight, terms[kHalfFeatures];
  };
  static constexpr std::size_t kRegressionSide = 2 * P::kRegressionRadius + 1;
  static constexpr std::size_t kNeighbours = kRegressionSide * kRegressionSide;

  void find_neighbours(std::int32_t y, std::size_t x, std::ptrdiff_t p,
                       Neighbour (&neighbours)[kNeighbours]) {
    constexpr int kRadius = P::kRegressionRadius;
    const Patches patches = patches_at(y, x);
    const Lanes depth = load_lanes(half_.features[6].data() + p);
    const Lanes depth_scale = depth > 0 ? P::kDepthScale / depth : Lanes{};
    Neighbour* to = neighbours;
    for (int dy = -kRadius; dy <= kRadius; ++dy) {
      for (int dx = -kRadius; dx <= kRadius; ++dx) {
        const std::size_t offset = size_of(dy + radius_) * side_ + size_of(dx + radius_);
        const std::ptrdiff_t q = p + dy * std::ptrdiff_t{half_.width} + dx;
        to->position = q;
        to->weight = filter_weight(patches.distance(offset)) * in_frame(p, q);
        find_terms(p, q, depth_scale, to->terms);
        ++to;
      }
    }
  }

  /// The regression's value at a pixel is linear in the neighbours' colours: their factors are
  /// weight · solution · terms.
  void regress(std::int32_t y, std::size_t x, StreamPair& out) {
    Equations equations;
    const std::ptrdiff_t p = row(y) + static_cast<std::ptrdiff_t>(x);
    Neighbour neighbours[kNeighbours];
    find_neighbours(y, x, p, neighbours);
    add_rows(neighbours, equations, std::make_index_sequence<kTerms>());
    solve(equations);
    Lanes sums[kSides] = {};
    for (const Neighbour& each : neighbours) {
      Lanes factor = equations.solution[0];
      for (std::size_t a = 1; a < kTerms; ++a)
        factor = multiply_add(equations.solution[a], each.terms[a - 1], factor);
      factor *= each.weight;
      for (std::size_t k = 0; k < kSides; ++k)
        sums[k] = multiply_add(factor, load_lanes(stream(k) + each.position), sums[k]);
    }
    for (std::size_t k = 0; k < kSides; ++k) {
      store_lanes(sums[k], (k < 3 ? out.a[k] : out.b[k - 3]).data() + p);
    }
  }

  void find_terms(std::ptrdiff_t p, std::ptrdiff_t q, Lanes depth_scale,
                  Lanes (&terms)[kHalfFeatures]) const {
    for (std::size_t k = 0; k < kHalfFeatures; ++k) {
      const float* plane = half_.features[k].data();
      const Lanes difference = load_lanes(plane + q) - load_lanes(plane + p);
      terms[k] = k == 6 ? difference * depth_scale
                        : difference * (k >= 3 && k < 6 ? P::kNormalScale : P::kAlbedoScale);
    }
  }

  /// Row A of the normal matrix; its sums stay in registers.
  template <std::size_t A>
  static void add_row(const Neighbour (&neighbours)[kNeighbours], Equations& equations) {
    Lanes sums[A + 1] = {};
    for (const Neighbour& each : neighbours) {
      Lanes weighted = each.weight;
      if constexpr (A > 0) weighted *= each.terms[A - 1];
      sums[0] += weighted;
      for (std::size_t b = 1; b <= A; ++b)
        sums[b] = multiply_add(weighted, each.terms[b - 1], sums[b]);
    }
    for (std::size_t b = 0; b <= A; ++b) equations.at(A, b) = sums[b];
  }

  template <std::size_t... kRows>
  static void add_rows(const Neighbour (&neighbours)[kNeighbours], Equations& equations,
                       std::index_sequence<kRows...>) {
    (add_row<kRows>(neighbours, equations), ...);
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
  std::vector<float> patches_, ratio_;
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
