#include "image/denoise/filter/candidate_choice.h"

#include <algorithm>

#include "image/denoise/filter/filter_parameters.h"

namespace tessera::image {
namespace {

template <std::size_t kCount>
double product(const Products<kCount>& products, std::size_t k, std::size_t l) {
  const std::size_t row = std::max(k, l), column = std::min(k, l);
  return products[row * (row + 1) / 2 + column];
}

/// Sum of the products of the cells around one, near ones counting more.
template <std::size_t kCount>
Products<kCount> pooled_products(const RollingRows<Products<kCount>>& cells, std::int32_t column,
                                 std::int32_t row) {
  constexpr double kWeights[] = {1, 2, 3, 2, 1};
  Products<kCount> sum{};
  for (std::int32_t dy = -kPooledCells; dy <= kPooledCells; ++dy) {
    for (std::int32_t dx = -kPooledCells; dx <= kPooledCells; ++dx) {
      const Products<kCount>& from = cells.row(row + dy)[column + dx];
      for (std::size_t k = 0; k < sum.size(); ++k)
        sum[k] += kWeights[dy + kPooledCells] * kWeights[dx + kPooledCells] * from[k];
    }
  }
  return sum;
}

/// The products of kCandidates candidates, from `first` on.
Products<kCandidates> block_of(const Products<kFusedCandidates>& products, std::size_t first) {
  Products<kCandidates> block;
  std::size_t to = 0;
  for (std::size_t k = 0; k < kCandidates; ++k) {
    for (std::size_t l = 0; l <= k; ++l)
      block[to++] = product<kFusedCandidates>(products, first + k, first + l);
  }
  return block;
}

/// Finds the shares, at least 0 and 1 in sum, with the least squared error.
class BestShares {
 public:
  explicit BestShares(const Products<kCandidates>& products) : products_(products) {
    for (std::size_t k = 0; k < kCandidates; ++k) {
      double alone[kCandidates] = {};
      alone[k] = 1;
      consider(alone);
    }
    for (std::size_t k = 0; k < kCandidates; ++k) {
      for (std::size_t l = 0; l < k; ++l) consider_pair(k, l);
    }
    consider_all();
  }

  /// All for the first candidate unless a mixture is clearly better. It must be the raw image.
  Shares<kCandidates> shares_or_raw() const {
    const double raw_variance = at(0, 0) / 3;  // ¼ (a − b)², where at(0, 0) sums ¾ (a − b)²
    if (!(least_ < at(0, 0) - FilterParameters::kLeastGain * raw_variance)) return {1, 0, 0};
    return shares();
  }

  Shares<kCandidates> shares() const {
    return {static_cast<float>(best_[0]), static_cast<float>(best_[1]),
            static_cast<float>(best_[2])};
  }

 private:
  double at(std::size_t k, std::size_t l) const { return product<kCandidates>(products_, k, l); }

  void consider(const double (&shares)[kCandidates]) {
    double square = 0;
    for (std::size_t k = 0; k < kCandidates; ++k) {
      for (std::size_t l = 0; l < kCandidates; ++l) square += shares[k] * shares[l] * at(k, l);
    }
    if (has_best_ && !(square < least_)) return;
    has_best_ = true;
    least_ = square;
    std::copy_n(shares, kCandidates, best_);
  }

  /// The best mixture of two, unless one of them is better alone.
  void consider_pair(std::size_t k, std::size_t l) {
    const double first = at(k, k) - at(k, l), second = at(l, l) - at(k, l);
    if (!(first > 0 && second > 0)) return;
    double shares[kCandidates] = {};
    shares[l] = first / (first + second);
    shares[k] = 1 - shares[l];
    consider(shares);
  }

  /// The mixture (1 − u − v, u, v) at which both derivatives are 0.
  void consider_all() {
    const double uu = at(0, 0) - 2 * at(0, 1) + at(1, 1), vv = at(0, 0) - 2 * at(0, 2) + at(2, 2);
    const double uv = at(0, 0) - at(0, 1) - at(0, 2) + at(1, 2);
    const double u0 = at(0, 0) - at(0, 1), v0 = at(0, 0) - at(0, 2);
    const double determinant = uu * vv - uv * uv;
    if (!(determinant > 0 && uu > 0)) return;
    const double u = (u0 * vv - v0 * uv) / determinant, v = (v0 * uu - u0 * uv) / determinant;
    if (u > 0 && v > 0 && u + v < 1) consider({1 - u - v, u, v});
  }

  const Products<kCandidates>& products_;
  bool has_best_ = false;
  double least_ = 0, best_[kCandidates] = {};
};

}  // namespace

template <std::size_t kCount>
void add_products(const CandidatePairs<kCount>& candidates, const ColourPlanes& guide,
                  std::size_t i, Products<kCount>& sums) {
  const StreamPair& raw = *candidates[0];
  for (std::size_t c = 0; c < 3; ++c) {
    const double square = guide[c][i];
    const double scale = 1 / (square * square + static_cast<double>(FilterParameters::kErrorFloor));
    const double raw_a = raw.a[c][i], raw_b = raw.b[c][i];
    const double handicap =
        FilterParameters::kRawAdvantage * 0.25 * ((raw_a - raw_b) * (raw_a - raw_b));
    double first[kCount], second[kCount], spread[kCount];
    for (std::size_t k = 0; k < kCount; ++k) {
      const double a = candidates[k]->a[c][i], b = candidates[k]->b[c][i];
      first[k] = a - raw_b;
      second[k] = b - raw_a;
      spread[k] = a - b;
    }
    std::size_t to = 0;
    for (std::size_t k = 0; k < kCount; ++k) {
      for (std::size_t l = 0; l <= k; ++l) {
        sums[to++] += (0.5 * (first[k] * first[l] + second[k] * second[l]) -
                       0.25 * (spread[k] * spread[l]) + (l > 0 ? handicap : 0)) *
                      scale;
      }
    }
  }
}

template void add_products<kCandidates>(const CandidatePairs<kCandidates>& candidates,
                                        const ColourPlanes& guide, std::size_t i,
                                        Products<kCandidates>& sums);
template void add_products<kFusedCandidates>(const CandidatePairs<kFusedCandidates>& candidates,
                                             const ColourPlanes& guide, std::size_t i,
                                             Products<kFusedCandidates>& sums);

Shares<kCandidates> best_shares(const RollingRows<Products<kCandidates>>& cells,
                                std::int32_t column, std::int32_t row) {
  const Products<kCandidates> pooled = pooled_products<kCandidates>(cells, column, row);
  return BestShares(pooled).shares_or_raw();
}

Shares<kFusedCandidates> best_shares(const RollingRows<Products<kFusedCandidates>>& cells,
                                     std::int32_t column, std::int32_t row) {
  const Products<kFusedCandidates> pooled = pooled_products<kFusedCandidates>(cells, column, row);
  const Products<kCandidates> alone_errors = block_of(pooled, 0),
                              fused_errors = block_of(pooled, kCandidates);
  const Shares<kCandidates> alone = BestShares(alone_errors).shares_or_raw(),
                            fused = BestShares(fused_errors).shares();
  double alone_square = 0, fused_square = 0, mixed = 0;
  for (std::size_t k = 0; k < kCandidates; ++k) {
    for (std::size_t l = 0; l < kCandidates; ++l) {
      const auto factor = [&](const Shares<kCandidates>& a, const Shares<kCandidates>& b) {
        return static_cast<double>(a[k]) * static_cast<double>(b[l]);
      };
      alone_square += factor(alone, alone) * product<kFusedCandidates>(pooled, k, l);
      fused_square += factor(fused, fused) *
                      product<kFusedCandidates>(pooled, kCandidates + k, kCandidates + l);
      mixed += factor(alone, fused) * product<kFusedCandidates>(pooled, k, kCandidates + l);
    }
  }
  const double gain = alone_square - mixed, loss = fused_square - mixed;
  double share = !(gain > 0) ? 0 : loss > 0 ? gain / (gain + loss) : 1;
  const double least = alone_square - share * (2 - share) * gain + share * share * loss,
               raw_variance = pooled[0] / 3;
  if (!(least < alone_square - FilterParameters::kLeastFusedGain * raw_variance)) share = 0;
  Shares<kFusedCandidates> shares;
  for (std::size_t k = 0; k < kCandidates; ++k) {
    shares[k] = static_cast<float>((1 - share) * static_cast<double>(alone[k]));
    shares[kCandidates + k] = static_cast<float>(share * static_cast<double>(fused[k]));
  }
  return shares;
}

}  // namespace tessera::image
