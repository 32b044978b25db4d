#pragma once

#include <array>

namespace tessera::image {

/// Channels that denoising needs, for each of the four replicates r: "denoising.r.NAME". R, G, B
/// are means of the replicate's samples; albedo and normal are means too, 0 for samples that hit
/// nothing; depth is the mean over hits and `hits` the share of samples that hit something.
inline constexpr char kDenoisingPrefix[] = "denoising.";
inline constexpr std::array<const char*, 11> kDenoisingChannels = {
    "R",        "G",        "B",        "albedo.R", "albedo.G", "albedo.B",
    "normal.X", "normal.Y", "normal.Z", "depth.Z",  "hits"};

/// Channels of the motion layer: pixels to the right and up from where the surface that a pixel
/// shows is in the frame to where it is in the previous frame (backward), and in the next one
/// (forward). The names are Nuke's.
inline constexpr std::array<const char*, 4> kMotionChannels = {"backward.u", "backward.v",
                                                               "forward.u", "forward.v"};

/// Attribute of files with these channels: m, the frame's mean luminance after the first pass.
inline constexpr char kMeanLuminanceAttribute[] = "tessera:meanLuminance";

}  // namespace tessera::image
