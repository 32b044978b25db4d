#include "client/request/render_options.h"

#include <CLI/CLI.hpp>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <string_view>

#include "absl/strings/str_cat.h"
#include "cli/finite_range.h"
#include "contract/structure_names.h"
#include "rpc/settings_message.h"

namespace tessera::client {
namespace {

absl::Status invalid(const char* option, const std::string& text, const char* form) {
  return absl::InvalidArgumentError(absl::StrCat("--", option, ": \"", text, "\" is not ", form));
}

/// Parses and removes a number at the start of `text`. Returns false if there is none.
template <typename T>
bool take_number(std::string_view& text, T& number) {
  const auto result = std::from_chars(text.data(), text.data() + text.size(), number);
  if (result.ec != std::errc()) return false;
  text.remove_prefix(static_cast<std::size_t>(result.ptr - text.data()));
  return true;
}

bool take_char(std::string_view& text, char c) {
  if (text.empty() || text.front() != c) return false;
  text.remove_prefix(1);
  return true;
}

/// A validator without a description, for options whose type_name() shows the form.
CLI::Validator checked(absl::Status (*check)(const std::string&)) {
  return {[check](const std::string& text) { return std::string(check(text).message()); }, ""};
}

absl::Status check_size(const std::string& text) {
  std::int32_t width = 0, height = 0;
  return parse_size(text, width, height);
}
absl::Status check_crop(const std::string& text) {
  return parse_crop(text).status();
}
absl::Status check_frames(const std::string& text) {
  return parse_frames(text).status();
}
absl::Status check_background(const std::string& text) {
  contract::RenderSettings settings;
  return parse_background(text, settings);
}

void add_view_options(CLI::App& command, RenderOptions& options) {
  const char* group = "Scene and camera";
  command.add_option("--size", options.size, "Frame size, pixels")
      ->check(checked(check_size))
      ->type_name("WxH")
      ->capture_default_str()
      ->group(group);
  command.add_option("--crop", options.crop, "Rectangle of the frame to render, pixels")
      ->check(checked(check_crop))
      ->type_name("X,Y,W,H")
      ->group(group);
  command
      .add_option("--camera", options.camera,
                  "Camera (default: the first; a scene without cameras is framed whole)")
      ->type_name("NAME|INDEX")
      ->group(group);
  command
      .add_option("--scene", options.scene_index,
                  "Index of the glTF scene (default: the file's default scene)")
      ->check(CLI::Range(0, std::numeric_limits<int>::max()))
      ->type_name("N")
      ->group(group);
  command
      .add_option("--frames", options.frames,
                  "Frames, e.g. 0, 1-10, 1-10x2 (every second frame) or 1,4,9")
      ->check(checked(check_frames))
      ->type_name("RANGES")
      ->capture_default_str()
      ->group(group);
  command
      .add_option("--fps", options.fps,
                  "Frames per second: frame n shows the scene at n/fps seconds")
      ->check(cli::finite_range(1e-6, 1e6))
      ->type_name("N")
      ->capture_default_str()
      ->group(group);
  command.add_option("--animation", options.animation, "Animation (default: the first)")
      ->type_name("NAME|INDEX|all|none")
      ->group(group);
  command.add_option("--variant", options.variant, "Material variant (KHR_materials_variants)")
      ->type_name("NAME")
      ->group(group);
  command
      .add_flag("--cull-backfaces", options.cull_backfaces,
                "Hide back faces of single-sided materials from the camera")
      ->group(group);
}

constexpr const char* kSamplingGroup = "Sampling";

void add_sample_count_options(CLI::App& command, RenderOptions& options) {
  const char* group = kSamplingGroup;
  CLI::Option* spp = command.add_option("--spp", options.spp, "Samples per pixel")
                         ->check(CLI::Range(1, 1 << 20))
                         ->type_name("N")
                         ->capture_default_str()
                         ->group(group);
  CLI::Option* error =
      command
          .add_option(
              "--error", options.error,
              "Target error, e.g. 0.05: render until the error's 95 % upper bound is at most "
              "this")
          ->check(cli::finite_range(1e-6, 1.0))
          ->type_name("E")
          ->excludes(spp)
          ->group(group);
  command.add_option("--max-spp", options.max_spp, "With --error: maximum samples per pixel")
      ->check(CLI::Range(1, 1 << 20))
      ->type_name("N")
      ->needs(error)
      ->capture_default_str()
      ->group(group);
}

void add_sampling_options(CLI::App& command, RenderOptions& options) {
  const char* group = kSamplingGroup;
  command.add_option("--max-depth", options.max_depth, "Maximum scattering events per path")
      ->check(CLI::Range(1, 255))
      ->type_name("N")
      ->capture_default_str()
      ->group(group);
  command.add_option("--seed", options.seed, "Random seed")
      ->check(CLI::Range(std::int64_t{0}, std::int64_t{4294967295}))
      ->type_name("N")
      ->capture_default_str()
      ->group(group);
  command.add_option("--tile-size", options.tile_size, "Side of a tile, pixels")
      ->check(CLI::IsMember({8, 16, 32, 64, 128, 256}))
      ->type_name("N")
      ->capture_default_str()
      ->group(group);
  command.add_option("--filter", options.filter, "Pixel filter")
      ->check(CLI::IsMember({"box", "gaussian", "blackman-harris"}).description(""))
      ->type_name("box|gaussian|blackman-harris")
      ->capture_default_str()
      ->group(group);
  command
      .add_option("--filter-width", options.filter_width,
                  "Width of the filter, pixels (default: box 1, others 3)")
      ->check(cli::finite_range(1e-3, 64.0))
      ->type_name("W")
      ->group(group);
  command
      .add_flag_function(
          "--guiding,!--no-guiding",
          [&options](std::int64_t count) { options.guiding = count > 0; },
          "Guide paths by photons: less noise from light through glass or narrow openings and from "
          "small lights in mirrors (default: with --error)")
      ->group(group);
  command
      .add_option("--clamp", options.clamp,
                  "Maximum radiance per sample and channel (default: off); clamped images are not "
                  "certified")
      ->check(cli::finite_range(1e-30, 1e30))
      ->type_name("V")
      ->group(group);
}

void add_light_options(CLI::App& command, RenderOptions& options) {
  const char* group = "Environment";
  command.add_option("--environment", options.environment, "Environment map, latitude-longitude")
      ->type_name("FILE.(exr|hdr)")
      ->check(CLI::Validator(CLI::ExistingFile).description(""))
      ->group(group);
  command
      .add_option("--environment-rotation", options.environment_rotation,
                  "Rotation of the environment map about +Y, degrees")
      ->check(cli::finite_range(-1e6, 1e6))
      ->type_name("DEG")
      ->group(group);
  command
      .add_option("--environment-strength", options.environment_strength,
                  "Factor for the radiance of the environment map")
      ->check(cli::finite_range(0.0, 1e30))
      ->type_name("S")
      ->group(group);
  command
      .add_option("--background", options.background,
                  "Background colour or none (default: the environment map, if any)")
      ->check(checked(check_background))
      ->type_name("R,G,B|none")
      ->group(group);
}

}  // namespace

void add_render_options(CLI::App& command, RenderOptions& options) {
  command.add_option("scene-file", options.scene, "glTF scene, .gltf or .glb")
      ->required()
      ->type_name("SCENE");
  add_view_options(command, options);
  add_sample_count_options(command, options);
  add_sampling_options(command, options);
  add_light_options(command, options);
  const char* group = "Output";
  command
      .add_option(
          "--reference", options.reference,
          "Reference image for the true error; with several frames, one image for each, named "
          "REF.0007.exr")
      ->type_name("REF.exr")
      ->group(group);
  command
      .add_option("--aov", options.aovs,
                  "Additional layers: albedo, normal, depth, position, ids, samples, stderr, "
                  "traversal-cost, denoising, motion")
      ->delimiter(',')
      ->type_name("LIST")
      ->group(group);
  command
      .add_flag(
          "--denoise", options.denoise,
          "Denoise frames and bound the remaining error, to which --error then refers; the EXR "
          "file also keeps the raw image")
      ->group(group);
  command.add_flag("--half", options.half, "Write half-precision floats to EXR files")
      ->group(group);
  add_accelerator_option(command, options.accelerator)->group("Comparison");
}

CLI::Option* add_accelerator_option(CLI::App& command, std::string& accelerator) {
  return command
      .add_option(
          "--accelerator", accelerator,
          "Acceleration structure (default: the production BVH); pixels are the same, speed "
          "differs")
      ->check(CLI::IsMember(contract::kStructureNames))
      ->type_name("NAME");
}

absl::Status parse_size(const std::string& text, std::int32_t& width, std::int32_t& height) {
  std::string_view rest = text;
  if (take_number(rest, width) && take_char(rest, 'x') && take_number(rest, height) &&
      rest.empty() && width >= 1 && height >= 1 && width <= 65536 && height <= 65536) {
    return absl::OkStatus();
  }
  return invalid("size", text, "WxH with sides of 1 to 65536");
}

absl::StatusOr<contract::PixelRect> parse_crop(const std::string& text) {
  contract::PixelRect crop;
  std::string_view rest = text;
  if (take_number(rest, crop.x) && take_char(rest, ',') && take_number(rest, crop.y) &&
      take_char(rest, ',') && take_number(rest, crop.width) && take_char(rest, ',') &&
      take_number(rest, crop.height) && rest.empty()) {
    return crop;
  }
  return invalid("crop", text, "X,Y,W,H");
}

absl::StatusOr<std::vector<contract::FrameRange>> parse_frames(const std::string& text) {
  std::vector<contract::FrameRange> ranges;
  std::string_view rest = text;
  absl::Status error = invalid("frames", text, "like 0, 1-10, 1-10x2 or 1,4,9");
  do {
    contract::FrameRange range;
    if (!take_number(rest, range.first)) return error;
    range.last = range.first;
    if (take_char(rest, '-') && !take_number(rest, range.last)) return error;
    if (take_char(rest, 'x') && !take_number(rest, range.step)) return error;
    if (range.first < 0 || range.last < range.first || range.step < 1) return error;
    ranges.push_back(range);
  } while (take_char(rest, ','));
  if (!rest.empty()) return error;
  return ranges;
}

absl::Status parse_background(const std::string& text, contract::RenderSettings& settings) {
  if (text == "none") {
    settings.background = contract::Background::none;
    return absl::OkStatus();
  }
  settings.background = contract::Background::color;
  std::string_view rest = text;
  bool is_valid = true;
  for (std::size_t i = 0; i < 3; ++i) {
    float& value = settings.background_color[i];
    is_valid = is_valid && (i == 0 || take_char(rest, ',')) && take_number(rest, value) &&
               std::isfinite(value) && value >= 0;
  }
  if (is_valid && rest.empty()) return absl::OkStatus();
  return invalid("background", text, "none or R,G,B with values of at least 0");
}

absl::StatusOr<contract::RenderSettings> settings_of(const RenderOptions& options,
                                                     const std::string& environment_uri) {
  contract::RenderSettings settings;
  absl::Status status = parse_size(options.size, settings.width, settings.height);
  if (!status.ok()) return status;
  if (!options.crop.empty()) {
    const auto crop = parse_crop(options.crop);
    if (!crop.ok()) return crop.status();
    settings.crop = *crop;
  }
  auto frames = parse_frames(options.frames);
  if (!frames.ok()) return frames.status();
  settings.frames = *std::move(frames);
  if (!options.background.empty()) {
    status = parse_background(options.background, settings);
    if (!status.ok()) return status;
  }
  const auto aovs = contract::parse_aovs(options.aovs);
  if (!aovs.ok()) return aovs.status();
  settings.aovs = *aovs;
  settings.camera = options.camera;
  settings.scene = options.scene_index;
  settings.fps = options.fps;
  settings.animation = options.animation;
  settings.variant = options.variant;
  settings.spp = options.error > 0 ? options.max_spp : options.spp;
  if (options.error > 0) settings.error = options.error;
  settings.max_depth = options.max_depth;
  settings.seed = static_cast<std::uint32_t>(options.seed);
  settings.tile = options.tile_size;
  settings.filter = options.filter == "gaussian"          ? contract::PixelFilter::gaussian
                    : options.filter == "blackman-harris" ? contract::PixelFilter::blackman_harris
                                                          : contract::PixelFilter::box;
  const double default_width = settings.filter == contract::PixelFilter::box ? 1 : 3;
  settings.filter_width = options.filter_width > 0 ? options.filter_width : default_width;
  settings.environment = environment_uri;
  settings.environment_rotation = options.environment_rotation;
  settings.environment_strength = options.environment_strength;
  settings.denoise = options.denoise;
  if (settings.denoise) settings.aovs |= contract::kAovDenoising;
  settings.half = options.half;
  settings.clamp = options.clamp;
  settings.cull_backfaces = options.cull_backfaces;
  settings.guiding = options.guiding;
  settings.accelerator = options.accelerator;
  // from_message checks the range of every setting.
  const auto checked_settings = contract::from_message(contract::to_message(settings));
  if (!checked_settings.ok()) return checked_settings.status();
  return settings;
}

}  // namespace tessera::client
