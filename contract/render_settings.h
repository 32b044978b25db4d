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
};

/// What is behind everything, as seen by camera rays.
enum class Background : std::uint8_t {
  automatic,  // the environment if there is one, else none
  none,       // RGB 0, alpha 0
  color,      // RenderSettings::background_color
};

/// Everything that, with the scene's bytes, decides the pixels of a job (design.md, section 4).
/// Plain data; `settings_message.h` takes it to and from the wire and checks ranges.
struct RenderSettings {
  std::int32_t width = 1280, height = 720;  // full frame, pixels, each in [1, 65536]
  std::optional<PixelRect> crop;            // within the frame; pixels keep their coordinates
  std::string camera;                       // name or index; empty: the scene's first, or framed
  std::int32_t scene = -1;                  // glTF scene index; -1: the file's default
  std::vector<FrameRange> frames = {{0, 0, 1}};
  double fps = 24;
  std::string animation;        // name, index, "all" or "none"; empty: the first
  std::string variant;          // KHR_materials_variants name; empty: default
  std::int32_t spp = 64;        // asked for, or the most with `error`; rendered: rounded_spp()
  std::optional<double> error;  // upper bound of the error asked for, (0, 1]; see StoppingRule
  std::int32_t max_depth = 16;  // scattering events, [1, 255]
  std::uint32_t seed = 0;
  std::int32_t tile = 64;  // side in pixels, a power of two in [8, 256]
  PixelFilter filter = PixelFilter::box;
  double filter_width = 1;          // full support in pixels
  std::string environment;          // manifest URI of the sky; empty: none
  double environment_rotation = 0;  // degrees about +Y
  double environment_strength = 1;
  Background background = Background::automatic;
  std::array<float, 3> background_color = {0, 0, 0};  // linear Rec. 709
  std::uint32_t aovs = 0;                             // Aov bits
  bool half = false;  // EXR of half floats; does not change pixels_sha256
  double clamp = 0;   // largest sample radiance per channel; 0: off
  bool cull_backfaces = false;

  /// The part of the frame that is rendered.
  PixelRect window() const { return crop.value_or(PixelRect{0, 0, width, height}); }
};

/// All frames of `ranges` in order, without repeats.
std::vector<std::int32_t> frame_list(const std::vector<FrameRange>& ranges);

/// Number of frames in `ranges` counted with repeats; no allocation, no overflow.
std::int64_t frame_count(const std::vector<FrameRange>& ranges);

}  // namespace tessera::contract
