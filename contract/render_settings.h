#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace tessera::contract {

/// Half-open pixel rectangle in full-frame coordinates, origin top left.
struct PixelRect {
  std::int32_t x = 0, y = 0, width = 0, height = 0;
  bool operator==(const PixelRect&) const = default;
};

enum class PixelFilter : std::uint8_t { box, gaussian, blackman_harris };

/// Frames first, first + step, … up to and including last. Requires step >= 1, first <= last.
struct FrameRange {
  std::int32_t first = 0, last = 0, step = 1;
  bool operator==(const FrameRange&) const = default;
};

/// Additional output layers. Bits of RenderSettings::aovs.
enum Aov : std::uint32_t {
  kAovAlbedo = 1u << 0,    // additive, over hits
  kAovNormal = 1u << 1,    // additive, world space, over hits
  kAovDepth = 1u << 2,     // camera-space -z of sample 0, metres
  kAovPosition = 1u << 3,  // world space of sample 0, metres
  kAovIds = 1u << 4,       // node, material, primitive of sample 0, plus 1; 0 is a miss
  kAovSamples = 1u << 5,   // samples kept per pixel
  kAovStdError = 1u << 6,  // standard error of R, G, B from the replicates
  // Additive: rays, nodes visited and primitives tested of the sample's path and its shadow rays
  kAovTraversalCost = 1u << 7,
  // Input of the denoiser: mean, albedo, normal and depth of each replicate
  kAovDenoising = 1u << 8,
  // Pixels by which the surface of sample 0 moves from the previous frame and to the next one
  kAovMotion = 1u << 9,
};

/// Background seen by camera rays that leave the scene.
enum class Background : std::uint8_t {
  automatic,  // the environment map if there is one, else none
  none,       // RGB 0, alpha 0
  color,      // RenderSettings::background_color
};

/// Everything besides the scene's files that determines the pixels of a job
/// (docs/explanation/determinism.md). rpc/settings_message.h converts it to and from messages and
/// checks ranges.
struct RenderSettings {
  std::int32_t width = 1280, height = 720;  // full frame, pixels, each in [1, 65536]
  std::optional<PixelRect> crop;            // within the frame; pixels keep their coordinates
  std::string camera;       // name or index; empty: the scene's first, else one that frames it
  std::int32_t scene = -1;  // glTF scene index; -1: the file's default
  std::vector<FrameRange> frames = {{0, 0, 1}};
  double fps = 24;
  std::string animation;        // name, index, "all" or "none"; empty: the first
  std::string variant;          // KHR_materials_variants name; empty: default
  std::int32_t spp = 64;        // samples per pixel; with `error` the maximum. See rounded_spp()
  std::optional<double> error;  // target error in (0, 1]; see StoppingRule
  std::int32_t max_depth = 16;  // scattering events, [1, 255]
  std::uint32_t seed = 0;
  std::int32_t tile = 64;  // side in pixels, a power of two in [8, 256]
  PixelFilter filter = PixelFilter::box;
  double filter_width = 1;          // full support in pixels
  std::string environment;          // manifest URI of the environment map; empty: none
  double environment_rotation = 0;  // degrees about +Y
  double environment_strength = 1;
  Background background = Background::automatic;
  std::array<float, 3> background_color = {0, 0, 0};  // linear Rec. 709
  std::uint32_t aovs = 0;                             // Aov bits
  /// R, G, B of the output are denoised, and its kAovDenoising layers are replaced by the raw
  /// image, its variance and the features. Implies kAovDenoising; does not change samples.
  bool denoise = false;
  bool half = false;  // EXR of half floats; does not change pixels_sha256
  double clamp = 0;   // maximum radiance per sample and channel; 0: off
  bool cull_backfaces = false;
  /// Paths follow the directions of photons as well as the BSDF. Changes the noise, not the
  /// expected image. Unset: if the job has a target error. See is_guided().
  std::optional<bool> guiding;
  /// Acceleration structure: one of kStructureNames, or empty for the production BVH. Pixels do not
  /// depend on it.
  std::string accelerator;

  /// Returns whether frames are guided if they gain from it.
  bool is_guided() const { return guiding.value_or(error.has_value()); }

  /// Returns the part of the frame that is rendered.
  PixelRect window() const { return crop.value_or(PixelRect{0, 0, width, height}); }
};

/// Returns all frames of `ranges` in ascending order without duplicates.
std::vector<std::int32_t> frame_list(const std::vector<FrameRange>& ranges);

/// Returns the number of frames in `ranges`, duplicates included. Does not allocate or overflow.
std::int64_t frame_count(const std::vector<FrameRange>& ranges);

}  // namespace tessera::contract
