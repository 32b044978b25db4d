#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "contract/render_settings.h"
#include "image/denoise/denoiser.h"
#include "image/denoise/filter/candidate_choice.h"
#include "image/denoise/filter/half_filter.h"
#include "image/denoise/filter/rolling_rows.h"
#include "image/denoise/filter/spike_limit.h"
#include "image/denoise/frames/frame_fusion.h"
#include "image/denoise/frames/frame_input.h"
#include "image/denoise/frames/guide_rows.h"

namespace tessera::image {

/// Side of the squares for which the filter is chosen.
constexpr std::int32_t kDenoiseCell = 4;
/// Pixels around a blended half where it is known too.
constexpr std::int32_t kBlurMargin = 2;

/// A filter's results are needed up to `reach` pixels around the window, but at most `beyond`
/// pixels beyond the frame.
struct FilterStage {
  std::int32_t reach, beyond;
};
/// The second filter: a pixel depends on the cells around it, which begin in the frame.
constexpr FilterStage kCandidateStage{(kPooledCells + 1) * kDenoiseCell, kBlurMargin};
/// The first filter: windows end at the frame; patches and noise reach 1 + 2 pixels further.
constexpr FilterStage kGuideStage{kCandidateStage.reach + kHalfMargin, kCandidateStage.beyond + 3};
static_assert(kGuideStage.reach + kHalfMargin + kSpikeMargin == kDenoiseMargin);
static_assert(kGuideStage.beyond == kGuideBeyond);

/// A denoised half in a part of the window with kBlurMargin pixels on each side.
struct BlendedHalf {
  std::int32_t width = 0, height = 0;  // with the margin
  StreamPair raw;
  ColourPlanes colour;
  std::vector<std::uint8_t> is_raw;       // whether all cells that a pixel is blended from are raw
  std::vector<std::uint8_t> is_raw_cell;  // of the cells inside the margin
};

/// Filters one half of the replicates in a window of a frame, from the top. Keeps the rows that
/// later ones depend on. Several threads can work on different parts of the same rows.
class HalfDenoiser {
 public:
  /// `index` is 0 or 1. With `animation`, the guide is the frame's, and the fused frame adds
  /// candidates; it may be null.
  HalfDenoiser(std::size_t index, const DenoiseFrame& frame, const contract::PixelRect& window,
               const AnimationInput* animation);

  /// Makes room for what the rows up to `end` of the window depend on.
  void extend(std::int32_t end);
  /// First filter of the pixels of `part`.
  void add_guide(const FrameInput& input, const contract::PixelRect& part);
  /// Second filter of the pixels of `part`. Requires the guide kHalfMargin pixels around it.
  void add_candidates(const FrameInput& input, const contract::PixelRect& part);
  /// Mixes the candidates. Requires them in a margin as wide as the reach of their stage.
  BlendedHalf blend(const FrameInput& input, const contract::PixelRect& part) const;
  /// Drops what the rows from `begin` on do not depend on.
  void drop(std::int32_t begin);

  /// End of the rows of a stage that the rows of the window up to `end` depend on.
  std::int32_t stage_end(const FilterStage& stage, std::int32_t end) const;

 private:
  /// Products of errors in each cell, from the candidates' reach above and left of the window.
  template <std::size_t kCount>
  using CellRows = RollingRows<Products<kCount>>;

  void add_fused(const Half& half, const Guide& guide, const Candidates& alone,
                 const contract::PixelRect& part);
  template <std::size_t kCount>
  void add_cells(const Half& half, const Guide& guide, const CandidatePairs<kCount>& pairs,
                 const contract::PixelRect& part, CellRows<kCount>& to);
  void put_means(const StreamPair& pair, const Half& half, std::size_t candidate,
                 const contract::PixelRect& part);
  template <std::size_t kCount>
  BlendedHalf blend_cells(const FrameInput& input, const contract::PixelRect& part,
                          const CellRows<kCount>& cells) const;

  const std::size_t index_;
  const DenoiseFrame frame_;
  const contract::PixelRect window_;
  const AnimationInput* const animation_;
  const std::int32_t left_;                 // x of the first pixel of the rows below
  GuideRows guide_;                         // unused with animation_
  std::vector<RollingRows<float>> means_;   // of both streams: R, G, B of the candidates
  CellRows<kCandidates> cells_;             // unused with animation_
  CellRows<kFusedCandidates> fused_cells_;  // unused without
};

}  // namespace tessera::image
