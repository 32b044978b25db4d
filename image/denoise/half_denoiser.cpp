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
template <std::size_t kCount>
class ChosenShares {
 public:
  /// `part` is relative to the window.
  ChosenShares(const RollingRows<Products<kCount>>& cells, const PixelRect& part) {
    const CellShares first(part.x, part.y), last(part.x + part.width - 1, part.y + part.height - 1);
    column_ = first.column;
    row_ = first.row;
    columns_ = last.column + 2 - column_;
    for (std::int32_t row = row_; row < last.row + 2; ++row) {
      for (std::int32_t column = column_; column < column_ + columns_; ++column)
        shares_.push_back(best_shares(cells, column, row));
    }
  }

  const Shares<kCount>& of(std::int32_t column, std::int32_t row) const {
    return shares_[static_cast<std::size_t>((row - row_) * columns_ + column - column_)];
  }

  /// Shares at a pixel of the window; and whether all cells that it is blended from are raw.
  std::pair<Shares<kCount>, bool> at(std::int32_t x, std::int32_t y) const {
    const CellShares cells(x, y);
    Shares<kCount> sum{};
    bool is_raw = true;
    for (int k = 0; k < 4; ++k) {
      const bool right = k % 2 != 0, lower = k / 2 != 0;
      const Shares<kCount>& shares =
          of(cells.column + (right ? 1 : 0), cells.row + (lower ? 1 : 0));
      const float share =
          (right ? cells.across : 1 - cells.across) * (lower ? cells.down : 1 - cells.down);
      for (std::size_t j = 0; j < kCount; ++j) sum[j] += share * shares[j];
      is_raw = is_raw && shares[0] == 1;
    }
    return {sum, is_raw};
  }

 private:
  std::int32_t column_ = 0, row_ = 0, columns_ = 0;
  std::vector<Shares<kCount>> shares_;
};

}  // namespace

HalfDenoiser::HalfDenoiser(std::size_t index, const DenoiseFrame& frame, const PixelRect& window,
                           const AnimationInput* animation)
    : index_(index),
      frame_(frame),
      window_(window),
      animation_(animation),
      left_(window.x - kDenoiseMargin),
      guide_(left_, std::max(window.y - kGuideStage.reach, -kGuideStage.beyond),
             window.width + 2 * kDenoiseMargin),
      cells_((window.width + kDenoiseCell - 1) / kDenoiseCell + 2 * kReach / kDenoiseCell, 0),
      fused_cells_(cells_.width(), 0) {
  const Rows rows(window.width + 2 * kDenoiseMargin,
                  std::max(window.y - kCandidateStage.reach, -kCandidateStage.beyond));
  means_.assign(3 * (animation != nullptr ? kFusedCandidates : kCandidates), rows);
}

std::int32_t HalfDenoiser::stage_end(const FilterStage& stage, std::int32_t end) const {
  return std::min(end + stage.reach, frame_.height + stage.beyond);
}

void HalfDenoiser::extend(std::int32_t end) {
  if (animation_ == nullptr) guide_.extend(stage_end(kGuideStage, end));
  for (Rows& rows : means_) rows.extend(stage_end(kCandidateStage, end));
  const std::int32_t cell_end =
      (end - window_.y + kDenoiseCell - 1) / kDenoiseCell + 2 * kReach / kDenoiseCell;
  if (animation_ == nullptr) {
    cells_.extend(cell_end);
  } else {
    fused_cells_.extend(cell_end);
  }
}

void HalfDenoiser::add_guide(const FrameInput& input, const PixelRect& part) {
  guide_.add(input, index_, part);
}

void HalfDenoiser::add_candidates(const FrameInput& input, const PixelRect& part) {
  const Half half = input.half(index_, part);
  const PixelRect bordered{part.x - kHalfMargin, part.y - kHalfMargin, half.width, half.height};
  const GuideRows& rows = animation_ == nullptr ? guide_ : animation_->frame.guides[index_];
  const Guide guide = rows.cut(bordered);
  const Candidates candidates = filter_candidates(half, guide);
  put_means(half.streams, half, 0, part);
  put_means(candidates.zero_order, half, 1, part);
  put_means(candidates.first_order, half, 2, part);
  if (animation_ == nullptr) {
    add_cells<kCandidates>(half, guide,
                           {&half.streams, &candidates.zero_order, &candidates.first_order}, part,
                           cells_);
  } else {
    add_fused(half, guide, candidates, part);
  }
}

/// Adds the candidates of the fused frame.
void HalfDenoiser::add_fused(const Half& half, const Guide& guide, const Candidates& alone,
                             const PixelRect& part) {
  const DenoiseRows rows = animation_->fused.rows();
  const Half fused = FrameInput(frame_, rows).half(index_, part);
  const PixelRect bordered{part.x - kHalfMargin, part.y - kHalfMargin, half.width, half.height};
  const Candidates candidates =
      filter_candidates(fused, animation_->fused.guides[index_].cut(bordered));
  put_means(fused.streams, half, 3, part);
  put_means(candidates.zero_order, half, 4, part);
  put_means(candidates.first_order, half, 5, part);
  add_cells<kFusedCandidates>(half, guide,
                              {&half.streams, &alone.zero_order, &alone.first_order, &fused.streams,
                               &candidates.zero_order, &candidates.first_order},
                              part, fused_cells_);
}

void HalfDenoiser::put_means(const StreamPair& pair, const Half& half, std::size_t candidate,
                             const PixelRect& part) {
  for (std::size_t c = 0; c < 3; ++c) {
    const float *a = pair.a[c].data(), *b = pair.b[c].data();
    Rows& rows = means_[3 * candidate + c];
    for (std::int32_t row = 0; row < part.height; ++row) {
      std::size_t i = half.inside(row);
      float* to = rows.row(part.y + row) + (part.x - left_);
      for (std::int32_t column = 0; column < part.width; ++column, ++i)
        to[column] = 0.5f * (a[i] + b[i]);
    }
  }
}

template <std::size_t kCount>
void HalfDenoiser::add_cells(const Half& half, const Guide& guide,
                             const CandidatePairs<kCount>& pairs, const PixelRect& part,
                             CellRows<kCount>& to) {
  const std::int32_t left = window_.x - kReach, top = window_.y - kReach;
  for (std::int32_t row = 0; row < part.height; ++row) {
    const std::int32_t y = part.y + row;
    Products<kCount>* cells = to.row((y - top) / kDenoiseCell);
    std::size_t i = half.inside(row);
    for (std::int32_t x = part.x; x < part.x + part.width; ++x, ++i) {
      if (half.valid[i] != 0)
        add_products<kCount>(pairs, guide.colour, i, cells[(x - left) / kDenoiseCell]);
    }
  }
}

BlendedHalf HalfDenoiser::blend(const FrameInput& input, const PixelRect& part) const {
  return animation_ == nullptr ? blend_cells<kCandidates>(input, part, cells_)
                               : blend_cells<kFusedCandidates>(input, part, fused_cells_);
}

template <std::size_t kCount>
BlendedHalf HalfDenoiser::blend_cells(const FrameInput& input, const PixelRect& part,
                                      const CellRows<kCount>& cells) const {
  constexpr std::size_t kMeans = 3 * kCount;
  const PixelRect area = enlarged(part, kBlurMargin);
  const std::int32_t x0 = area.x - window_.x, y0 = area.y - window_.y;
  const ChosenShares<kCount> chosen(cells, {x0, y0, area.width, area.height});
  BlendedHalf half;
  half.width = area.width;
  half.height = area.height;
  half.raw = input.streams(index_, area);
  for (Plane& plane : half.colour) plane.resize(pixels_of(area));
  std::size_t i = 0;
  for (std::int32_t row = 0; row < area.height; ++row) {
    const float* means[kMeans];
    for (std::size_t k = 0; k < kMeans; ++k)
      means[k] = means_[k].row(area.y + row) + (area.x - left_);
    for (std::int32_t column = 0; column < area.width; ++column, ++i) {
      const auto [shares, is_raw] = chosen.at(x0 + column, y0 + row);
      bool has_spike = false;
      for (std::size_t c = 0; c < 3; ++c) {
        float sum = 0;
        for (std::size_t k = 0; k < kCount; ++k) sum += shares[k] * means[3 * k + c][column];
        half.colour[c][i] = sum;
        has_spike = has_spike || means[c][column] != 0.5f * (half.raw.a[c][i] + half.raw.b[c][i]);
      }
      half.is_raw.push_back(is_raw && !has_spike ? 1 : 0);
    }
  }
  for (std::int32_t y = kReach; y < part.height + kReach; y += kDenoiseCell) {
    for (std::int32_t x = kReach; x < part.width + kReach; x += kDenoiseCell) {
      const Shares<kCount>& shares = chosen.of((part.x - window_.x + x) / kDenoiseCell,
                                               (part.y - window_.y + y) / kDenoiseCell);
      half.is_raw_cell.push_back(shares[0] == 1 ? 1 : 0);
    }
  }
  return half;
}

void HalfDenoiser::drop(std::int32_t begin) {
  if (animation_ == nullptr) guide_.drop(begin + kReach - kHalfMargin);
  for (Rows& rows : means_) rows.drop(begin - kBlurMargin);
  cells_.drop((begin - window_.y) / kDenoiseCell);
  fused_cells_.drop((begin - window_.y) / kDenoiseCell);
}

}  // namespace tessera::image
