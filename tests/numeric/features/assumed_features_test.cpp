// Code specialised for scenes without a feature gives the same bits as the general code.

#include "tests/support/render/assumed_features.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <iterator>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/scene/folder_reader.h"
#include "tests/support/scene/plain_scene.h"
#include "worker/render/camera/camera_rays.h"
#include "worker/scene/features.h"
#include "worker/shading/surface/shading_scene.h"

namespace tessera::testing {
namespace {

using contract::FilmBlock;
using render::Isa;
using render::Scene;
using render::ShadingScene;

/// Features whose absence selects specialised code with the same bits.
constexpr std::uint64_t kChoices[] = {
    render::kFeatureTextures,
    render::kFeatureTextureTransforms,
    render::kFeatureVertexColors,
    render::kFeatureAlphaMask,
    render::kFeatureAlphaBlend,
    render::kFeatureUnlit,
    render::kFeatureSpecular,
    render::kFeatureThinTransmission,
    render::kFeatureInstances,
    render::kFeatureLens,
    render::kFeatureProceduralTextures,
    render::kFeatureShapes,
    render::kFeatureCsg,
    render::kFeatureMedia,
    render::kFeatureMotion,
    render::kFeatureEmissiveMedia,
};

std::uint64_t all_choices() {
  std::uint64_t all = 0;
  for (const std::uint64_t feature : kChoices) all |= feature;
  return all;
}

contract::RenderSettings settings() {
  contract::RenderSettings s = small_settings(20, 12, 4);
  s.aovs = contract::kAovNormal | contract::kAovDepth | contract::kAovPosition | contract::kAovIds;
  return s;
}

/// A diffuse surface without a specular layer, and a lamp; both of static triangles.
Scene painted() {
  Scene scene = empty_scene();
  render::Material lamp = lambert({0.5f, 0.5f, 0.5f});
  lamp.emission = {9, 8, 6};
  const auto white = add_material(&scene, lambert({0.7f, 0.7f, 0.7f}));
  add_primitive(&scene, box({-1.5f, -1, -2}, {1.5f, 1.2f, 2}, true, white));
  add_primitive(&scene,
                sphere({0, -0.4f, 0}, 0.6f, 12, add_material(&scene, lambert({0.6f, 0.2f, 0.1f}))));
  add_primitive(&scene, sphere({-1, -0.6f, 0.5f}, 0.4f, 12, add_material(&scene, metal(0.3f))));
  add_primitive(&scene,
                quad({-0.4f, 1.1f, -0.4f}, {0.8f, 0, 0}, {0, 0, 0.8f}, add_material(&scene, lamp)));
  look_at(&scene, {0, 0, 1.9}, {0, -0.2, 0});
  return scene;
}

Scene scene_named(const std::string& name) {
  if (name == "painted") return painted();
  FolderReader reader(std::string(TESSERA_SCENES));
  auto file = render::load_scene_file(name + ".gltf", settings(), reader);
  EXPECT_TRUE(file.ok()) << file.status();
  auto scene = (*file)->pose(settings(), 0);
  EXPECT_TRUE(scene.ok()) << scene.status();
  return *std::move(scene);
}

/// Film blocks of all passes.
std::vector<FilmBlock> blocks_of(Scene scene, Isa isa, std::uint64_t assumed) {
  const render::TraceOptions tracing = assume(assumed, &scene, isa);
  const auto renderer = render::FrameRenderer::create(std::move(scene), settings(), 0,
                                                      render::sequential(), nullptr, tracing);
  EXPECT_TRUE(renderer.ok()) << renderer.status();
  std::vector<FilmBlock> blocks;
  std::int32_t index = 0;
  for (const contract::Pass& pass : contract::fixed_schedule(settings().spp)) {
    blocks.push_back((*renderer)->render(settings().window(), pass, index++, render::sequential()));
  }
  return blocks;
}

/// Expects the same bits from renders with each set of assumed features.
void expect_same_bits(const Scene& scene, const std::vector<std::uint64_t>& assumed) {
  const std::vector<FilmBlock> special = blocks_of(scene, Isa::avx2, 0);
  double light = 0;
  for (const auto value : special[0].rgb) light += static_cast<double>(value);
  EXPECT_GT(light, 0);
  for (const Isa isa : {Isa::avx2, Isa::avx512}) {
    if (!render::is_supported(isa)) continue;
    for (const std::uint64_t features : assumed) {
      EXPECT_TRUE(blocks_of(scene, isa, features) == special)
          << isa_name(isa) << ", from " << render::feature_names(features).front() << " on";
    }
  }
}

class GeneralPath : public ::testing::TestWithParam<const char*> {};

TEST_P(GeneralPath, MatchesSpecialisedBits) {
  std::vector<std::uint64_t> each(std::begin(kChoices), std::end(kChoices));
  each.push_back(all_choices());
  expect_same_bits(scene_named(GetParam()), each);
}

INSTANTIATE_TEST_SUITE_P(Scenes, GeneralPath,
                         ::testing::Values("lit_square", "painted", "same_bits", "quickstart",
                                           "textures", "shapes", "fog", "motion"),
                         [](const auto& scene) { return std::string(scene.param); });

TEST(AssumedFeatures, MaterialBitsAreUnchanged) {
  expect_same_bits(scene_named("materials"), {all_choices()});
}

/// Returns whether a frame of the scene is prepared for the feature.
bool is_ready_for(std::uint64_t feature, Scene scene, std::uint64_t assumed) {
  const render::TraceOptions tracing = assume(assumed, &scene);
  const ShadingScene shading(scene, assumed);
  const render::SceneAccel accel(scene, render::sequential(), tracing);
  const auto any_of = [](const auto& all, const auto& property) {
    return std::any_of(all.begin(), all.end(), property);
  };
  const auto surfaces_with = [&](std::uint8_t trait) {
    return any_of(shading.primitives, [&](const auto& p) { return (p.traits & trait) != 0; });
  };
  switch (feature) {
    case render::kFeatureAlphaMask:
    case render::kFeatureAlphaBlend:
      return surfaces_with(render::kTraitAlpha);
    case render::kFeatureThinTransmission:
      return surfaces_with(render::kTraitStraight);
    case render::kFeatureUnlit:
      return (shading.traits & render::kTraitUnlit) != 0;
    case render::kFeatureSpecular:
      return !any_of(shading.materials, [](const auto& m) { return m.lambert; });
    case render::kFeatureLens:
      return render::CameraRays(scene.camera, 1, 1, assumed).takes_lens();
    case render::kFeatureProceduralTextures:
      return shading.tracks_footprints;
    case render::kFeatureMedia:
      return shading.tracks_bodies;
    case render::kFeatureEmissiveMedia:
      return shading.has_emissive_media;
    case render::kFeatureShapes:
    case render::kFeatureCsg:
      return any_of(shading.instances, [](const auto& i) { return i.solid; }) &&
             !accel.takes_packets();
    case render::kFeatureMotion:
      return any_of(shading.instances, [](const auto& i) { return i.moves; }) &&
             !accel.takes_packets();
    default:
      return (render::features_of(scene).features & feature) != 0;
  }
}

// Without this test, the tests above would pass even if assumed features had no effect.
TEST(AssumedFeatures, FrameEnablesAssumedFeature) {
  for (const std::uint64_t feature : kChoices) {
    if (feature == render::kFeatureInstances) continue;  // only ray queries depend on it
    const std::string name = render::feature_names(feature).front();
    const bool of_textures = feature == render::kFeatureTextureTransforms;
    const Scene scene = of_textures ? scene_named("quickstart") : painted();
    EXPECT_FALSE(is_ready_for(feature, scene, 0)) << name;
    EXPECT_TRUE(is_ready_for(feature, scene, feature)) << name;
    EXPECT_EQ(feature_named(name), feature);
  }
}

}  // namespace
}  // namespace tessera::testing
