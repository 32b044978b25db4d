#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/render_settings.h"

namespace CLI {
class App;
}

namespace tessera::client {

/// The render options as typed: what `render` and `submit` share.
struct RenderOptions {
  std::string scene, reference;
  std::string size = "1280x720", crop, frames = "0", background, filter = "box";
  std::string camera, animation, variant, environment;
  std::vector<std::string> aovs;
  int scene_index = -1;
  double fps = 24;
  int spp = 64, max_spp = 16384, max_depth = 16, tile = 64;
  double error = 0;  // asked for; 0: spp samples everywhere
  std::int64_t seed = 0;
  double filter_width = 0;  // 0: the filter's own
  double environment_rotation = 0, environment_strength = 1;
  bool half = false, cull_backfaces = false;
  double exposure = 0;  // stops; PNG and JPEG only
  double clamp = 0;
};

/// Adds SCENE and the render options to a command. Bad values are CLI11 errors that name the
/// option.
void add_render_options(CLI::App& command, RenderOptions& options);

/// The settings they stand for. `environment_uri`: the manifest's name of the sky, if there is one.
///
/// Errors: InvalidArgument naming the option.
absl::StatusOr<contract::RenderSettings> settings_of(const RenderOptions& options,
                                                     const std::string& environment_uri);

/// "1280x720". Errors: InvalidArgument.
absl::Status parse_size(const std::string& text, std::int32_t& width, std::int32_t& height);
/// "X,Y,W,H". Errors: InvalidArgument.
absl::StatusOr<contract::PixelRect> parse_crop(const std::string& text);
/// "0", "1-10", "1-10x2", "1,4,9-12", ranges in the order given. Errors: InvalidArgument.
absl::StatusOr<std::vector<contract::FrameRange>> parse_frames(const std::string& text);
/// "none" or "R,G,B". Errors: InvalidArgument.
absl::Status parse_background(const std::string& text, contract::RenderSettings& settings);

}  // namespace tessera::client
