#include "image/denoise/filter/half_filter.h"

#include <immintrin.h>

#include <algorithm>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <utility>

#include "image/denoise/filter/filter_parameters.h"

namespace tessera::image {
namespace {

using P = FilterParameters;
constexpr std::size_t kLanes = 8;
constexpr std::size_t kTerms = kHalfFeatures + 1;          // of the regression: 1 and the features
constexpr std::size_t kPairs = kTerms * (kTerms + 1) / 2;  // of the normal matrix, row by row
constexpr std::size_t kSides = 6;                          // right-hand sides: two streams of RGB
constexpr std::size_t kSide = 2 * P::kWindowRadius + 1, kOffsets = kSide * kSide;
constexpr int kPatch = 1, kRawNoiseRadius = 1, kGuideNoiseRadius = 2;
static_assert(P::kWindowRadius + kPatch + kGuideNoiseRadius <= kHalfMargin);

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

Lanes at_least_0(Lanes lanes) {
  return _mm256_max_ps(lanes, Lanes{});
}

/// filter_weight(), whose product is exact, so that one rounding fewer gives the same bits.
Lanes weight_of(Lanes distance) {
  Lanes t = at_least_0(_mm256_fnmadd_ps(distance, Lanes{} + 0.125f, Lanes{} + 1));
  t *= t;
  t *= t;
  return t * t;
}

/// Lanes kShift to kShift + 7 of the sixteen of `first` and `second`; kShift is 1 or 2.
template <int kShift>
Lanes shifted(Lanes first, Lanes second) {
  const __m256i middle = _mm256_castps_si256(_mm256_permute2f128_ps(first, second, 0x21));
  return _mm256_castsi256_ps(_mm256_alignr_epi8(middle, _mm256_castps_si256(first), 4 * kShift));
}

std::size_t size_of(std::int32_t value) {
  return static_cast<std::size_t>(value);
}

/// Tolerances of the squared difference of two colours, for each pixel.
Plane tolerances(const ColourPlanes& colour, const Plane& noise, float per_noise,
                 float per_square) {
  Plane tolerance(noise.size());
  for (std::size_t i = 0; i < noise.size(); ++i) {
    const float square =
        (colour[0][i] * colour[0][i] + colour[1][i] * colour[1][i]) + colour[2][i] * colour[2][i];
    tolerance[i] = (per_noise * noise[i] + per_square * square) + P::kMinSquare;
  }
  return tolerance;
}

/// Adds up (2 radius + 1)² neighbours, row by row, and divides by their number. Defined `radius`
/// pixels from the border on.
Plane box_mean(const Plane& in, std::int32_t width, std::int32_t height, std::int32_t radius) {
  Plane out(in.size());
  const float scale = 1.0f / static_cast<float>((2 * radius + 1) * (2 * radius + 1));
  const std::size_t begin = size_of(radius), end = size_of(width - radius);
  for (std::int32_t y = radius; y < height - radius; ++y) {
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

/// The input planes of a WindowFilter, interleaved row by row: row y of plane 0, row y of plane 1,
/// and so on. The distance between planes is a constant, so one register addresses all of them.
class PlaneRows {
 public:
  static constexpr std::size_t kColour = 0, kNoise = 3, kTolerance = 4, kFeatures = 5,
                               kStreams = 13, kValid = 19, kPlanes = 20;
  static constexpr std::size_t kStride = kMaxHalfWidth, kRow = kPlanes * kStride;

  PlaneRows(const Half& half, const ColourPlanes& guide, const Plane& noise, const Plane& tolerance)
      : width_(size_of(half.width)),
        values_(std::make_unique_for_overwrite<float[]>(size_of(half.height) * kRow)) {
    for (std::size_t c = 0; c < 3; ++c) {
      add(guide[c], kColour + c);
      add(half.streams.a[c], kStreams + c);
      add(half.streams.b[c], kStreams + 3 + c);
    }
    add(noise, kNoise);
    add(tolerance, kTolerance);
    for (std::size_t k = 0; k < kHalfFeatures; ++k) add(half.features[k], kFeatures + k);
    add(half.valid, kValid);
  }

  /// The values of pixel (x, y); that of plane k is kStride · k further.
  const float* at(std::int32_t y, std::size_t x) const {
    return values_.get() + size_of(y) * kRow + x;
  }

 private:
  void add(const Plane& plane, std::size_t k) {
    float* to = values_.get() + k * kStride;
    for (std::size_t i = 0; i < plane.size(); i += width_, to += kRow)
      std::fill(std::copy_n(plane.data() + i, width_, to), to + kStride, 0.0f);
  }

  std::size_t width_;
  std::unique_ptr<float[]> values_;
};

/// kLanes pixels of plane k, from the one on whose values begin at `pixel`.
Lanes load_plane(const float* pixel, std::size_t k) {
  return load_lanes(pixel + k * PlaneRows::kStride);
}

/// Filters the pixels of a half with windows of kSide x kSide pixels, kLanes pixels at a time.
class WindowFilter {
 public:
  WindowFilter(const Half& half, const PlaneRows& planes)
      : half_(half),
        planes_(planes),
        count_(size_of(half.width - 2 * kHalfMargin)),
        row_sums_(kOffsets * (count_ / kLanes)) {
    std::size_t to = 0;
    for (int dy = -P::kWindowRadius; dy <= P::kWindowRadius; ++dy) {
      for (int dx = -P::kWindowRadius; dx <= P::kWindowRadius; ++dx)
        offsets_[to++] = std::ptrdiff_t{dy} * static_cast<std::ptrdiff_t>(PlaneRows::kRow) + dx;
    }
  }

  /// Zero-order filter; with `first_order`, the regression too.
  void run(StreamPair& zero_order, StreamPair* first_order) {
    for (std::int32_t y = kHalfMargin - kPatch; y < half_.height - kHalfMargin + kPatch; ++y) {
      start_row(y);
      for (std::size_t x = kHalfMargin; x < kHalfMargin + count_; x += kLanes) {
        add_patches(y, x);
        if (y < kHalfMargin + kPatch) continue;
        const float* p = planes_.at(y - kPatch, x);
        const std::size_t to = size_of(y - kPatch) * size_of(half_.width) + x;
        window_is_valid(p) ? find_weights<true>(p, to) : find_weights<false>(p, to);
        average(p, to, zero_order);
        if (first_order != nullptr) regress(p, to, *first_order);
      }
    }
  }

 private:
  using Rows = PlaneRows;

  /// Guide colour, its square, noise and tolerance of kLanes neighbouring pixels.
  struct GuidePixels {
    Lanes colour[3], square, noise, tolerance;
  };

  static Lanes square_of(const Lanes (&colour)[3]) {
    return (colour[0] * colour[0] + colour[1] * colour[1]) + colour[2] * colour[2];
  }

  static GuidePixels guide_at(const float* p) {
    GuidePixels at;
    for (std::size_t c = 0; c < 3; ++c) at.colour[c] = load_plane(p, Rows::kColour + c);
    at.square = square_of(at.colour);
    at.noise = load_plane(p, Rows::kNoise);
    at.tolerance = load_plane(p, Rows::kTolerance);
    return at;
  }

  /// Squared difference of colours beyond what noise explains, relative to the tolerance; at most
  /// kMaxRatio if the contrast is small.
  static Lanes ratio(const GuidePixels& at, const float* q) {
    const GuidePixels other = guide_at(q);
    Lanes difference[3];
    for (std::size_t c = 0; c < 3; ++c) difference[c] = at.colour[c] - other.colour[c];
    const Lanes square = square_of(difference);
    const Lanes noise = at.noise + (at.noise < other.noise ? at.noise : other.noise);
    const Lanes ratio = (square - noise) / (at.tolerance + other.tolerance);
    const Lanes darker = at.square < other.square ? at.square : other.square;
    const Lanes limited = ratio < P::kMaxRatio ? ratio : Lanes{} + P::kMaxRatio;
    return square <= P::kMaxContrast * darker ? limited : ratio;
  }

  /// Ratios of the kLanes pixels that begin one pixel before the first of a row.
  void start_row(std::int32_t y) {
    const float* p = planes_.at(y, kHalfMargin - kPatch);
    const GuidePixels at = guide_at(p);
    for (std::size_t o = 0; o < kOffsets; ++o) ratios_[o] = ratio(at, p + offsets_[o]);
  }

  /// Adds row y to the patches around kLanes pixels of the row above, which completes them: finds
  /// the mean distances of their colours to those of the neighbours.
  void add_patches(std::int32_t y, std::size_t x) {
    const float* p = planes_.at(y, x - kPatch + kLanes);
    const GuidePixels at = guide_at(p);
    RowSums* sums = &row_sums_[(x - kHalfMargin) / kLanes * kOffsets];
    const std::size_t slot = size_of(y) % 2;
    for (std::size_t o = 0; o < kOffsets; ++o) {
      const Lanes first = ratios_[o], next = ratio(at, p + offsets_[o]);
      const Lanes sum = (first + shifted<1>(first, next)) + shifted<2>(first, next);
      ratios_[o] = next;
      Lanes(&rows)[2] = sums[o].rows;  // rows[slot] is the row two above
      const Lanes mean = ((rows[slot] + rows[1 - slot]) + sum) * (1.0f / 9);
      distances_[o] = at_least_0(mean);
      rows[slot] = sum;
    }
  }

  /// Whether all pixels in the windows of kLanes pixels are in the frame.
  bool window_is_valid(const float* p) const {
    Lanes least = Lanes{} + 1;
    for (std::size_t row = 0; row < kSide; ++row) {
      for (const std::size_t column : {std::size_t{0}, kSide / 2, kSide - 1}) {
        const Lanes valid = load_plane(p + offsets_[row * kSide + column], Rows::kValid);
        least = valid < least ? valid : least;
      }
    }
    return _mm256_movemask_ps(_mm256_cmp_ps(least, Lanes{} + 1, _CMP_LT_OQ)) == 0;
  }

  /// Share of a neighbour's weight that counts: 0 outside the frame; the pixel itself has weight 1.
  Lanes in_frame(const float* p, std::size_t o) const {
    return o == kOffsets / 2 ? Lanes{} + 1 : load_plane(p + offsets_[o], Rows::kValid);
  }

  /// Weights of all neighbours of kLanes pixels, by colour and features. The pixels have index `i`
  /// in the planes of the half.
  template <bool kAllValid>
  void find_weights(const float* p, std::size_t i) {
    Lanes at[kHalfFeatures];
    for (std::size_t k = 0; k < kHalfFeatures; ++k) at[k] = load_plane(p, Rows::kFeatures + k);
    const Lanes albedo_weight = load_lanes(half_.albedo_weight.data() + i),
                normal_weight = load_lanes(half_.normal_weight.data() + i),
                depth_weight = load_lanes(half_.depth_weight.data() + i);
    for (std::size_t o = 0; o < kOffsets; ++o) {
      const float* q = p + offsets_[o];
      const auto squares = [&](std::initializer_list<std::size_t> features) {
        Lanes sum = {};
        for (const std::size_t k : features) {
          const Lanes difference = at[k] - load_plane(q, Rows::kFeatures + k);
          sum = multiply_add(difference, difference, sum);
        }
        return sum;
      };
      const Lanes depth = squares({6}) * depth_weight;
      const Lanes normal = multiply_add(squares({3, 4, 5}), normal_weight, depth);
      const Lanes features = multiply_add(squares({0, 1, 2, 7}), albedo_weight, normal);
      const Lanes weight = weight_of(distances_[o] + features);
      weights_[o] = kAllValid ? weight : weight * in_frame(p, o);
    }
  }

  /// Weighted means of the streams in the windows of kLanes pixels.
  void average(const float* p, std::size_t to, StreamPair& out) const {
    Lanes total = {}, sums[kSides] = {};
    for (std::size_t o = 0; o < kOffsets; ++o) {
      const float* q = p + offsets_[o];
      const Lanes weight = weights_[o];
      total += weight;
      for (std::size_t k = 0; k < kSides; ++k)
        sums[k] = multiply_add(weight, load_plane(q, Rows::kStreams + k), sums[k]);
    }
    for (std::size_t k = 0; k < kSides; ++k) sums[k] /= total;
    store(sums, to, out);
  }

  static void store(const Lanes (&values)[kSides], std::size_t to, StreamPair& out) {
    for (std::size_t c = 0; c < 3; ++c) {
      store_lanes(values[c], out.a[c].data() + to);
      store_lanes(values[3 + c], out.b[c].data() + to);
    }
  }

  /// Normal matrix of kLanes pixels, and the solution for the constant term.
  struct Equations {
    Lanes matrix[kPairs], solution[kTerms];

    Lanes& at(std::size_t a, std::size_t b) { return matrix[a * (a + 1) / 2 + b]; }
  };

  /// A neighbour that the regression is fitted to: its weight by colour alone, and the scaled
  /// differences of the features, without term 0, which is 1.
  struct Neighbour {
    const float* pixel;
    Lanes weight, terms[kHalfFeatures];
  };
  static constexpr std::size_t kRegressionSide = 2 * P::kRegressionRadius + 1;
  static constexpr std::size_t kNeighbours = kRegressionSide * kRegressionSide;

  void find_neighbours(const float* p, Neighbour (&neighbours)[kNeighbours]) const {
    constexpr std::size_t kFirst = P::kWindowRadius - P::kRegressionRadius;
    const Lanes depth = load_plane(p, Rows::kFeatures + 6);
    const Lanes depth_scale = depth > 0 ? P::kDepthScale / depth : Lanes{};
    Neighbour* to = neighbours;
    for (std::size_t row = kFirst; row < kFirst + kRegressionSide; ++row) {
      for (std::size_t column = kFirst; column < kFirst + kRegressionSide; ++column, ++to) {
        const std::size_t o = row * kSide + column;
        to->pixel = p + offsets_[o];
        to->weight = weight_of(distances_[o]) * in_frame(p, o);
        for (std::size_t k = 0; k < kHalfFeatures; ++k) {
          const std::size_t plane = Rows::kFeatures + k;
          const Lanes difference = load_plane(to->pixel, plane) - load_plane(p, plane);
          to->terms[k] = k == 6
                             ? difference * depth_scale
                             : difference * (k >= 3 && k < 6 ? P::kNormalScale : P::kAlbedoScale);
        }
      }
    }
  }

  /// The regression's value at a pixel is linear in the neighbours' colours: their factors are
  /// weight · solution · terms.
  void regress(const float* p, std::size_t to, StreamPair& out) const {
    Equations equations;
    Neighbour neighbours[kNeighbours];
    find_neighbours(p, neighbours);
    // Rows in pairs: their sums fit into the registers, and hide each other's latency.
    add_rows<8, 2>(neighbours, equations);
    add_rows<7, 3>(neighbours, equations);
    add_rows<6, 4>(neighbours, equations);
    add_rows<5, 1>(neighbours, equations);
    Lanes total = {};
    for (const Neighbour& each : neighbours) total += each.weight;
    equations.at(0, 0) = total;
    solve(equations);
    Lanes sums[kSides] = {};
    for (const Neighbour& each : neighbours) {
      Lanes factor = equations.solution[0];
      for (std::size_t a = 1; a < kTerms; ++a)
        factor = multiply_add(equations.solution[a], each.terms[a - 1], factor);
      factor *= each.weight;
      for (std::size_t k = 0; k < kSides; ++k)
        sums[k] = multiply_add(factor, load_plane(each.pixel, Rows::kStreams + k), sums[k]);
    }
    store(sums, to, out);
  }

  /// Rows A and B of the normal matrix.
  template <std::size_t A, std::size_t B>
  static void add_rows(const Neighbour (&neighbours)[kNeighbours], Equations& equations) {
    static_assert(A > B && B > 0);
    Lanes a[A + 1] = {}, b[B + 1] = {};
    for (const Neighbour& each : neighbours) {
      const Lanes weighted_a = each.weight * each.terms[A - 1],
                  weighted_b = each.weight * each.terms[B - 1];
      a[0] += weighted_a;
      b[0] += weighted_b;
      for (std::size_t k = 1; k <= A; ++k) a[k] = multiply_add(weighted_a, each.terms[k - 1], a[k]);
      for (std::size_t k = 1; k <= B; ++k) b[k] = multiply_add(weighted_b, each.terms[k - 1], b[k]);
    }
    for (std::size_t k = 0; k <= A; ++k) equations.at(A, k) = a[k];
    for (std::size_t k = 0; k <= B; ++k) equations.at(B, k) = b[k];
  }

  /// Solves for the unit vector of the constant term by Cholesky's decomposition, with a ridge.
  /// Column by column, because the operations of a column do not wait for each other.
  static void solve(Equations& equations) {
    const Lanes total = equations.at(0, 0), least = P::kMinPivot * total;
    for (std::size_t a = 1; a < kTerms; ++a) equations.at(a, a) += P::kRidge * total;
    Lanes(&value)[kTerms] = equations.solution;
    for (std::size_t a = 0; a < kTerms; ++a) value[a] = Lanes{} + (a == 0 ? 1.0f : 0.0f);
    for (std::size_t b = 0; b < kTerms; ++b) {
      const Lanes square = equations.at(b, b);
      const Lanes pivot = _mm256_sqrt_ps(square > least ? square : least);
      equations.at(b, b) = pivot;
      value[b] /= pivot;
      for (std::size_t a = b + 1; a < kTerms; ++a) {
        equations.at(a, b) /= pivot;
        value[a] -= equations.at(a, b) * value[b];
      }
      for (std::size_t a = b + 1; a < kTerms; ++a) {
        for (std::size_t k = b + 1; k <= a; ++k)
          equations.at(a, k) -= equations.at(a, b) * equations.at(k, b);
      }
    }
    for (std::size_t a = kTerms; a-- > 0;) {
      for (std::size_t b = a + 1; b < kTerms; ++b) value[a] -= equations.at(b, a) * value[b];
      value[a] /= equations.at(a, a);
    }
  }

  /// Sums of three ratios beside each other in the last two rows.
  struct RowSums {
    Lanes rows[2];
  };

  const Half& half_;
  const PlaneRows& planes_;
  const std::size_t count_;
  std::vector<RowSums> row_sums_;  // for each kLanes pixels of a row all offsets in turn
  std::ptrdiff_t offsets_[kOffsets];
  Lanes ratios_[kOffsets], distances_[kOffsets], weights_[kOffsets];
};

StreamPair empty_pair(std::size_t pixels) {
  StreamPair pair;
  for (Plane& plane : pair.a) plane.resize(pixels);
  for (Plane& plane : pair.b) plane.resize(pixels);
  return pair;
}

/// Mean of both streams, and its variance summed over the channels.
Guide mean_and_variance(const StreamPair& pair) {
  Guide guide;
  const std::size_t pixels = pair.a[0].size();
  guide.variance.resize(pixels);
  for (std::size_t c = 0; c < 3; ++c) {
    guide.colour[c].resize(pixels);
    const float *a = pair.a[c].data(), *b = pair.b[c].data();
    for (std::size_t i = 0; i < pixels; ++i) {
      const float difference = 0.5f * (a[i] - b[i]);
      guide.colour[c][i] = 0.5f * (a[i] + b[i]);
      guide.variance[i] += difference * difference;
    }
  }
  return guide;
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
  for (Plane& plane : spread) plane = box_mean(plane, half.width, half.height, 1);
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

Guide filter_guide(const Half& half) {
  const Guide raw = mean_and_variance(half.streams);
  const Plane noise = box_mean(raw.variance, half.width, half.height, kRawNoiseRadius);
  const PlaneRows planes(half, raw.colour, noise,
                         tolerances(raw.colour, noise, P::kGuideNoise, P::kGuideTolerance));
  StreamPair smooth = empty_pair(half.valid.size());
  WindowFilter(half, planes).run(smooth, nullptr);
  return mean_and_variance(smooth);
}

Candidates filter_candidates(const Half& half, const Guide& guide) {
  const Plane noise = box_mean(guide.variance, half.width, half.height, kGuideNoiseRadius);
  const PlaneRows planes(half, guide.colour, noise,
                         tolerances(guide.colour, noise, P::kFilterNoise, P::kFilterTolerance));
  Candidates result{empty_pair(half.valid.size()), empty_pair(half.valid.size())};
  WindowFilter(half, planes).run(result.zero_order, &result.first_order);
  return result;
}

}  // namespace tessera::image
