#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "rpc/settings_message.h"

namespace tessera::contract {
namespace {

RenderSettings unusual() {
  RenderSettings settings;
  settings.width = 65536;
  settings.height = 1;
  settings.crop = PixelRect{100, 0, 50, 1};
  settings.camera = "side";
  settings.scene = 2;
  settings.frames = {{0, 10, 2}, {40, 40, 1}};
  settings.fps = 29.97;
  settings.animation = "all";
  settings.variant = "red";
  settings.spp = 1000;
  settings.max_depth = 255;
  settings.seed = 4294967295u;
  settings.tile = 8;
  settings.filter = PixelFilter::blackman_harris;
  settings.filter_width = 3;
  settings.environment = "sky.exr";
  settings.environment_rotation = -90;
  settings.environment_strength = 0.5;
  settings.background = Background::color;
  settings.background_color = {0.1f, 0.2f, 0.3f};
  settings.aovs = kAovAlbedo | kAovIds | kAovStdError | kAovDenoising;
  settings.denoise = true;
  settings.half = true;
  settings.clamp = 10;
  settings.cull_backfaces = true;
  settings.guiding = true;
  return settings;
}

TEST(SettingsMessage, EveryFieldRoundTrips) {
  for (const RenderSettings& settings : {RenderSettings{}, unusual()}) {
    const v1::RenderSettings message = to_message(settings);
    const absl::StatusOr<RenderSettings> back = from_message(message);
    ASSERT_TRUE(back.ok()) << back.status();
    EXPECT_EQ(to_message(*back).SerializeAsString(), message.SerializeAsString());
    EXPECT_EQ(back->width, settings.width);
    EXPECT_EQ(back->crop, settings.crop);
    EXPECT_EQ(back->camera, settings.camera);
    EXPECT_EQ(back->scene, settings.scene);
    EXPECT_EQ(back->frames, settings.frames);
    EXPECT_EQ(back->fps, settings.fps);
    EXPECT_EQ(back->animation, settings.animation);
    EXPECT_EQ(back->variant, settings.variant);
    EXPECT_EQ(back->spp, settings.spp);
    EXPECT_EQ(back->max_depth, settings.max_depth);
    EXPECT_EQ(back->seed, settings.seed);
    EXPECT_EQ(back->tile, settings.tile);
    EXPECT_EQ(back->filter, settings.filter);
    EXPECT_EQ(back->filter_width, settings.filter_width);
    EXPECT_EQ(back->environment, settings.environment);
    EXPECT_EQ(back->environment_rotation, settings.environment_rotation);
    EXPECT_EQ(back->environment_strength, settings.environment_strength);
    EXPECT_EQ(back->background, settings.background);
    EXPECT_EQ(back->background_color, settings.background_color);
    EXPECT_EQ(back->aovs, settings.aovs);
    EXPECT_EQ(back->denoise, settings.denoise);
    EXPECT_EQ(back->half, settings.half);
    EXPECT_EQ(back->clamp, settings.clamp);
    EXPECT_EQ(back->cull_backfaces, settings.cull_backfaces);
    EXPECT_EQ(back->guiding, settings.guiding);
  }
}

TEST(SettingsMessage, JobsWithErrorAreGuidedByDefault) {
  RenderSettings settings;
  EXPECT_FALSE(settings.is_guided());
  settings.error = 0.05;
  EXPECT_TRUE(settings.is_guided());
  for (const bool guiding : {false, true}) {
    settings.guiding = guiding;
    const absl::StatusOr<RenderSettings> back = from_message(to_message(settings));
    ASSERT_TRUE(back.ok()) << back.status();
    EXPECT_EQ(back->is_guided(), guiding);
  }
}

TEST(SettingsMessage, RangeErrorNamesField) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInf = std::numeric_limits<double>::infinity();
  using Message = v1::RenderSettings;
  const std::pair<const char*, std::function<void(Message&)>> cases[] = {
      {"width", [](Message& m) { m.set_width_px(0); }},
      {"width", [](Message& m) { m.set_width_px(65537); }},
      {"height", [](Message& m) { m.set_height_px(-1); }},
      {"crop", [](Message& m) { m.mutable_crop()->set_width_px(0); }},
      {"crop",
       [](Message& m) {
         m.mutable_crop()->set_x_px(2147483647);
         m.mutable_crop()->set_width_px(2147483647);
         m.mutable_crop()->set_height_px(1);
       }},
      {"frames", [](Message& m) { m.clear_frames(); }},
      {"frames", [](Message& m) { m.mutable_frames(0)->set_step(0); }},
      {"frames", [](Message& m) { m.mutable_frames(0)->set_first(-1); }},
      {"frames", [](Message& m) { m.mutable_frames(0)->set_last(2000000); }},
      {"fps", [](Message& m) { m.set_fps(0); }},
      {"fps", [](Message& m) { m.set_fps(kNan); }},
      {"sample_count", [](Message& m) { m.set_sample_count(0); }},
      {"sample_count", [](Message& m) { m.set_sample_count(1048577); }},
      {"max_depth", [](Message& m) { m.set_max_depth(0); }},
      {"max_depth", [](Message& m) { m.set_max_depth(256); }},
      {"seed", [](Message& m) { m.set_seed(-1); }},
      {"seed", [](Message& m) { m.set_seed(4294967296); }},
      {"tile", [](Message& m) { m.set_tile_px(48); }},
      {"tile", [](Message& m) { m.set_tile_px(4); }},
      {"tile", [](Message& m) { m.set_tile_px(512); }},
      {"filter_width", [](Message& m) { m.set_filter_width_px(0); }},
      {"filter_width", [](Message& m) { m.set_filter_width_px(kInf); }},
      {"environment_strength", [](Message& m) { m.set_environment_strength(-1); }},
      {"environment_rotation", [](Message& m) { m.set_environment_rotation_deg(kNan); }},
      {"background_color", [](Message& m) { m.set_background(Message::BACKGROUND_COLOR); }},
      {"aovs", [](Message& m) { m.add_aovs("colour"); }},
      {"clamp", [](Message& m) { m.set_clamp(-1); }},
      {"clamp", [](Message& m) { m.set_clamp(kInf); }},
  };
  for (const auto& [field, breaks] : cases) {
    v1::RenderSettings message = to_message(RenderSettings{});
    breaks(message);
    const absl::Status status = from_message(message).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << field;
    EXPECT_NE(std::string(status.message()).find(field), std::string::npos)
        << field << ": " << status;
  }
}

TEST(SettingsMessage, DenoiseImpliesItsLayers) {
  v1::RenderSettings message = to_message(RenderSettings{});
  message.set_denoise(true);
  const absl::StatusOr<RenderSettings> settings = from_message(message);
  ASSERT_TRUE(settings.ok()) << settings.status();
  EXPECT_EQ(settings->aovs, kAovDenoising);
}

TEST(Aovs, NamesAndBitsAreInverse) {
  for (std::uint32_t aovs = 0; aovs < 512; ++aovs) {
    const auto back = parse_aovs(aov_names(aovs));
    ASSERT_TRUE(back.ok()) << back.status();
    ASSERT_EQ(*back, aovs);
  }
  EXPECT_FALSE(parse_aovs({"albedo", "albedo"}).ok()) << "twice";
  EXPECT_FALSE(parse_aovs({"colour"}).ok());
}

}  // namespace
}  // namespace tessera::contract
