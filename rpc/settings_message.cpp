#include "rpc/settings_message.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <string_view>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "contract/pass_schedule.h"
#include "contract/structure_names.h"

namespace tessera::contract {
namespace {

constexpr std::array<std::pair<std::string_view, Aov>, 10> kAovNames = {
    {{"albedo", kAovAlbedo},
     {"normal", kAovNormal},
     {"depth", kAovDepth},
     {"position", kAovPosition},
     {"ids", kAovIds},
     {"samples", kAovSamples},
     {"stderr", kAovStdError},
     {"traversal-cost", kAovTraversalCost},
     {"denoising", kAovDenoising},
     {"motion", kAovMotion}}};
constexpr std::int64_t kMaxFrames = 1'000'000;
constexpr std::int32_t kMaxSide = 65536;

template <typename T>
absl::Status check_range(const char* field, T value, T low, T high) {
  if (value >= low && value <= high) return absl::OkStatus();  // false for NaN
  return absl::InvalidArgumentError(
      absl::StrCat("settings.", field, ": ", value, " is not in [", low, ", ", high, "]"));
}

absl::Status check_frames(const std::vector<FrameRange>& ranges) {
  if (ranges.empty()) return absl::InvalidArgumentError("settings.frames: no range");
  for (const FrameRange& range : ranges) {
    if (range.first < 0 || range.last < range.first || range.step < 1) {
      return absl::InvalidArgumentError(absl::StrCat("settings.frames: ", range.first, "-",
                                                     range.last, "x", range.step,
                                                     " is not a frame range"));
    }
  }
  return check_range("frames", frame_count(ranges), std::int64_t{1}, kMaxFrames);
}

absl::Status check_crop(const RenderSettings& settings) {
  if (!settings.crop) return absl::OkStatus();
  const PixelRect& crop = *settings.crop;
  const bool inside = crop.x >= 0 && crop.y >= 0 && crop.width >= 1 && crop.height >= 1 &&
                      crop.width <= settings.width - crop.x &&
                      crop.height <= settings.height - crop.y;
  if (inside) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("settings.crop: ", crop.x, ",", crop.y, ",",
                                                 crop.width, ",", crop.height, " is not inside ",
                                                 settings.width, "x", settings.height));
}

absl::Status check(const RenderSettings& s) {
  constexpr double kInf = std::numeric_limits<double>::max();
  absl::Status status;
  status.Update(check_range("width_px", s.width, 1, kMaxSide));
  status.Update(check_range("height_px", s.height, 1, kMaxSide));
  status.Update(check_crop(s));
  status.Update(check_frames(s.frames));
  status.Update(check_range("fps", s.fps, 1e-6, 1e6));
  status.Update(check_range("sample_count", s.spp, 1, kMaxSpp));
  status.Update(check_range("max_depth", s.max_depth, 1, 255));
  status.Update(check_range("tile_px", s.tile, 8, 256));
  if (!std::has_single_bit(static_cast<std::uint32_t>(s.tile))) {
    status.Update(absl::InvalidArgumentError(
        absl::StrCat("settings.tile_px: ", s.tile, " is not a power of two")));
  }
  status.Update(check_range("filter_width_px", s.filter_width, 1e-3, 64.0));
  status.Update(check_range("environment_rotation_deg", s.environment_rotation, -1e6, 1e6));
  status.Update(check_range("environment_strength", s.environment_strength, 0.0, 1e30));
  for (const float value : s.background_color) {
    status.Update(check_range("background_color", value, 0.0f, 1e30f));
  }
  status.Update(check_range("clamp", s.clamp, 0.0, kInf));
  if (s.error) status.Update(check_range("error_target", *s.error, 1e-6, 1.0));
  const auto& names = kStructureNames;
  if (!s.accelerator.empty() &&
      std::find(names.begin(), names.end(), s.accelerator) == names.end()) {
    status.Update(absl::InvalidArgumentError(
        absl::StrCat("settings.accelerator: no structure is called \"", s.accelerator, "\"")));
  }
  return status;
}

void read_enums(const v1::RenderSettings& message, RenderSettings& settings) {
  switch (message.filter()) {
    case v1::RenderSettings::PIXEL_FILTER_GAUSSIAN:
      settings.filter = PixelFilter::gaussian;
      break;
    case v1::RenderSettings::PIXEL_FILTER_BLACKMAN_HARRIS:
      settings.filter = PixelFilter::blackman_harris;
      break;
    default:
      settings.filter = PixelFilter::box;
  }
  switch (message.background()) {
    case v1::RenderSettings::BACKGROUND_NONE:
      settings.background = Background::none;
      break;
    case v1::RenderSettings::BACKGROUND_COLOR:
      settings.background = Background::color;
      break;
    default:
      settings.background = Background::automatic;
  }
}

}  // namespace

absl::StatusOr<std::uint32_t> parse_aovs(const std::vector<std::string>& names) {
  std::uint32_t aovs = 0;
  for (const std::string& name : names) {
    std::uint32_t bit = 0;
    for (const auto& [known, aov] : kAovNames) {
      if (name == known) bit = aov;
    }
    if (bit == 0 || (aovs & bit) != 0) {
      return absl::InvalidArgumentError(absl::StrCat(
          "settings.aovs: \"", name, "\" is ",
          bit == 0 ? "not one of albedo, normal, depth, position, ids, samples, stderr, "
                     "traversal-cost, denoising, motion"
                   : "repeated"));
    }
    aovs |= bit;
  }
  return aovs;
}

std::vector<std::string> aov_names(std::uint32_t aovs) {
  std::vector<std::string> names;
  for (const auto& [name, aov] : kAovNames) {
    if (aovs & aov) names.emplace_back(name);
  }
  return names;
}

v1::PixelRect to_message(const PixelRect& rect) {
  v1::PixelRect message;
  message.set_x_px(rect.x);
  message.set_y_px(rect.y);
  message.set_width_px(rect.width);
  message.set_height_px(rect.height);
  return message;
}

v1::RenderSettings to_message(const RenderSettings& settings) {
  v1::RenderSettings message;
  message.set_width_px(settings.width);
  message.set_height_px(settings.height);
  if (settings.crop) *message.mutable_crop() = to_message(*settings.crop);
  message.set_camera(settings.camera);
  if (settings.scene >= 0) message.set_scene_index(settings.scene);
  for (const FrameRange& range : settings.frames) {
    auto* frames = message.add_frames();
    frames->set_first(range.first);
    frames->set_last(range.last);
    frames->set_step(range.step);
  }
  message.set_fps(settings.fps);
  message.set_animation(settings.animation);
  message.set_variant(settings.variant);
  message.set_sample_count(settings.spp);
  message.set_max_depth(settings.max_depth);
  message.set_seed(settings.seed);
  message.set_tile_px(settings.tile);
  message.set_filter(static_cast<v1::RenderSettings::PixelFilter>(
      v1::RenderSettings::PIXEL_FILTER_BOX + static_cast<int>(settings.filter)));
  message.set_filter_width_px(settings.filter_width);
  message.set_environment_uri(settings.environment);
  message.set_environment_rotation_deg(settings.environment_rotation);
  message.set_environment_strength(settings.environment_strength);
  message.set_background(
      static_cast<v1::RenderSettings::Background>(static_cast<int>(settings.background)));
  if (settings.background == Background::color) {
    for (const float value : settings.background_color) message.add_background_color(value);
  }
  for (const std::string& name : aov_names(settings.aovs)) message.add_aovs(name);
  message.set_denoise(settings.denoise);
  message.set_half(settings.half);
  message.set_clamp(settings.clamp);
  message.set_cull_backfaces(settings.cull_backfaces);
  if (settings.guiding) message.set_guiding(*settings.guiding);
  message.set_accelerator(settings.accelerator);
  if (settings.error) message.set_error_target(*settings.error);
  return message;
}

absl::StatusOr<RenderSettings> from_message(const v1::RenderSettings& message) {
  RenderSettings settings;
  settings.width = message.width_px();
  settings.height = message.height_px();
  if (message.has_crop()) {
    const auto& crop = message.crop();
    settings.crop = PixelRect{crop.x_px(), crop.y_px(), crop.width_px(), crop.height_px()};
  }
  settings.camera = message.camera();
  settings.scene = message.has_scene_index() ? message.scene_index() : -1;
  settings.frames.clear();
  for (const auto& range : message.frames()) {
    settings.frames.push_back({range.first(), range.last(), range.step()});
  }
  settings.fps = message.fps();
  settings.animation = message.animation();
  settings.variant = message.variant();
  settings.spp = message.sample_count();
  settings.max_depth = message.max_depth();
  if (message.seed() < 0 || message.seed() > std::numeric_limits<std::uint32_t>::max()) {
    return absl::InvalidArgumentError(
        absl::StrCat("settings.seed: ", message.seed(), " is not in [0, 4294967295]"));
  }
  settings.seed = static_cast<std::uint32_t>(message.seed());
  settings.tile = message.tile_px();
  read_enums(message, settings);
  settings.filter_width = message.filter_width_px();
  settings.environment = message.environment_uri();
  settings.environment_rotation = message.environment_rotation_deg();
  settings.environment_strength = message.environment_strength();
  if (settings.background == Background::color) {
    if (message.background_color_size() != 3) {
      return absl::InvalidArgumentError("settings.background_color: expected three values");
    }
    for (int i = 0; i < 3; ++i) {
      settings.background_color[static_cast<std::size_t>(i)] = message.background_color(i);
    }
  }
  const auto aovs = parse_aovs({message.aovs().begin(), message.aovs().end()});
  if (!aovs.ok()) return aovs.status();
  settings.aovs = *aovs;
  settings.denoise = message.denoise();
  if (settings.denoise) settings.aovs |= kAovDenoising;
  settings.half = message.half();
  settings.clamp = message.clamp();
  settings.cull_backfaces = message.cull_backfaces();
  if (message.has_guiding()) settings.guiding = message.guiding();
  settings.accelerator = message.accelerator();
  if (message.has_error_target()) settings.error = message.error_target();
  if (absl::Status status = check(settings); !status.ok()) return status;
  return settings;
}

}  // namespace tessera::contract
