#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <string>

#include "contract/tile_grid.h"
#include "contract/version.h"
#include "tests/support/scene/plain_scene.h"
#include "worker/render/numerics/numerics_check.h"
#include "worker/render/parallel_tbb.h"
#include "worker/render/parallel_threads.h"
#include "worker/render/path/path_observer.h"

namespace tessera::testing {
namespace {

using render::Material;
using render::Scene;
using render::Vec3d;
using render::Vec3f;

Material lamp(float radiance) {
  Material m = lambert({0.5f, 0.5f, 0.5f});
  m.emission = {radiance, radiance, radiance};
  return m;
}

/// A small room with a lamp, a rough metal sphere, a glass sphere, and sky through a missing wall.
Scene room(double scale = 1, double light_scale = 1) {
  Scene scene = empty_scene();
  const auto s = static_cast<float>(scale);
  const auto wall = add_material(&scene, lambert({0.7f, 0.6f, 0.5f}));
  const auto light = add_material(&scene, lamp(8));
  const auto gold = add_material(&scene, metal(0.4f));
  Material clear = glass(1.5f);
  clear.attenuation_color = {0.9f, 0.5f, 0.8f};
  clear.attenuation_distance = 2 * s;
  const auto ball = add_material(&scene, clear);
  Material pane = glass(1.5f);
  pane.has_volume = false;
  pane.base_color = {0.9f, 0.9f, 0.7f, 0.75f};
  pane.alpha_mode = render::AlphaMode::blend;
  const auto sheet = add_material(&scene, pane);
  add_primitive(&scene, quad({-2 * s, -1 * s, 2 * s}, {4 * s, 0, 0}, {0, 0, -4 * s}, wall));
  add_primitive(&scene, quad({-2 * s, -1 * s, -2 * s}, {4 * s, 0, 0}, {0, 3 * s, 0}, wall));
  add_primitive(&scene, quad({-0.5f * s, 2 * s, -0.5f * s}, {1 * s, 0, 0}, {0, 0, 1 * s}, light));
  add_primitive(&scene, sphere({-0.8f * s, -0.3f * s, 0}, 0.6f * s, 24, gold));
  add_primitive(&scene, sphere({0.8f * s, -0.3f * s, 0.3f * s}, 0.6f * s, 24, ball));
  add_primitive(&scene, quad({-1 * s, -1 * s, 1.2f * s}, {2 * s, 0, 0}, {0, 1.5f * s, 0}, sheet));
  std::vector<float> sky(32 * 16 * 3);
  for (std::size_t i = 0; i < sky.size(); ++i) sky[i] = static_cast<float>(i % 11) * 0.1f;
  set_sky(&scene, 32, 16, sky);
  render::PunctualLight point;
  const auto candela = static_cast<float>(3 * light_scale);
  point.intensity = {candela, candela, candela};
  point.position = Vec3d{1.5, 1.5, 1.5} * scale;
  scene.lights.push_back(point);
  look_at(&scene, Vec3d{0.5, 0.8, 5} * scale, {0, 0, 0});
  return scene;
}

std::string bytes(const Picture& picture) {
  std::string all;
  for (const auto& block : picture.blocks) all += contract::encode(block);
  return all;
}

contract::RenderSettings room_settings() {
  auto settings = small_settings(24, 20, 16);
  settings.aovs = contract::kAovAlbedo | contract::kAovNormal | contract::kAovDepth |
                  contract::kAovPosition | contract::kAovIds;
  return settings;
}

TEST(FrameRenderer, PowerOfTwoScaleKeepsEveryBit) {  // hard case 6
  const auto settings = small_settings(24, 20, 16);
  const std::string reference = bytes(render_picture(room(), settings));
  for (const int k : {-20, -10, 0, 10, 30}) {
    const double scale = std::ldexp(1.0, k);
    EXPECT_TRUE(bytes(render_picture(room(scale, scale * scale), settings)) == reference) << k;
  }
}

TEST(FrameRenderer, ScaleChangesNoExpectedPixel) {  // hard case 6
  auto settings = small_settings(32, 24, 64);
  const Picture metre = render_picture(room(), settings);
  settings.seed = 1;
  for (const double scale : {1e-6, 1e9}) {
    const Picture scaled = render_picture(room(scale, scale * scale), settings);
    EXPECT_LT(largest_difference(metre, scaled), 4.5) << scale;
    EXPECT_TRUE(scaled.blocks[0].dropped.empty());
  }
}

TEST(FrameRenderer, TilesAndCropsMatchWholeFrame) {
  const auto settings = room_settings();
  auto renderer = render::FrameRenderer::create(room(), settings, 0, render::sequential());
  ASSERT_TRUE(renderer.ok());
  const contract::Pass pass{8, 8};
  const auto whole = (*renderer)->render({0, 0, 24, 20}, pass, 1, render::sequential());
  for (const contract::PixelRect rect :
       {contract::PixelRect{0, 0, 8, 8}, {8, 8, 16, 12}, {23, 19, 1, 1}}) {
    const auto part = (*renderer)->render(rect, pass, 1, render::sequential());
    for (std::int32_t y = 0; y < rect.height; ++y) {
      for (std::int32_t x = 0; x < rect.width; ++x) {
        const auto to = static_cast<std::size_t>(y * rect.width + x);
        const auto from = static_cast<std::size_t>((y + rect.y) * 24 + x + rect.x);
        for (std::size_t i = 0; i < 12; ++i)
          ASSERT_EQ(part.rgb[to * 12 + i], whole.rgb[from * 12 + i]);
        ASSERT_EQ(part.alpha[to], whole.alpha[from]);
        ASSERT_EQ(part.normal[3 * to], whole.normal[3 * from]);
      }
    }
  }
  auto cropped = settings;
  cropped.crop = contract::PixelRect{8, 8, 16, 12};
  auto other = render::FrameRenderer::create(room(), cropped, 0, render::sequential());
  EXPECT_TRUE((*other)->render({8, 8, 16, 12}, pass, 1, render::sequential()) ==
              (*renderer)->render({8, 8, 16, 12}, pass, 1, render::sequential()));
}

/// Counts what PathObserver reports.
struct CountingObserver final : render::PathObserver {
  int vertices = 0, contributions = 0;
  bool is_image = true;  // until the maximum depth
  Vec3f radiance;
  void on_vertex(const Vertex& /*vertex*/) override { ++vertices; }
  void on_miss(const render::Ray& /*ray*/, const Vec3f& /*throughput*/) override {}
  void on_radiance(render::RadianceSource /*source*/, const Vec3f& added,
                   float /*mis_weight*/) override {
    ++contributions;
    if (is_image) radiance += added;
  }
  void on_pass(const Vec3f& /*throughput*/) override {}
  void on_medium(const render::MediumView& /*medium*/, const Vec3f& /*position*/,
                 const Vec3f& /*throughput*/) override {}
  void on_scatter(const render::BsdfSample& /*sample*/, const Vec3f& /*throughput*/) override {}
  void on_roulette(float /*survival*/, bool /*survived*/, const Vec3f& /*throughput*/) override {}
  void on_max_depth(bool /*continued*/) override { is_image = false; }
};

TEST(FrameRenderer, TraceSampleMatchesRender) {
  const auto settings = small_settings(24, 20, 16);
  const auto renderer = render::FrameRenderer::create(room(), settings, 0, render::sequential());
  ASSERT_TRUE(renderer.ok()) << renderer.status();
  int vertices = 0, contributions = 0;
  for (std::int32_t i = 0; i < 200; ++i) {
    const std::int32_t x = i * 7 % 24, y = i * 11 % 20, sample = i % 13;
    CountingObserver observer;
    const auto traced = (*renderer)->trace_sample(x, y, sample, observer);
    const auto block = (*renderer)->render({x, y, 1, 1}, {sample, 1}, 1, render::sequential());
    for (std::size_t c = 0; c < 3; ++c) {
      float rendered = 0;  // one sample is in one replicate; the others are 0
      for (std::size_t k = c; k < block.rgb.size(); k += 3) rendered += block.rgb[k];
      EXPECT_EQ(traced.radiance[c], rendered) << "pixel " << x << "," << y;
    }
    EXPECT_EQ(observer.radiance.x, traced.radiance[0]) << "sum of the reported contributions";
    vertices += observer.vertices;
    contributions += observer.contributions;
  }
  EXPECT_GT(vertices, 200);
  EXPECT_GT(contributions, 100);
}

TEST(FrameRenderer, ThreadCountKeepsEveryBit) {  // hard case 77
  auto settings = room_settings();
  settings.width = 40;
  settings.height = 30;
  settings.aovs = contract::kAovTraversalCost;  // counted by each thread
  const contract::PixelRect all = {0, 0, 40, 30};
  auto renderer = render::FrameRenderer::create(room(), settings, 0, render::sequential());
  ASSERT_TRUE(renderer.ok());
  const auto one = (*renderer)->render(all, {0, 8}, 0, render::sequential());
  for (const int threads : {1, 2, 3, 5, 16, 19, 20, 64}) {  // the frame has 19 chunks
    EXPECT_TRUE((*renderer)->render(all, {0, 8}, 0, render::parallel_threads(threads)) == one)
        << threads;
  }
#ifndef __SANITIZE_THREAD__  // which cannot see into Debian's libtbb
  for (const int threads : {3, 64}) {
    auto built = render::FrameRenderer::create(room(), settings, 0, render::parallel_tbb(threads));
    EXPECT_TRUE((*built)->render(all, {0, 8}, 0, render::parallel_tbb(threads)) == one) << threads;
  }
#endif
}

TEST(FrameRenderer, SeedAndFrameChangeSamples) {
  auto settings = small_settings(24, 20, 4);
  std::set<std::string> images;
  for (const std::uint32_t seed : {0u, 1u, 2u}) {
    settings.seed = seed;
    images.insert(bytes(render_picture(room(), settings)));
  }
  EXPECT_EQ(images.size(), 3u);
  auto a = render::FrameRenderer::create(room(), settings, 0, render::sequential());
  auto b = render::FrameRenderer::create(room(), settings, 1, render::sequential());
  EXPECT_FALSE((*a)->render({0, 0, 24, 20}, {0, 4}, 0, render::sequential()) ==
               (*b)->render({0, 0, 24, 20}, {0, 4}, 0, render::sequential()));
}

TEST(FrameRenderer, FourfoldSamplesCutErrorBy40Percent) {
  const auto rmse = [](const Picture& a, const Picture& b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.rgb.size(); ++i)
      sum += (a.rgb[i] - b.rgb[i]) * (a.rgb[i] - b.rgb[i]);
    return std::sqrt(sum / static_cast<double>(a.rgb.size()));
  };
  Scene scene = room();
  scene.materials[4] = lambert({0.5f, 0.5f, 0.9f});  // no caustics: they would need more samples
  auto settings = small_settings(24, 20, 1024);
  settings.seed = 77;
  const Picture reference = render_picture(scene, settings);
  settings.seed = 1;
  settings.spp = 16;
  const double coarse = rmse(render_picture(scene, settings), reference);
  settings.spp = 64;
  const double fine = rmse(render_picture(scene, settings), reference);
  EXPECT_LE(fine, 0.6 * coarse);
}

TEST(FrameRenderer, MirroredMeshRendersMirrored) {  // hard case 27
  // A textured, normal-mapped, asymmetric mesh, and its mirror image placed by scale -1.
  const auto shot = [](bool mirrored) {
    Scene scene = empty_scene();
    render::Image image;
    image.width = image.height = 4;
    image.channels = 3;
    std::vector<std::uint8_t> codes;
    for (int i = 0; i < 16; ++i) {
      for (const int v : {100 + 9 * i, 200 - 7 * i, 220}) {
        codes.push_back(static_cast<std::uint8_t>(v));
      }
    }
    image.u8 = codes;
    scene.images.push_back(image);
    scene.textures.push_back({0, render::Wrap::clamp, render::Wrap::clamp, false});
    Material m = lambert({1, 1, 1});
    m.normal_texture.texture = 0;
    m.base_color_texture.texture = 0;
    const auto index = add_material(&scene, m);
    render::Primitive q = quad({-1, -1, 0}, {1.7f, 0, 0.5f}, {0.2f, 2, 0}, index);
    const Vec3f along = normalize(Vec3f{1.7f, 0, 0.5f});
    q.tangents.assign(4, {along.x, along.y, along.z, 1});
    add_primitive(&scene, q, scaling(mirrored ? -1 : 1, 1, 1));
    render::PunctualLight light;
    light.intensity = {20, 20, 20};
    light.position = {mirrored ? -1.5 : 1.5, 1, 2};
    scene.lights.push_back(light);
    return render_picture(scene, small_settings(32, 32, 64));
  };
  const Picture plain = shot(false), mirror = shot(true);
  double difference = 0;
  for (int y = 0; y < 32; ++y) {
    for (int x = 0; x < 32; ++x) difference += std::fabs(plain.at(x, y).x - mirror.at(31 - x, y).x);
  }
  EXPECT_GT(plain.mean(), 0.05);
  EXPECT_LT(difference / 1024, 0.01 * plain.mean());
}

/// Returns the pixel lit by a small lamp at `p`.
contract::GridPoint lit_pixel(Scene scene, const Vec3d& p, std::int32_t width,
                              std::int32_t height) {
  const auto index = add_material(&scene, lamp(1));
  add_primitive(&scene, sphere(Vec3f(p), 0.02f, 8, index));
  const Picture picture = render_picture(scene, small_settings(width, height, 16));
  contract::GridPoint best{-1, -1};
  double largest = 0;
  for (std::int32_t y = 0; y < height; ++y) {
    for (std::int32_t x = 0; x < width; ++x) {
      if (picture.at(x, y).x > largest) {
        largest = picture.at(x, y).x;
        best = {x, y};
      }
    }
  }
  return best;
}

TEST(Camera, PointsProjectToPredictedPixels) {
  constexpr int kWidth = 96, kHeight = 64;
  const Vec3d points[] = {{0.31, 0.22, 0}, {-1.0, 0.4, 1}, {0.8, -0.9, -2}};
  for (const Vec3d& p : points) {
    Scene scene = empty_scene();
    scene.camera.yfov = 0.8;
    look_at(&scene, {1, 2, 5}, {0.2, 0, 0});
    const auto& m = scene.camera.camera_to_world;
    const Vec3d d = p - m.translation;
    const Vec3d local{d.x * m.rows[0].x + d.y * m.rows[1].x + d.z * m.rows[2].x,
                      d.x * m.rows[0].y + d.y * m.rows[1].y + d.z * m.rows[2].y,
                      d.x * m.rows[0].z + d.y * m.rows[1].z + d.z * m.rows[2].z};
    const double focal = kHeight / 2.0 / std::tan(0.4);
    const contract::GridPoint perspective{
        static_cast<std::int32_t>(std::floor(kWidth / 2.0 + focal * local.x / -local.z)),
        static_cast<std::int32_t>(std::floor(kHeight / 2.0 - focal * local.y / -local.z))};
    EXPECT_EQ(lit_pixel(scene, p, kWidth, kHeight), perspective);
    scene.camera.kind = render::Camera::Kind::orthographic;
    scene.camera.ymag = 2.5;
    const contract::GridPoint orthographic{
        static_cast<std::int32_t>(std::floor(kWidth / 2.0 + local.x / 2.5 * kHeight / 2)),
        static_cast<std::int32_t>(std::floor(kHeight / 2.0 - local.y / 2.5 * kHeight / 2))};
    EXPECT_EQ(lit_pixel(scene, p, kWidth, kHeight), orthographic);
  }
}

TEST(Camera, NearAndFarPlanesClip) {
  Scene scene = empty_scene();
  const auto near_lamp = add_material(&scene, lamp(1)), far_lamp = add_material(&scene, lamp(2));
  add_primitive(&scene, quad({-9, -9, 0}, {18, 0, 0}, {0, 18, 0}, near_lamp));
  add_primitive(&scene, quad({-9, -9, -1}, {18, 0, 0}, {0, 18, 0}, far_lamp));
  const auto seen = [&] {
    auto settings = small_settings(1, 1, 4);
    settings.max_depth = 1;
    scene.has_environment = false;
    return render_picture(scene, settings).alpha[0] == 0
               ? -1
               : std::floor(render_picture(scene, settings).mean());
  };
  EXPECT_EQ(seen(), 1);
  scene.camera.znear = 5.5;
  EXPECT_EQ(seen(), 2);
  scene.camera.zfar = 5.75;
  EXPECT_EQ(seen(), -1);
}

TEST(Aovs, FirstHitValuesAreExact) {
  Scene scene = empty_scene();
  scene.center = {100, 0, 0};
  Material m = lambert({0.25f, 0.5f, 0.75f});
  const auto index = add_material(&scene, m);
  render::Primitive q = quad({-9, -9, -1}, {18, 0, 0}, {0, 18, 0}, index);
  q.id = 6;
  add_primitive(&scene, q);
  auto settings = room_settings();
  settings.width = settings.height = 2;
  auto renderer = render::FrameRenderer::create(scene, settings, 0, render::sequential());
  const auto first = (*renderer)->render({0, 0, 2, 2}, {0, 8}, 0, render::sequential());
  EXPECT_EQ(first.hits[0], 8);
  EXPECT_EQ(first.albedo[1], 4);
  EXPECT_EQ(first.normal[2], 8);
  EXPECT_FLOAT_EQ(first.depth[0], 6);
  EXPECT_FLOAT_EQ(first.position[2], -1);
  EXPECT_NEAR(first.position[0], 100, 3);
  EXPECT_EQ(first.ids, (std::vector<std::uint32_t>{1, 2, 7, 1, 2, 7, 1, 2, 7, 1, 2, 7}));
  EXPECT_EQ(first.rgb[0], 0);  // unlit
  const auto second = (*renderer)->render({0, 0, 2, 2}, {8, 8}, 1, render::sequential());
  EXPECT_TRUE(second.depth.empty());
  EXPECT_EQ(second.albedo[1], 4);
}

TEST(FrameRenderer, SharedTreesKeepEveryBit) {
  const auto settings = small_settings(32, 32, 4);
  const auto scene_at = [](const render::Mesh& sphere_mesh, double x) {
    Scene scene = empty_scene();
    add_primitive(&scene, quad({-2, -2, -1}, {4, 0, 0}, {0, 4, 0}, 0));
    scene.meshes.push_back(sphere_mesh);
    scene.instances.push_back({1, 1, translation(x, 0, 0), translation(-x, 0, 0), false});
    set_constant_sky(&scene, 1);
    return scene;
  };
  const render::Mesh mesh{"", {sphere({0, 0, 0}, 0.5f, 16, 0)}};
  const auto make = [&](double x, const render::FrameRenderer* before) {
    auto made =
        render::FrameRenderer::create(scene_at(mesh, x), settings, 0, render::sequential(), before);
    EXPECT_TRUE(made.ok());
    return *std::move(made);
  };
  const auto block_of = [&](const render::FrameRenderer& frame) {
    return contract::encode(frame.render({0, 0, 32, 32}, {0, 4}, 0, render::sequential()));
  };
  const auto first = make(-0.5, nullptr), alone = make(0.5, nullptr);
  const std::string want = block_of(*alone);
  EXPECT_NE(block_of(*first), want) << "the sphere has moved";
  auto sharing = make(0.5, first.get());
  EXPECT_EQ(sharing->accel().shared_meshes(), 1u)
      << "only the sphere is shared; the quad was rebuilt";
  EXPECT_EQ(block_of(*sharing), want);
}

TEST(NumericsCheck, DigestIsReproducible) {
  const auto a = render::numerics_digest(), b = render::numerics_digest();
  ASSERT_TRUE(a.ok()) << a.status();
  EXPECT_EQ(a->hex(), b->hex());
}

TEST(NumericsCheck, DigestIsIndependentOfIsa) {
  const auto narrow = render::numerics_digest(render::Isa::avx2);
  const auto widest = render::numerics_digest(render::best_isa());
  ASSERT_TRUE(narrow.ok() && widest.ok());
  EXPECT_EQ(narrow->hex(), widest->hex());
}

TEST(NumericsCheck, DigestMatchesContract) {
  const auto digest = render::numerics_digest();
  ASSERT_TRUE(digest.ok()) << digest.status();
  EXPECT_EQ(digest->hex(), contract::kNumericsSha256)
      << "it changes only on purpose, together with contract::kRenderContract";
}

}  // namespace
}  // namespace tessera::testing
