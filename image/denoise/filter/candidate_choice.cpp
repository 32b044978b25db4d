#include "image/denoise/filter/candidate_choice.h"

#include <algorithm>

#include "image/denoise/filter/filter_parameters.h"

namespace tessera::image {
namespace {

double product(const Products& products, std::size_t k, std::size_t l) {
  const std::size_t row = std::max(k, l), column = std::min(k, l);
  return products[row * (row + 1) / 2 + column];
}

/// Sum of the products of the cells around one, near ones counting more.
Products pooled_products(const RollingRows<Products>& cells, std::int32_t column,
                         std::int32_t row) {
  constexpr double kWeights[] = {1, 2, 3, 2, 1};
  Products sum{};
  for (std::int32_t dy = -kPooledCells; dy <= kPooledCells; ++dy) {
    for (std::int32_t dx = -kPooledCells; dx <= kPooledCells; ++dx) {
      const Products& from = cells.row(row + dy)[column + dx];
      for (std::size_t k = 0; k < kProducts; ++k)
        sum[k] += kWeights[dy + kPooledCells] * kWeights[dx + kPooledCells] * from[k];
    }
  }
  return sum;
}

/// Finds the shares, at least 0 and 1 in sum, with the least squared error.
class BestShares {
 public:
  explicit BestShares(const Products& products) : products_(products) {
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

  Shares shares() const {
    const double raw_variance = at(0, 0) / 3;  // ¼ (a − b)², where at(0, 0) sums ¾ (a − b)²
    if (!(least_ < at(0, 0) - FilterParameters::kLeastGain * raw_variance)) return {1, 0, 0};
    return {static_cast<float>(best_[0]), static_cast<float>(best_[1]),
            static_cast<float>(best_[2])};
  }

 private:
  double at(std::size_t k, std::size_t l) const { return product(products_, k, l); }

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

  const Products& products_;
  bool has_best_ = false;
  double least_ = 0, best_[kCandidates] = {};
};

}  // namespace

void add_products(const CandidatePairs& candidates, const ColourPlanes& guide, std::size_t i,
                  Products& sums) {
  const StreamPair& raw = *candidates[0];
  for (std::size_t c = 0; c < 3; ++c) {
    const double square = guide[c][i];
    const double scale = 1 / (square * square + static_cast<double>(FilterParameters::kErrorFloor));
    const double raw_a = raw.a[c][i], raw_b = raw.b[c][i];
    const double handicap =
        FilterParameters::kRawAdvantage * 0.25 * ((raw_a - raw_b) * (raw_a - raw_b));
    double first[kCandidates], second[kCandidates], spread[kCandidates];
    for (std::size_t k = 0; k < kCandidates; ++k) {
      const double a = candidates[k]->a[c][i], b = candidates[k]->b[c][i];
      first[k] = a - raw_b;
      second[k] = b - raw_a;
      spread[k] = a - b;
    }
    std::size_t to = 0;
    for (std::size_t k = 0; k < kCandidates; ++k) {
      for (std::size_t l = 0; l <= k; ++l) {
        sums[to++] += (0.5 * (first[k] * first[l] + second[k] * second[l]) -
                       0.25 * (spread[k] * spread[l]) + (l > 0 ? handicap : 0)) *
                      scale;
      }
    }
  }
}

Shares best_shares(const RollingRows<Products>& cells, std::int32_t column, std::int32_t row) {
  const Products pooled = pooled_products(cells, column, row);
  return BestShares(pooled).shares();
}

}  // namespace tessera::image
