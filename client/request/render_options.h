#pragma once

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/render_settings.h"

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace tessera::client {

/// Options that `render` and `submit` share, as typed.
struct RenderOptions {
  std::string scene, reference;
  std::string size = "1280x720", crop, frames = "0", background, filter = "box";
  std::string camera, animation, variant, environment;
  std::vector<std::string> aovs;
  int scene_index = -1;
  double fps = 24;
  int spp = 64, max_spp = 16384, max_depth = 16, tile_size = 64;
  double error = 0;  // target error; 0: spp samples per pixel
  std::int64_t seed = 0;
  double filter_width = 0;  // pixels; 0: the default of the filter
  double environment_rotation = 0, environment_strength = 1;
  bool half = false, denoise = false, cull_backfaces = false;
  std::optional<bool> guiding;  // unset: with --error
  double clamp = 0;
  std::string accelerator;  // empty: the production BVH
};

/// Adds SCENE and the render options to a command. Invalid values are CLI11 errors that name the
/// option.
void add_render_options(CLI::App& command, RenderOptions& options);

/// Adds --accelerator NAME, which must be one of contract::kStructureNames.
CLI::Option* add_accelerator_option(CLI::App& command, std::string& accelerator);

/// Converts options to settings. `environment_uri`: URI of the environment map in the manifest, or
/// empty. Errors: InvalidArgument, naming the option.
absl::StatusOr<contract::RenderSettings> settings_of(const RenderOptions& options,
                                                     const std::string& environment_uri);

/// Parses "1280x720". Errors: InvalidArgument.
absl::Status parse_size(const std::string& text, std::int32_t& width, std::int32_t& height);
/// Parses "X,Y,W,H". Errors: InvalidArgument.
absl::StatusOr<contract::PixelRect> parse_crop(const std::string& text);
/// Parses "0", "1-10", "1-10x2" or "1,4,9-12"; keeps the order. Errors: InvalidArgument.
absl::StatusOr<std::vector<contract::FrameRange>> parse_frames(const std::string& text);
/// Parses "none" or "R,G,B" into `settings`. Errors: InvalidArgument.
absl::Status parse_background(const std::string& text, contract::RenderSettings& settings);

}  // namespace tessera::client
