#include "image/denoise/half_denoiser.h"

#include <algorithm>
#include <utility>

namespace tessera::image {
namespace {

using contract::PixelRect;
using Rows = RollingRows<float>;
constexpr std::int32_t kReach = kCandidateStage.reach;

std::size_t pixels_of(const PixelRect& part) {
  return static_cast<std::size_t>(part.width) * static_cast<std::size_t>(part.height);
}

PixelRect enlarged(const PixelRect& part, std::int32_t margin) {
  return {part.x - margin, part.y - margin, part.width + 2 * margin, part.height + 2 * margin};
}

/// Copies a part of rows that begin at x = `left`; pixels that they do not have are 0.
Plane cut(const Rows& from, std::int32_t left, const PixelRect& part) {
  Plane out(pixels_of(part));
  const std::int32_t begin = std::clamp(left - part.x, 0, part.width);
  const std::int32_t end = std::clamp(left + from.width() - part.x, begin, part.width);
  float* to = out.data();
  for (std::int32_t y = part.y; y < part.y + part.height; ++y, to += part.width) {
    if (y < from.begin() || y >= from.end()) continue;
    const float* row = from.row(y) + (part.x - left);
    std::copy(row + begin, row + end, to + begin);
  }
  return out;
}

/// Index in a half of the first pixel of a row inside the border.
std::size_t inside(const Half& half, std::int32_t row) {
  return static_cast<std::size_t>(row + kHalfMargin) * static_cast<std::size_t>(half.width) +
         static_cast<std::size_t>(kHalfMargin);
}

/// Shares of the four cells around a pixel of the window: bilinear between their centres.
struct CellShares {
  std::int32_t column = 0, row = 0;  // first of two
  float across = 0, down = 0;        // share of the second

  CellShares(std::int32_t x, std::int32_t y) {
    constexpr std::int32_t kHalf = kDenoiseCell / 2;
    const std::int32_t from_x = x + kReach - kHalf, from_y = y + kReach - kHalf;
    column = from_x / kDenoiseCell;
    row = from_y / kDenoiseCell;
    across = (static_cast<float>(from_x % kDenoiseCell) + 0.5f) * (1.0f / kDenoiseCell);
    down = (static_cast<float>(from_y % kDenoiseCell) + 0.5f) * (1.0f / kDenoiseCell);
  }
};

/// Shares of the candidates in the cells that some pixels are blended from.
class ChosenShares {
 public:
  /// `part` is relative to the window.
  ChosenShares(const RollingRows<Products>& cells, const PixelRect& part) {
    const CellShares first(part.x, part.y), last(part.x + part.width - 1, part.y + part.height - 1);
    column_ = first.column;
    row_ = first.row;
    columns_ = last.column + 2 - column_;
    for (std::int32_t row = row_; row < last.row + 2; ++row) {
      for (std::int32_t column = column_; column < column_ + columns_; ++column)
        shares_.push_back(best_shares(cells, column, row));
    }
  }

  const Shares& of(std::int32_t column, std::int32_t row) const {
    return shares_[static_cast<std::size_t>((row - row_) * columns_ + column - column_)];
  }

  /// Shares at a pixel of the window; and whether all cells that it is blended from are raw.
  std::pair<Shares, bool> at(std::int32_t x, std::int32_t y) const {
    const CellShares cells(x, y);
    Shares sum{};
    bool is_raw = true;
    for (int k = 0; k < 4; ++k) {
      const bool right = k % 2 != 0, lower = k / 2 != 0;
      const Shares& shares = of(cells.column + (right ? 1 : 0), cells.row + (lower ? 1 : 0));
      const float share =
          (right ? cells.across : 1 - cells.across) * (lower ? cells.down : 1 - cells.down);
      for (std::size_t j = 0; j < kCandidates; ++j) sum[j] += share * shares[j];
      is_raw = is_raw && shares[0] == 1;
    }
    return {sum, is_raw};
  }

 private:
  std::int32_t column_ = 0, row_ = 0, columns_ = 0;
  std::vector<Shares> shares_;
};

}  // namespace

HalfDenoiser::HalfDenoiser(std::size_t index, const DenoiseFrame& frame, const PixelRect& window)
    : index_(index),
      frame_height_(frame.height),
      window_(window),
      left_(window.x - kDenoiseMargin),
      cells_((window.width + kDenoiseCell - 1) / kDenoiseCell + 2 * kReach / kDenoiseCell, 0) {
  const auto rows = [&](const FilterStage& stage) {
    return Rows(window.width + 2 * kDenoiseMargin, std::max(window.y - stage.reach, -stage.beyond));
  };
  guide_.assign(4, rows(kGuideStage));
  means_.assign(6, rows(kCandidateStage));
}

std::int32_t HalfDenoiser::stage_end(const FilterStage& stage, std::int32_t end) const {
  return std::min(end + stage.reach, frame_height_ + stage.beyond);
}

void HalfDenoiser::extend(std::int32_t end) {
  for (Rows& rows : guide_) rows.extend(stage_end(kGuideStage, end));
  for (Rows& rows : means_) rows.extend(stage_end(kCandidateStage, end));
  cells_.extend((end - window_.y + kDenoiseCell - 1) / kDenoiseCell + 2 * kReach / kDenoiseCell);
}

void HalfDenoiser::add_guide(const FrameInput& input, const PixelRect& part) {
  const Half half = input.half(index_, part);
  const Guide guide = filter_guide(half);
  for (std::int32_t row = 0; row < part.height; ++row) {
    const std::size_t from = inside(half, row);
    for (std::size_t k = 0; k < guide_.size(); ++k) {
      const Plane& plane = k < 3 ? guide.colour[k] : guide.variance;
      std::copy_n(plane.data() + from, part.width, guide_[k].row(part.y + row) + (part.x - left_));
    }
  }
}

void HalfDenoiser::add_candidates(const FrameInput& input, const PixelRect& part) {
  const Half half = input.half(index_, part);
  const PixelRect bordered{part.x - kHalfMargin, part.y - kHalfMargin, half.width, half.height};
  Guide guide;
  for (std::size_t c = 0; c < 3; ++c) guide.colour[c] = cut(guide_[c], left_, bordered);
  guide.variance = cut(guide_[3], left_, bordered);
  const Candidates candidates = filter_candidates(half, guide);
  add_cells(half, guide, candidates, part);
  for (std::size_t k = 0; k < means_.size(); ++k) {
    const StreamPair& pair = k < 3 ? candidates.zero_order : candidates.first_order;
    const float *a = pair.a[k % 3].data(), *b = pair.b[k % 3].data();
    for (std::int32_t row = 0; row < part.height; ++row) {
      std::size_t i = inside(half, row);
      float* to = means_[k].row(part.y + row) + (part.x - left_);
      for (std::int32_t column = 0; column < part.width; ++column, ++i)
        to[column] = 0.5f * (a[i] + b[i]);
    }
  }
}

void HalfDenoiser::add_cells(const Half& half, const Guide& guide, const Candidates& candidates,
                             const PixelRect& part) {
  const CandidatePairs pairs{&half.streams, &candidates.zero_order, &candidates.first_order};
  const std::int32_t left = window_.x - kReach, top = window_.y - kReach;
  for (std::int32_t row = 0; row < part.height; ++row) {
    const std::int32_t y = part.y + row;
    Products* cells = cells_.row((y - top) / kDenoiseCell);
    std::size_t i = inside(half, row);
    for (std::int32_t x = part.x; x < part.x + part.width; ++x, ++i) {
      if (half.valid[i] != 0)
        add_products(pairs, guide.colour, i, cells[(x - left) / kDenoiseCell]);
    }
  }
}

BlendedHalf HalfDenoiser::blend(const FrameInput& input, const PixelRect& part) const {
  const PixelRect area = enlarged(part, kBlurMargin);
  const std::int32_t x0 = area.x - window_.x, y0 = area.y - window_.y;
  const ChosenShares chosen(cells_, {x0, y0, area.width, area.height});
  BlendedHalf half;
  half.width = area.width;
  half.height = area.height;
  half.raw = input.streams(index_, area);
  for (Plane& plane : half.colour) plane.resize(pixels_of(area));
  std::size_t i = 0;
  for (std::int32_t row = 0; row < area.height; ++row) {
    const float* means[6];
    for (std::size_t k = 0; k < 6; ++k) means[k] = means_[k].row(area.y + row) + (area.x - left_);
    for (std::int32_t column = 0; column < area.width; ++column, ++i) {
      const auto [shares, is_raw] = chosen.at(x0 + column, y0 + row);
      half.is_raw.push_back(is_raw ? 1 : 0);
      for (std::size_t c = 0; c < 3; ++c) {
        float sum = 0;
        sum += shares[0] * (0.5f * (half.raw.a[c][i] + half.raw.b[c][i]));
        sum += shares[1] * means[c][column];
        sum += shares[2] * means[3 + c][column];
        half.colour[c][i] = sum;
      }
    }
  }
  for (std::int32_t y = kReach; y < part.height + kReach; y += kDenoiseCell) {
    for (std::int32_t x = kReach; x < part.width + kReach; x += kDenoiseCell) {
      const Shares& shares = chosen.of((part.x - window_.x + x) / kDenoiseCell,
                                       (part.y - window_.y + y) / kDenoiseCell);
      half.is_raw_cell.push_back(shares[0] == 1 ? 1 : 0);
    }
  }
  return half;
}

void HalfDenoiser::drop(std::int32_t begin) {
  for (Rows& rows : guide_) rows.drop(begin + kReach - kHalfMargin);
  for (Rows& rows : means_) rows.drop(begin - kBlurMargin);
  cells_.drop((begin - window_.y) / kDenoiseCell);
}

}  // namespace tessera::image
