#pragma once

#include <array>
#include <vector>

#include "image/denoise/frames/frame_input.h"
#include "image/denoise/frames/guide_rows.h"

namespace tessera::image {

/// A frame of an animation with the guides of both halves.
struct AnimationFrame {
  DenoiseFrame frame;
  DenoiseRows rows;  // all rows of the frame
  /// Channels of kMotionChannels, row by row: pixels to the right and up from where the surface is
  /// in this frame to where it is in the previous and in the next one.
  std::array<const float*, 4> motion{};
  std::array<GuideRows, 2> guides;
};

/// Computes the guides of a frame.
void find_guides(AnimationFrame& frame, int threads);

/// A frame whose replicates are means over several frames. Replicate r has samples of replicates r
/// only.
struct FusedFrame {
  std::array<std::vector<float>, kDenoiseInputs> planes;
  std::array<GuideRows, 2> guides;

  DenoiseRows rows() const;
};

/// A frame with its guides, and the same fused with its neighbours. Input of a denoiser, which both
/// must outlive.
struct AnimationInput {
  const AnimationFrame& frame;
  const FusedFrame& fused;
};

/// Adds to each pixel of `frame` the pixels of the previous and the next frame that show the same
/// point of a surface, at most with the weight of the pixel itself. A neighbour's pixel counts less
/// the more its guide differs from that of `frame`, relative to the noise of both, in the 3 x 3
/// pixels around it, so that changes of light or of reflections leave no ghosts; and by albedo and
/// normal. It does not count if its own motion does not lead back, because something else is in
/// front then. `before` and `after` may be null. `threads` changes the time only.
FusedFrame fuse_frames(const AnimationFrame& frame, const AnimationFrame* before,
                       const AnimationFrame* after, int threads);

}  // namespace tessera::image
