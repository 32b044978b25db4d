#include "client/bench/bench_reference.h"

#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace tessera::client {
namespace {

using nlohmann::json;

/// Returns "1,2,3" for [1, 2, 3], with the digits of the report.
std::string list_text(const json& numbers) {
  return absl::StrJoin(numbers, ",", [](std::string* text, const json& number) {
    absl::StrAppend(text, number.dump());
  });
}

/// Returns the argument of --background; empty for "environment", the default.
std::string background_text(const json& background) {
  if (background.is_array()) return list_text(background);
  return background == "none" ? "none" : "";
}

/// Converts the settings of a report (server/report/report.cpp) to options. A missing setting has
/// its default. Throws json::exception if a value has the wrong type.
RenderOptions settings_of_report(const json& settings, std::int32_t frame) {
  RenderOptions render;
  const auto take = [&](const char* key, auto& option) { option = settings.value(key, option); };
  render.size = absl::StrCat(settings.at("width").get<std::int32_t>(), "x",
                             settings.at("height").get<std::int32_t>());
  if (const json crop = settings.value("crop", json()); crop.is_array()) {
    render.crop = list_text(crop);
  }
  render.frames = absl::StrCat(frame);
  if (const json scene = settings.value("scene", json()); !scene.is_null()) {
    render.scene_index = scene.get<int>();
  }
  render.background = background_text(settings.value("background", json("environment")));
  take("camera", render.camera);
  take("fps", render.fps);
  take("animation", render.animation);
  take("variant", render.variant);
  take("max_depth", render.max_depth);
  take("filter", render.filter);
  take("filter_width", render.filter_width);
  take("environment_rotation", render.environment_rotation);
  take("environment_strength", render.environment_strength);
  take("clamp", render.clamp);
  take("cull_backfaces", render.cull_backfaces);
  return render;
}

}  // namespace

absl::StatusOr<BenchReference> read_reference_report(std::string_view text) {
  const json report = json::parse(text, nullptr, false);
  if (!report.is_object() || !report.contains("settings") || !report.contains("frames")) {
    return absl::InvalidArgumentError("not the report of a render");
  }
  const json& frames = report["frames"];
  if (frames.size() != 1) {
    return absl::InvalidArgumentError(absl::StrCat("has ", frames.size(), " frames; expected 1"));
  }
  try {  // the JSON library throws if a member is missing or has the wrong type
    const json& frame = frames.at(0);
    const json& settings = report["settings"];
    if (!frame.at("estimated").is_object()) {
      return absl::InvalidArgumentError("has no error estimate");
    }
    BenchReference reference;
    reference.relmse = frame["estimated"].at("relmse").get<double>();
    reference.scene_sha256 = report.at("scene_sha256").get<std::string>();
    reference.seed = settings.at("seed").get<std::int64_t>();
    const std::string uri = settings.value("environment", "");
    reference.environment = uri.substr(uri.rfind('/') + 1);
    reference.render = settings_of_report(settings, frame.at("frame").get<std::int32_t>());
    return reference;
  } catch (const json::exception& error) {
    return absl::InvalidArgumentError(
        absl::StrCat("not the report of a render (", error.what(), ")"));
  }
}

std::vector<std::int64_t> bench_seeds(int count, std::int64_t reference_seed) {
  std::vector<std::int64_t> seeds;
  for (std::int64_t seed = 1; seeds.size() < static_cast<std::size_t>(count); ++seed) {
    if (seed != reference_seed) seeds.push_back(seed);
  }
  return seeds;
}

}  // namespace tessera::client
