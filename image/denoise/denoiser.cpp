#include "image/denoise/denoiser.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "image/denoise/filter_parameters.h"
#include "image/denoise/half_filter.h"

namespace tessera::image {
namespace {

constexpr int kStreamPlanes = 11, kCandidates = 3;  // raw, zero-order, first-order
constexpr std::int32_t kChoiceMargin = 12;          // pixels around the tile where errors are known
constexpr std::int32_t kBlurMargin = 2;  // pixels around the tile where the result is known
constexpr std::int32_t kPooledCells = 2;
static_assert(kDenoiseMargin == kFilterInset + kChoiceMargin && kChoiceMargin % kDenoiseCell == 0);

std::size_t at(std::int32_t value) {
  return static_cast<std::size_t>(value);
}

/// Position of a tile and of the pixels around it.
struct Place {
  std::int32_t x = 0, y = 0, tile_width = 0, tile_height = 0;
  std::int32_t width = 0, height = 0;  // with the margin, width rounded up for the filter

  std::size_t index(std::int32_t column, std::int32_t row) const {  // of the tile's pixels
    return at(row + kDenoiseMargin) * at(width) + at(column + kDenoiseMargin);
  }
};

Place place_of(const DenoiseRows& rows, std::int32_t x, std::int32_t y) {
  Place place{x, y, std::min(kDenoiseTile, rows.width - x),
              std::min(kDenoiseTile, rows.height - y)};
  place.width = (place.tile_width + 2 * kDenoiseMargin + 7) / 8 * 8;
  place.height = place.tile_height + 2 * kDenoiseMargin;
  return place;
}

/// Copies a plane around a tile; pixels beyond the frame repeat its border.
Plane cut(const DenoiseRows& rows, const Place& place, std::size_t plane, float scale) {
  Plane out(at(place.width) * at(place.height));
  std::size_t to = 0;
  for (std::int32_t row = 0; row < place.height; ++row) {
    const std::int32_t y = std::clamp(place.y + row - kDenoiseMargin, 0, rows.height - 1);
    const float* from = rows.planes[plane] + at(y - rows.first_row) * at(rows.width);
    for (std::int32_t column = 0; column < place.width; ++column) {
      const std::int32_t x = std::clamp(place.x + column - kDenoiseMargin, 0, rows.width - 1);
      out[to++] = from[x] * scale;
    }
  }
  return out;
}

/// A colour beyond this, in units of the mean luminance, would overflow when it is squared.
constexpr float kLargestColour = 1e15f;

Half load(const DenoiseRows& rows, const Place& place, std::size_t first_stream) {
  const auto scale = static_cast<float>(1 / rows.mean_luminance);
  Half half;
  half.width = place.width;
  half.height = place.height;
  std::array<Plane, kHalfFeatures> features[2];
  for (std::size_t s = 0; s < 2; ++s) {
    const std::size_t base = (first_stream + s) * kStreamPlanes;
    ColourPlanes& colours = s == 0 ? half.streams.a : half.streams.b;
    for (std::size_t c = 0; c < 3; ++c) {
      colours[c] = cut(rows, place, base + c, scale);
      for (float& value : colours[c]) value = std::clamp(value, -kLargestColour, kLargestColour);
    }
    for (std::size_t k = 0; k < kHalfFeatures; ++k) {
      features[s][k] = cut(rows, place, base + 3 + k, 1);
      for (float& value : features[s][k])
        value = std::clamp(value, -kLargestColour, kLargestColour);
    }
  }
  prepare(features[0], features[1], half);
  half.valid.assign(half.features[0].size(), 0);
  for (std::int32_t row = 0; row < place.height; ++row) {
    for (std::int32_t column = 0; column < place.width; ++column) {
      const std::int32_t x = place.x + column - kDenoiseMargin;
      const std::int32_t y = place.y + row - kDenoiseMargin;
      const bool inside = x >= 0 && y >= 0 && x < rows.width && y < rows.height;
      half.valid[at(row) * at(place.width) + at(column)] = inside ? 1.0f : 0.0f;
    }
  }
  return half;
}

/// Shares of the candidates.
using Shares = std::array<float, kCandidates>;

/// The shares of the candidates in each cell within kChoiceMargin of a tile.
struct Choice {
  std::int32_t columns = 0, rows = 0;  // cells, the first at -kChoiceMargin
  std::vector<Shares> shares;

  const Shares& of(std::int32_t column, std::int32_t row) const {
    return shares[at(row) * at(columns) + at(column)];
  }
};

/// A denoised half.
struct HalfResult {
  StreamPair raw;
  FilteredHalf filtered;
  Choice choice;
  ColourPlanes colour;  // defined up to kBlurMargin around the tile
};

const StreamPair& candidate(const HalfResult& half, int k) {
  return k == 0 ? half.raw : k == 1 ? half.filtered.zero_order : half.filtered.first_order;
}

/// Products of the errors of the candidates: row by row, the lower half of a symmetric matrix.
constexpr int kProducts = kCandidates * (kCandidates + 1) / 2;
using Products = std::array<double, kProducts>;

double product(const Products& products, int k, int l) {
  const int row = std::max(k, l), column = std::min(k, l);
  return products[at(row * (row + 1) / 2 + column)];
}

/// Adds the products of the candidates' relative errors at a pixel, up to a constant that all
/// share: one stream measures the other's error.
void add_products(const HalfResult& half, std::size_t i, Products& sums) {
  for (std::size_t c = 0; c < 3; ++c) {
    const double guide = half.filtered.guide[c][i];
    const double scale = 1 / (guide * guide + static_cast<double>(FilterParameters::kErrorFloor));
    const double raw_a = half.raw.a[c][i], raw_b = half.raw.b[c][i];
    const double handicap =
        FilterParameters::kRawAdvantage * 0.25 * ((raw_a - raw_b) * (raw_a - raw_b));
    double first[kCandidates], second[kCandidates], spread[kCandidates];
    for (int k = 0; k < kCandidates; ++k) {
      const StreamPair& pair = candidate(half, k);
      const double a = pair.a[c][i], b = pair.b[c][i];
      first[k] = a - raw_b;
      second[k] = b - raw_a;
      spread[k] = a - b;
    }
    std::size_t to = 0;
    for (int k = 0; k < kCandidates; ++k) {
      for (int l = 0; l <= k; ++l) {
        sums[to++] += (0.5 * (first[k] * first[l] + second[k] * second[l]) -
                       0.25 * (spread[k] * spread[l]) + (l > 0 ? handicap : 0)) *
                      scale;
      }
    }
  }
}

/// The products of each cell.
std::vector<Products> cell_products(const HalfResult& half, const Half& input, const Place& place,
                                    const Choice& cells) {
  std::vector<Products> sums(at(cells.columns) * at(cells.rows), Products{});
  for (std::int32_t row = 0; row < cells.rows * kDenoiseCell; ++row) {
    for (std::int32_t column = 0; column < cells.columns * kDenoiseCell; ++column) {
      const std::size_t i = place.index(column - kChoiceMargin, row - kChoiceMargin);
      if (input.valid[i] == 0) continue;
      add_products(half, i,
                   sums[at(row / kDenoiseCell) * at(cells.columns) + at(column / kDenoiseCell)]);
    }
  }
  return sums;
}

/// Sum of the products of the cells around one, near ones counting more.
Products pooled_products(const std::vector<Products>& all, const Choice& cells, std::int32_t column,
                         std::int32_t row) {
  constexpr double kWeights[] = {1, 2, 3, 2, 1};
  Products sum{};
  for (std::int32_t dy = -kPooledCells; dy <= kPooledCells; ++dy) {
    for (std::int32_t dx = -kPooledCells; dx <= kPooledCells; ++dx) {
      const Products& from = all[at(row + dy) * at(cells.columns) + at(column + dx)];
      for (int k = 0; k < kProducts; ++k)
        sum[at(k)] += kWeights[dy + kPooledCells] * kWeights[dx + kPooledCells] * from[at(k)];
    }
  }
  return sum;
}

/// Finds the shares, at least 0 and 1 in sum, with the least squared error.
class BestShares {
 public:
  explicit BestShares(const Products& products) : products_(products) {
    for (int k = 0; k < kCandidates; ++k) {
      double alone[kCandidates] = {};
      alone[k] = 1;
      consider(alone);
    }
    for (int k = 0; k < kCandidates; ++k) {
      for (int l = 0; l < k; ++l) consider_pair(k, l);
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
  double at(int k, int l) const { return product(products_, k, l); }

  void consider(const double (&shares)[kCandidates]) {
    double square = 0;
    for (int k = 0; k < kCandidates; ++k) {
      for (int l = 0; l < kCandidates; ++l) square += shares[k] * shares[l] * at(k, l);
    }
    if (has_best_ && !(square < least_)) return;
    has_best_ = true;
    least_ = square;
    std::copy_n(shares, kCandidates, best_);
  }

  /// The best mixture of two, unless one of them is better alone.
  void consider_pair(int k, int l) {
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

/// Chooses the shares with the least error over the cells around.
void choose(const Half& input, const Place& place, HalfResult& half) {
  Choice& cells = half.choice;
  const auto count = [](std::int32_t side) {
    return (side + kDenoiseCell - 1) / kDenoiseCell + 2 * kChoiceMargin / kDenoiseCell;
  };
  // Pixels to the right of and below the last whole cell are within the margin.
  cells.columns = count(place.tile_width);
  cells.rows = count(place.tile_height);
  const auto products = cell_products(half, input, place, cells);
  cells.shares.assign(at(cells.columns) * at(cells.rows), {1, 0, 0});
  for (std::int32_t row = kPooledCells; row < cells.rows - kPooledCells; ++row) {
    for (std::int32_t column = kPooledCells; column < cells.columns - kPooledCells; ++column) {
      cells.shares[at(row) * at(cells.columns) + at(column)] =
          BestShares(pooled_products(products, cells, column, row)).shares();
    }
  }
}

/// Shares of the four cells around a pixel: bilinear between their centres.
struct CellShares {
  std::int32_t column = 0, row = 0;  // first of two
  float across = 0, down = 0;        // share of the second

  CellShares(std::int32_t x, std::int32_t y) {
    constexpr std::int32_t kHalf = kDenoiseCell / 2;
    const std::int32_t from_x = x + kChoiceMargin - kHalf, from_y = y + kChoiceMargin - kHalf;
    column = from_x / kDenoiseCell;
    row = from_y / kDenoiseCell;
    across = (static_cast<float>(from_x % kDenoiseCell) + 0.5f) * (1.0f / kDenoiseCell);
    down = (static_cast<float>(from_y % kDenoiseCell) + 0.5f) * (1.0f / kDenoiseCell);
  }
};

/// Weighted sum of the candidates at a pixel.
float blended_colour(const HalfResult& half, const float (&weights)[kCandidates], std::size_t c,
                     std::size_t i) {
  float sum = 0;
  for (int k = 0; k < kCandidates; ++k) {
    const StreamPair& pair = candidate(half, k);
    sum += weights[k] * (0.5f * (pair.a[c][i] + pair.b[c][i]));
  }
  return sum;
}

/// Blends the chosen candidates.
void blend(const Place& place, HalfResult& half) {
  for (Plane& plane : half.colour) plane.resize(half.raw.a[0].size());
  for (std::int32_t y = -kBlurMargin; y < place.tile_height + kBlurMargin; ++y) {
    for (std::int32_t x = -kBlurMargin; x < place.tile_width + kBlurMargin; ++x) {
      const CellShares shares(x, y);
      float weights[kCandidates] = {};
      for (int k = 0; k < 4; ++k) {
        const bool right = k % 2 != 0, lower = k / 2 != 0;
        const Shares& of =
            half.choice.of(shares.column + (right ? 1 : 0), shares.row + (lower ? 1 : 0));
        const float share =
            (right ? shares.across : 1 - shares.across) * (lower ? shares.down : 1 - shares.down);
        for (std::size_t j = 0; j < of.size(); ++j) weights[j] += share * of[j];
      }
      const std::size_t i = place.index(x, y);
      for (std::size_t c = 0; c < 3; ++c) half.colour[c][i] = blended_colour(half, weights, c, i);
    }
  }
}

HalfResult denoise_half(const DenoiseRows& rows, const Place& place, std::size_t first_stream) {
  Half input = load(rows, place, first_stream);
  HalfResult half;
  half.filtered = filter_half(input);
  half.raw = std::move(input.streams);
  choose(input, place, half);
  blend(place, half);
  return half;
}

/// The scale of a pixel's relative error: its value, but at most the mean around it, so that a
/// bright outlier is not measured against itself.
double reference_value(const HalfResult (&halves)[2], std::size_t c, std::size_t i,
                       std::size_t width) {
  const auto value = [&](std::size_t k) {
    return std::fabs(0.5 * (static_cast<double>(halves[0].colour[c][k]) + halves[1].colour[c][k]));
  };
  double sum = 0;
  for (std::size_t row = 0; row < 2 * kBlurMargin + 1; ++row) {
    const std::size_t first = i + row * width - kBlurMargin * width - kBlurMargin;
    for (std::size_t column = 0; column < 2 * kBlurMargin + 1; ++column)
      sum += value(first + column);
  }
  return std::min(value(i), sum / ((2 * kBlurMargin + 1) * (2 * kBlurMargin + 1)));
}

/// Adds the estimated error of a pixel.
void add_error(const HalfResult (&halves)[2], std::size_t i, std::size_t width, DenoiseSums& sums) {
  double scaled = 0, first = 0, second = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    const double reference = reference_value(halves, c, i, width);
    const double scale =
        1 / (reference * reference + static_cast<double>(FilterParameters::kErrorFloor));
    const double d0 = halves[0].colour[c][i], d1 = halves[1].colour[c][i];
    const StreamPair &own = halves[0].raw, &other = halves[1].raw;
    const double t0 = (d0 - other.a[c][i]) * (d0 - other.b[c][i]) * scale;
    const double t1 = (d1 - own.a[c][i]) * (d1 - own.b[c][i]) * scale;
    first += t0;
    second += t1;
    scaled += 0.5 * (t0 + t1) - 0.25 * ((d0 - d1) * (d0 - d1)) * scale;
  }
  const double magnitude = std::fabs(0.5 * (first + second));
  ++sums.pixels;
  sums.scaled += scaled;
  sums.spread += 0.5 * (first * first + second * second);
  sums.magnitude += magnitude;
  sums.magnitude_squares += magnitude * magnitude;
}

/// Whether all cells that a pixel is blended from are raw.
bool is_raw(const HalfResult (&halves)[2], std::int32_t x, std::int32_t y) {
  const CellShares shares(x, y);
  for (const HalfResult& half : halves) {
    for (int k = 0; k < 4; ++k) {
      if (half.choice.of(shares.column + k % 2, shares.row + k / 2)[0] != 1) return false;
    }
  }
  return true;
}

void count_cells(const HalfResult (&halves)[2], const Place& place, DenoiseSums& sums) {
  constexpr std::int32_t kFirst = kChoiceMargin / kDenoiseCell;
  for (std::int32_t y = 0; y < place.tile_height; y += kDenoiseCell) {
    for (std::int32_t x = 0; x < place.tile_width; x += kDenoiseCell) {
      const std::int32_t column = kFirst + x / kDenoiseCell, row = kFirst + y / kDenoiseCell;
      const bool raw =
          halves[0].choice.of(column, row)[0] == 1 && halves[1].choice.of(column, row)[0] == 1;
      ++sums.cells;
      sums.raw_cells += raw ? 1 : 0;
    }
  }
}

}  // namespace

void DenoiseSums::add(const DenoiseSums& other) {
  pixels += other.pixels;
  scaled += other.scaled;
  spread += other.spread;
  magnitude += other.magnitude;
  magnitude_squares += other.magnitude_squares;
  cells += other.cells;
  raw_cells += other.raw_cells;
}

DenoisedError denoised_error(const DenoiseSums& sums, double quantile) {
  DenoisedError error;
  if (sums.pixels == 0) return error;
  const double terms = 3 * static_cast<double>(sums.pixels);
  const double upper = sums.scaled + quantile * std::sqrt(sums.spread);
  error.error = std::sqrt(std::max(sums.scaled, 0.0) / terms);
  error.error_upper95 = std::sqrt(std::max(upper, 0.0) / terms);
  if (sums.magnitude_squares > 0) {
    error.n_eff = sums.magnitude * sums.magnitude / sums.magnitude_squares;
  }
  error.raw_share = static_cast<double>(sums.raw_cells) / static_cast<double>(sums.cells);
  return error;
}

DenoisedTile denoise_tile(const DenoiseRows& rows, std::int32_t x, std::int32_t y) {
  const Place place = place_of(rows, x, y);
  const HalfResult halves[2] = {denoise_half(rows, place, 0), denoise_half(rows, place, 2)};
  const auto scale = static_cast<float>(rows.mean_luminance);
  DenoisedTile tile;
  tile.width = place.tile_width;
  tile.height = place.tile_height;
  const std::size_t pixels = at(tile.width) * at(tile.height);
  for (std::vector<float>& plane : tile.rgb) plane.reserve(pixels);
  tile.is_raw.reserve(pixels);
  for (std::int32_t row = 0; row < tile.height; ++row) {
    for (std::int32_t column = 0; column < tile.width; ++column) {
      const std::size_t i = place.index(column, row);
      tile.is_raw.push_back(is_raw(halves, column, row) ? 1 : 0);
      for (std::size_t c = 0; c < 3; ++c) {
        tile.rgb[c].push_back(0.5f * (halves[0].colour[c][i] + halves[1].colour[c][i]) * scale);
      }
      add_error(halves, i, at(place.width), tile.sums);
    }
  }
  count_cells(halves, place, tile.sums);
  return tile;
}

}  // namespace tessera::image
