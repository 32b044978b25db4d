// Hard case 12: a coarse mesh with smooth normals under grazing light.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "tests/support/scene/plain_scene.h"

namespace tessera::testing {
namespace {

using render::Primitive;
using render::Scene;
using render::Vec3d;
using render::Vec3f;

constexpr int kSide = 96;  // pixels
constexpr double kWindow = 1.05;

/// An icosahedron with each face split into four: 80 triangles, vertices and normals on the sphere.
Primitive icosphere(std::int32_t material) {
  constexpr float kGolden = std::numbers::phi_v<float>;
  Primitive p;
  p.material = material;
  for (int axis = 0; axis < 3; ++axis) {
    for (const float a : {-1.0f, 1.0f}) {
      for (const float b : {-kGolden, kGolden}) {
        Vec3f corner;
        corner[(axis + 1) % 3] = a;
        corner[(axis + 2) % 3] = b;
        p.positions.push_back(normalize(corner));
      }
    }
  }
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> halves;
  const auto half = [&](std::uint32_t i, std::uint32_t j) {
    const auto [place, added] =
        halves.try_emplace(std::minmax({i, j}), static_cast<std::uint32_t>(p.positions.size()));
    if (added) p.positions.push_back(normalize(p.positions[i] + p.positions[j]));
    return place->second;
  };
  const auto near = [&](std::uint32_t i, std::uint32_t j) {
    return dot(p.positions[i], p.positions[j]) > 0.4f;  // edges span 63 degrees, others 117
  };
  for (std::uint32_t i = 0; i < 12; ++i) {
    for (std::uint32_t j = i + 1; j < 12; ++j) {
      for (std::uint32_t k = j + 1; k < 12; ++k) {
        if (!near(i, j) || !near(j, k) || !near(i, k)) continue;
        const Vec3f &a = p.positions[i], &b = p.positions[j], &c = p.positions[k];
        const bool outwards = dot(cross(b - a, c - a), a) > 0;
        const std::uint32_t v = outwards ? j : k, w = outwards ? k : j;
        const std::uint32_t iv = half(i, v), vw = half(v, w), wi = half(w, i);
        p.triangles.insert(p.triangles.end(),
                           {{i, iv, wi}, {iv, v, vw}, {wi, vw, w}, {iv, vw, wi}});
      }
    }
  }
  p.normals = p.positions;
  return p;
}

/// Seen from +z without perspective.
Scene scene_of(const Primitive& mesh, const render::Affine3d& placement) {
  Scene scene = empty_scene();
  add_material(&scene, lambert({1, 1, 1}));
  add_primitive(&scene, mesh, placement);
  scene.camera.kind = render::Camera::Kind::orthographic;
  scene.camera.ymag = kWindow;
  return scene;
}

Vec3d at_pixel(int x, int y) {
  const double scale = 2 * kWindow / kSide;
  return {(x + 0.5) * scale - kWindow, kWindow - (y + 0.5) * scale, 0};
}

struct Cosine {
  double smooth = 0;  // error of shading with interpolated normals
  double flat = 0;    // the same with the flat triangles' own shadows
};

Cosine cosine_on_mesh(const Primitive& mesh, const Vec3d& pixel, const Vec3d& light) {
  double best = -1e9;
  Cosine found;
  for (const auto& t : mesh.triangles) {
    const Vec3d a(mesh.positions[t[0]]), b(mesh.positions[t[1]]), c(mesh.positions[t[2]]);
    const Vec3d n = cross(b - a, c - a);
    if (!(n.z > 0)) continue;
    const Vec3d p = {pixel.x, pixel.y, a.z - ((pixel.x - a.x) * n.x + (pixel.y - a.y) * n.y) / n.z};
    const double u = dot(cross(c - b, p - b), n), v = dot(cross(a - c, p - c), n),
                 w = dot(cross(b - a, p - a), n);
    if (u < 0 || v < 0 || w < 0 || p.z < best) continue;
    best = p.z;
    found.smooth = std::fmax(0.0, dot(normalize(a * u + b * v + c * w), light));
    found.flat = dot(n, light) > 0 ? found.smooth : 0;
  }
  return found;
}

struct Distance {
  double rendered = 0, smooth = 0, flat = 0;
};

/// Mean difference from the sphere's cosine where that is between cos 90 and cos 70 degrees.
Distance distance_to_sphere(const Vec3d& light, const render::Affine3d& placement, bool mirrored) {
  const Primitive mesh = icosphere(1);
  EXPECT_EQ(mesh.triangles.size(), 80u);
  EXPECT_EQ(mesh.positions.size(), 42u);
  Scene scene = scene_of(mesh, placement);
  render::PunctualLight sun;
  sun.kind = render::PunctualLight::Kind::directional;
  sun.intensity = {1, 1, 1};
  sun.direction = Vec3f(-light);
  scene.lights.push_back(sun);
  const Picture picture = render_picture(scene, small_settings(kSide, kSide, 8));
  Distance sum;
  int count = 0;
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      Vec3d p = at_pixel(x, y);
      if (!(p.x * p.x + p.y * p.y < 0.8)) continue;  // may miss the mesh, smaller than the sphere
      p.z = std::sqrt(1 - p.x * p.x - p.y * p.y);
      const double cosine = dot(p, light);
      if (!(cosine > 0 && cosine < std::cos(70 * std::numbers::pi / 180))) continue;
      const Vec3d mirrored_p = mirrored ? Vec3d{-p.x, p.y, p.z} : p;
      const Vec3d lit = mirrored ? Vec3d{-light.x, light.y, light.z} : light;
      sum.rendered += std::fabs(picture.at(x, y).x * std::numbers::pi - cosine);
      const Cosine on_mesh = cosine_on_mesh(mesh, mirrored_p, lit);
      sum.smooth += std::fabs(on_mesh.smooth - cosine);
      sum.flat += std::fabs(on_mesh.flat - cosine);
      ++count;
    }
  }
  EXPECT_GT(count, 500);
  return {sum.rendered / count, sum.smooth / count, sum.flat / count};
}

/// With a slab through the middle, which a point that slides along the surface would cross.
Picture lit_with_slab(const Scene& placed) {
  Scene scene = placed;
  Primitive slab;
  slab.material = 1;
  slab.positions = {{-2, 0, -2}, {-2, 0, 2}, {2, 0, 2}, {2, 0, -2}};
  slab.triangles = {{0, 1, 2}, {0, 2, 3}};
  add_primitive(&scene, slab, {});
  render::PunctualLight sun;
  sun.kind = render::PunctualLight::Kind::directional;
  sun.intensity = {1, 1, 1};
  sun.direction = {-0.9f, -0.3f, -0.3f};
  scene.lights.push_back(sun);
  return render_picture(scene, small_settings(kSide, kSide, 8));
}

/// The mesh that `placement` turns into `world`. Normals are not normalised, so that interpolation
/// weights them in object space as in world space.
Primitive seen_through(const render::Affine3d& placement, const Primitive& world) {
  Primitive mesh = world;
  const render::Affine3d inverse = render::inverse(placement).value();
  for (Vec3f& p : mesh.positions) p = Vec3f(transform_point(inverse, Vec3d(p)));
  for (Vec3f& n : mesh.normals) n = Vec3f(transform_normal(placement, Vec3d(n)));
  if (determinant(placement) < 0) {
    for (auto& t : mesh.triangles) std::swap(t[1], t[2]);
  }
  return mesh;
}

/// However a node scales, shears or mirrors, the world's sphere is the same.
TEST(ShadowTerminator, NodeScaleDoesNotMatter) {
  const Primitive sphere = icosphere(1);
  const Picture expected = lit_with_slab(scene_of(sphere, {}));
  const std::array<std::array<Vec3d, 3>, 8> placements = {{
      {{{1e-4, 0, 0}, {0, 1e-4, 0}, {0, 0, 1e-4}}},
      {{{1e4, 0, 0}, {0, 1e4, 0}, {0, 0, 1e4}}},
      {{{1, 0, 0}, {0, 50, 0}, {0, 0, 1}}},
      {{{1e-4, 0, 0}, {0, 1, 0}, {0, 0, 1e4}}},
      {{{1, 2, 0}, {0, 1, 0}, {0, 0, 1}}},
      {{{1e-2, 0, 0}, {3, 100, 0}, {0, 0, 1}}},
      {{{-1, 0, 0}, {0, 1, 0}, {0, 0, 1}}},
      {{{0, -20, 0}, {0.1, 0, 0}, {0, 0, -5}}},
  }};
  for (const auto& rows : placements) {
    render::Affine3d placement;
    placement.rows = rows;
    const Picture picture = lit_with_slab(scene_of(seen_through(placement, sphere), placement));
    double difference = 0;
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kSide; ++x) {
        difference += std::fabs(double{picture.at(x, y).x} - double{expected.at(x, y).x});
      }
    }
    // Corners are rounded to float before and after: few samples lie within 1e-7 of an edge.
    EXPECT_LT(difference / (kSide * kSide), 1e-4) << rows[0].x << " " << rows[1].y;
  }
}

TEST(ShadowTerminator, CoarseSphereIsLitLikeSphere) {
  for (const Vec3d& toward : {Vec3d{1, 0.3, 0.1}, Vec3d{-1, 0.2, 0.4}, Vec3d{0.2, -1, -0.3}}) {
    for (const bool mirrored : {false, true}) {  // other vertex order in memory, same in the world
      const Distance d = distance_to_sphere(
          normalize(toward), mirrored ? scaling(-1, 1, 1) : render::Affine3d{}, mirrored);
      EXPECT_LT(d.rendered, 0.8 * d.flat);
      // Facets leave no shadow; the remaining error is that of interpolated normals.
      EXPECT_NEAR(d.rendered, d.smooth, 0.02 * d.smooth);
    }
  }
}

/// Expects a mean over the pixels that see the mesh from outside, or from its centre.
void expect_furnace(bool inside, double min, double max) {
  Scene scene = scene_of(icosphere(1), {});
  set_constant_sky(&scene, 1);
  if (inside) scene.camera.camera_to_world = {};
  const Picture picture = render_picture(scene, small_settings(24, 24, 64));
  double sum = 0;
  int count = 0;
  for (int y = 0; y < 24; ++y) {
    for (int x = 0; x < 24; ++x) {
      const Vec3d p = at_pixel(4 * x + 2, 4 * y + 2);
      if (p.x * p.x + p.y * p.y > 0.6) continue;
      EXPECT_LE(picture.at(x, y).x, max);
      sum += picture.at(x, y).x;
      ++count;
    }
  }
  EXPECT_GE(sum / count, min);
}

TEST(ShadowTerminator, CoarseWhiteSphereKeepsEnergy) {
  expect_furnace(false, 1 - 1e-5, 1 + 1e-5);  // every path ends in the sky with a weight of 1
}

TEST(ShadowTerminator, CoarseSphereLeaksNoLight) {
  expect_furnace(true, 0, 0);
}

}  // namespace
}  // namespace tessera::testing
