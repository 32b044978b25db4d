// The layer traversal-cost.

#include <gtest/gtest.h>

#include "contract/structure_names.h"
#include "tests/support/scene/plain_scene.h"
#include "worker/accel/traversal/thread_counts.h"
#include "worker/accelerators/structure_accelerator.h"
#include "worker/render/parallel_threads.h"

namespace tessera::testing {
namespace {

using contract::FilmBlock;
using contract::Pass;
using contract::PixelRect;
using contract::RenderSettings;
using render::FrameRenderer;
using render::TraceOptions;

constexpr PixelRect kFrame = {0, 0, 24, 20};
constexpr std::int64_t kTriangles = 2 + 12 * 10;  // of sphere_on_floor()

/// A glass sphere on a floor, under a lamp; the upper half of the frame is empty sky.
render::Scene sphere_on_floor() {
  render::Scene scene = empty_scene();
  const auto floor = add_material(&scene, lambert({0.7f, 0.6f, 0.5f}));
  const auto clear = add_material(&scene, glass(1.5f));
  add_primitive(&scene, quad({-2, -1, 2}, {4, 0, 0}, {0, 0, -4}, floor));
  add_primitive(&scene, sphere({0, -0.4f, 0}, 0.6f, 12, clear));
  render::PunctualLight point;
  point.intensity = {3, 3, 3};
  point.position = render::Vec3d{1.5, 1.5, 1.5};
  scene.lights.push_back(point);
  look_at(&scene, render::Vec3d{0, 1, 5}, {0, 1, 0});
  return scene;
}

RenderSettings settings_with(std::uint32_t aovs) {
  RenderSettings settings = small_settings(kFrame.width, kFrame.height, 16);
  settings.aovs = aovs;
  return settings;
}

TraceOptions through(std::string_view name) {
  const auto* structure = render::accelerators::find_structure(name);
  return {render::best_isa(), [structure](const render::Scene& scene) {
            return std::make_unique<const render::accelerators::StructureAccelerator>(scene,
                                                                                      *structure);
          }};
}

std::unique_ptr<FrameRenderer> renderer_of(std::uint32_t aovs, const TraceOptions& tracing = {}) {
  auto made = FrameRenderer::create(sphere_on_floor(), settings_with(aovs), 0, render::sequential(),
                                    nullptr, tracing);
  EXPECT_TRUE(made.ok()) << made.status();
  return *std::move(made);
}

std::unique_ptr<FrameRenderer> counting(const TraceOptions& tracing = {}) {
  return renderer_of(contract::kAovTraversalCost, tracing);
}

TEST(TraversalCostLayer, DoesNotChangePicture) {
  const Pass pass{0, 16};
  const FilmBlock plain = renderer_of(0)->render(kFrame, pass, 0, render::sequential());
  for (const TraceOptions& tracing : {TraceOptions(), through("kd-tree")}) {
    const FilmBlock costly = counting(tracing)->render(kFrame, pass, 0, render::sequential());
    EXPECT_EQ(costly.rgb, plain.rgb);
    EXPECT_EQ(costly.alpha, plain.alpha);
  }
}

TEST(TraversalCostLayer, TilesAndThreadsDoNotMatter) {
  const Pass pass{8, 8};
  for (const char* name : {"", "grid-mailboxes"}) {
    const auto renderer = counting(*name == 0 ? TraceOptions() : through(name));
    const FilmBlock whole = renderer->render(kFrame, pass, 1, render::sequential());
    EXPECT_EQ(renderer->render(kFrame, pass, 1, render::parallel_threads(3)), whole) << name;
    for (const PixelRect rect : {PixelRect{0, 0, 8, 8}, {8, 8, 16, 12}, {23, 19, 1, 1}}) {
      const FilmBlock part = renderer->render(rect, pass, 1, render::sequential());
      for (std::int32_t i = 0; i < rect.width * rect.height * 3; ++i) {
        const std::int32_t x = rect.x + i / 3 % rect.width, y = rect.y + i / 3 / rect.width;
        ASSERT_EQ(
            part.traversal_cost[static_cast<std::size_t>(i)],
            whole.traversal_cost[static_cast<std::size_t>(3 * (y * kFrame.width + x) + i % 3)])
            << name;
      }
    }
  }
}

TEST(TraversalCostLayer, BruteForceTestsAllTriangles) {
  const auto renderer = counting(through("brute-force"));
  const FilmBlock sky = renderer->render({0, 0, 24, 2}, {0, 4}, 0, render::sequential());
  for (std::size_t pixel = 0; pixel < 48; ++pixel) {
    EXPECT_EQ(sky.traversal_cost[3 * pixel], 4) << "a ray per sample";
    EXPECT_EQ(sky.traversal_cost[3 * pixel + 1], 0);
    EXPECT_EQ(sky.traversal_cost[3 * pixel + 2], 4 * kTriangles);
  }
}

TEST(TraversalCostLayer, EqualsWorkOfFrame) {
  for (const char* name : {"", "octree"}) {
    const auto renderer = counting(*name == 0 ? TraceOptions() : through(name));
    const contract::TraversalCounts before = render::thread_traversal_counts();
    const FilmBlock block = renderer->render(kFrame, {0, 8}, 0, render::parallel_threads(3));
    const contract::TraversalCounts work = render::thread_traversal_counts() - before;
    contract::TraversalCounts sum;
    for (std::size_t i = 0; i < block.traversal_cost.size(); i += 3) {
      sum += {static_cast<std::int64_t>(block.traversal_cost[i]),
              static_cast<std::int64_t>(block.traversal_cost[i + 1]),
              static_cast<std::int64_t>(block.traversal_cost[i + 2])};
    }
    EXPECT_EQ(sum, work) << name;
    EXPECT_GT(work.rays, kFrame.width * kFrame.height * 8) << name;
  }
}

TEST(TraversalCostLayer, RefittedTreesAreNotCounted) {
  const auto settings = settings_with(contract::kAovTraversalCost);
  render::Scene moved = sphere_on_floor();
  std::vector<render::Primitive> primitives(moved.meshes[1].primitives.begin(),
                                            moved.meshes[1].primitives.end());
  std::vector<render::Vec3f> positions(primitives[0].positions.begin(),
                                       primitives[0].positions.end());
  for (std::size_t i = 0; i < positions.size(); i += 3) positions[i].x *= 1.05f;
  primitives[0].positions = std::move(positions);
  moved.meshes[1].primitives = std::move(primitives);
  const auto first = counting();
  const auto after = FrameRenderer::create(moved, settings, 1, render::sequential(), first.get());
  const auto alone = FrameRenderer::create(moved, settings, 1, render::sequential());
  EXPECT_EQ((*after)->render(kFrame, {0, 4}, 0, render::sequential()),
            (*alone)->render(kFrame, {0, 4}, 0, render::sequential()));
  EXPECT_EQ((*after)->accel().refitted_meshes(), 0u);
}

}  // namespace
}  // namespace tessera::testing
