#include "worker/gltf/decode/tangents.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

namespace tessera::render {
namespace {

/// A torus of `n` x `n` quads with exact normals and, in `authored`, the direction of u.
Primitive torus(int n, std::vector<Vec3d>* authored, bool mirrored = false) {
  Primitive p;
  for (int j = 0; j <= n; ++j) {
    for (int i = 0; i <= n; ++i) {
      const double u = 2 * std::numbers::pi * i / n, v = 2 * std::numbers::pi * j / n;
      const double ring = 3 + std::cos(v);
      p.positions.push_back(Vec3f(Vec3d{ring * std::cos(u), ring * std::sin(u), std::sin(v)}));
      p.normals.push_back(
          Vec3f(Vec3d{std::cos(v) * std::cos(u), std::cos(v) * std::sin(u), std::sin(v)}));
      const float s = static_cast<float>(i) / static_cast<float>(n);
      p.uv[0].push_back({mirrored ? 1 - s : s, static_cast<float>(j) / static_cast<float>(n)});
      if (authored != nullptr) authored->push_back({-std::sin(u), std::cos(u), 0});
    }
  }
  const auto at = [n](int i, int j) { return static_cast<std::uint32_t>(j * (n + 1) + i); };
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i) {
      p.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      p.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  }
  return p;
}

TEST(Tangents, MatchAuthoredOnesOnTorus) {
  std::vector<Vec3d> authored;
  const Primitive p = torus(96, &authored);
  const std::vector<Vec4f> tangents = corner_tangents(p, 0);
  int good = 0;
  for (std::size_t c = 0; c < tangents.size(); ++c) {
    const Vec3d want = authored[p.triangles[c / 3][c % 3]];
    const double cosine = dot(normalize(Vec3d(tangents[c].xyz())), want);
    good += cosine > std::cos(std::numbers::pi / 180) ? 1 : 0;
    EXPECT_GT(cosine, 0.99);
  }
  EXPECT_GE(good, static_cast<int>(tangents.size() * 99 / 100));
}

TEST(Tangents, SignPointsBitangentAgainstV) {
  // glTF: bitangent = cross(n, t) * w points to the texture's top, against v, which runs down.
  for (const bool mirrored : {false, true}) {
    const Primitive p = torus(16, nullptr, mirrored);
    const std::vector<Vec4f> tangents = corner_tangents(p, 0);
    for (std::size_t c = 0; c < tangents.size(); ++c) {
      const std::uint32_t v = p.triangles[c / 3][c % 3];
      const auto row = v / 17;
      const double angle = 2 * std::numbers::pi * row / 16;
      const double around = 2 * std::numbers::pi * (v % 17) / 16;
      const Vec3d along_v = {-std::sin(angle) * std::cos(around),
                             -std::sin(angle) * std::sin(around), std::cos(angle)};
      const Vec3f bitangent = cross(p.normals[v], tangents[c].xyz()) * tangents[c].w;
      EXPECT_LT(dot(Vec3d(bitangent), along_v), -0.9);
    }
  }
}

TEST(Tangents, AreUnitAndPerpendicularToNormal) {
  const Primitive p = torus(16, nullptr);
  const std::vector<Vec4f> tangents = corner_tangents(p, 0);
  for (std::size_t c = 0; c < tangents.size(); ++c) {
    EXPECT_NEAR(length(tangents[c].xyz()), 1, 1e-6);
    EXPECT_NEAR(dot(tangents[c].xyz(), p.normals[p.triangles[c / 3][c % 3]]), 0, 1e-6);
    EXPECT_TRUE(tangents[c].w == 1 || tangents[c].w == -1);
  }
}

/// Two triangles folded along their shared edge, facing +z; the second one's u runs back when
/// `mirrored`.
Primitive folded_pair(bool mirrored) {
  Primitive p;
  p.positions = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {2, 0, 0}};
  p.normals.assign(4, {0, 0, 1});
  p.uv[0] = {{0, 0}, {1, 0}, {1, 1}, {mirrored ? 0.0f : 2.0f, 0}};
  p.triangles = {{0, 1, 2}, {1, 3, 2}};
  return p;
}

TEST(Tangents, SplitOnlyAtMirrorSeams) {
  const auto straight = corner_tangents(folded_pair(false), 0);
  EXPECT_EQ(straight[1], straight[3]);
  EXPECT_EQ(straight[2], straight[5]);
  const auto seam = corner_tangents(folded_pair(true), 0);
  EXPECT_EQ(seam[1], (Vec4f{1, 0, 0, -1}));
  EXPECT_EQ(seam[3], (Vec4f{-1, 0, 0, 1}));
}

TEST(Tangents, TrianglesAreWeightedByAngle) {
  // At the origin a triangle of 90 degrees, u along +x, meets one of 45 degrees, u along (1, -1).
  Primitive p;
  p.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {-1, 1, 0}};
  p.normals.assign(4, {0, 0, 1});
  p.uv[0] = {{0, 0}, {1, 0}, {0, 1}, {-1, 0}};
  p.triangles = {{0, 1, 2}, {0, 2, 3}};
  const std::vector<Vec4f> tangents = corner_tangents(p, 0);
  const Vec3d want = normalize(Vec3d{2 + std::sqrt(0.5), -std::sqrt(0.5), 0});
  for (const std::size_t corner : {0u, 3u}) {
    const Vec3d got(tangents[corner].xyz());
    EXPECT_NEAR(got.x, want.x, 1e-7);
    EXPECT_NEAR(got.y, want.y, 1e-7);
  }
}

/// A sphere without its poles of 16 x 32 quads, each split along the diagonal that `falls` chooses.
Primitive quad_sphere(const std::function<bool(int, int)>& falls) {
  Primitive p;
  for (int j = 0; j <= 16; ++j) {
    for (int i = 0; i <= 32; ++i) {
      const double around = 2 * std::numbers::pi * i / 32, down = std::numbers::pi * (j + 1) / 18;
      const Vec3f n(Vec3d{std::sin(down) * std::cos(around), std::cos(down),
                          -std::sin(down) * std::sin(around)});
      p.positions.push_back(n);
      p.normals.push_back(n);
      p.uv[0].push_back({static_cast<float>(i) / 32, static_cast<float>(j) / 16});
    }
  }
  const auto at = [](int i, int j) { return static_cast<std::uint32_t>(j * 33 + i); };
  for (int j = 0; j < 16; ++j) {
    for (int i = 0; i < 32; ++i) {
      const std::uint32_t a = at(i, j), b = at(i, j + 1), c = at(i + 1, j + 1), d = at(i + 1, j);
      if (falls(i, j)) {
        p.triangles.push_back({a, c, d});
        p.triangles.push_back({a, b, c});
      } else {
        p.triangles.push_back({a, b, d});
        p.triangles.push_back({b, c, d});
      }
    }
  }
  return p;
}

/// Tangent at vertex `v` by the method's definition, over all triangles of the vertex; correct if
/// these form one group.
Vec3d tangent_at(const Primitive& p, std::uint32_t v) {
  const Vec3d n(p.normals[v]);
  const auto in_plane = [&](const Vec3d& x) { return normalize(x - n * dot(n, x)); };
  Vec3d sum;
  for (const auto& t : p.triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      if (t[k] != v) continue;
      const std::uint32_t b = t[(k + 1) % 3], c = t[(k + 2) % 3];
      const Vec3d e = Vec3d(p.positions[b]) - Vec3d(p.positions[v]);
      const Vec3d f = Vec3d(p.positions[c]) - Vec3d(p.positions[v]);
      const Vec2f du = p.uv[0][b] - p.uv[0][v], dv = p.uv[0][c] - p.uv[0][v];
      const Vec3d along_u = (e * static_cast<double>(dv.y) - f * static_cast<double>(du.y)) /
                            (static_cast<double>(du.x) * dv.y - static_cast<double>(du.y) * dv.x);
      sum += in_plane(along_u) * std::acos(dot(in_plane(e), in_plane(f)));
    }
  }
  return normalize(sum);
}

TEST(Tangents, SphereMatchesMethodForEitherSplit) {
  // Exporters and the tangents' author split quads differently; on coarse spheres that alone
  // rotates tangents by degrees, so each split has its own expected tangents.
  const std::vector<std::function<bool(int, int)>> splits = {
      [](int, int) { return true; }, [](int, int) { return false; },
      [](int i, int j) { return (i * 7 + j * 13) % 5 < 2; }};
  for (const auto& falls : splits) {
    const Primitive p = quad_sphere(falls);
    const std::vector<Vec4f> tangents = corner_tangents(p, 0);
    for (std::size_t c = 0; c < tangents.size(); ++c) {
      const std::uint32_t v = p.triangles[c / 3][c % 3];
      EXPECT_GT(dot(Vec3d(tangents[c].xyz()), tangent_at(p, v)), 1 - 1e-7) << v;
    }
  }
}

TEST(Tangents, SplitVerticesKeepAttributes) {
  BasePrimitive base;
  base.primitive = folded_pair(true);
  base.primitive.colors = {{0, 0, 0, 1}, {0.25f, 0, 0, 1}, {0.5f, 0, 0, 1}, {0.75f, 0, 0, 1}};
  base.targets.push_back({{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}}, {}, {}});
  base.influences.push_back({{{0, 0, 0, 0}, {1, 0, 0, 0}, {2, 0, 0, 0}, {3, 0, 0, 0}},
                             {{1, 0, 0, 0}, {1, 0, 0, 0}, {1, 0, 0, 0}, {1, 0, 0, 0}}});
  add_tangents(base, 0);
  const Primitive& p = base.primitive;
  ASSERT_EQ(p.positions.size(), 6u) << "vertices 1 and 2 lie on the seam";
  ASSERT_EQ(p.tangents.size(), 6u);
  const Primitive before = folded_pair(true);
  for (std::size_t c = 0; c < 6; ++c) {
    const std::uint32_t now = p.triangles[c / 3][c % 3], was = before.triangles[c / 3][c % 3];
    EXPECT_EQ(p.positions[now], before.positions[was]);
    EXPECT_EQ(p.uv[0][now], before.uv[0][was]);
    EXPECT_EQ(p.colors[now].x, 0.25f * static_cast<float>(was));
    EXPECT_EQ(base.targets[0].positions[now].x, static_cast<float>(was));
    EXPECT_EQ(base.influences[0].joints[now][0], was);
  }
}

TEST(Tangents, DegenerateInputGivesUnitTangents) {
  Primitive p;
  p.positions = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {1, 1, 0}, {3, 0, 0}};
  p.uv[0] = {{0, 0}, {0, 0}, {0, 0}, {0.5f, 0.5f}, {0.5f, 0.5f}};
  p.triangles = {{0, 1, 2}, {1, 2, 3}, {0, 0, 0}, {1, 4, 0}};
  for (const bool with_normals : {false, true}) {
    if (with_normals) p.normals.assign(5, {0, 1, 0});
    for (const Vec4f& t : corner_tangents(p, 0)) EXPECT_NEAR(length(t.xyz()), 1, 1e-6);
  }
}

TEST(Tangents, FirstCornerDoesNotMatter) {
  Primitive a = torus(12, nullptr), b = a;
  for (auto& t : b.triangles) t = {t[1], t[2], t[0]};
  const auto ta = corner_tangents(a, 0), tb = corner_tangents(b, 0);
  for (std::size_t f = 0; f < a.triangles.size(); ++f) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec4f x = ta[3 * f + (k + 1) % 3], y = tb[3 * f + k];
      EXPECT_GT(dot(x.xyz(), y.xyz()), 1 - 1e-6f);
    }
  }
}

}  // namespace
}  // namespace tessera::render
