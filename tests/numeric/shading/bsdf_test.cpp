#include "worker/shading/bsdf/bsdf.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "worker/geometry/frame.h"
#include "worker/shading/microfacet/fresnel.h"

namespace tessera::render {
namespace {

/// Tables for one index of refraction, kept alive for the BSDFs of a test.
struct Tables {
  GlassTable entering = GlassTable(1.5);
  GlassTable leaving = GlassTable(1 / 1.5);
  BsdfTables all() const { return {&entering, &leaving}; }
};

const Tables& tables() {
  static const Tables made;
  return made;
}

struct Case {
  std::string name;
  BsdfParameters parameters;
  double albedo_low, albedo_high;  // bounds of the albedo
  BsdfExtensions extensions = {};
  bool extended = false;
  float coat_tilt = 0;  // radians, of the coat's normal
  // Too narrow for the bins, or sampled where the value is zero, which sample() does not return.
  bool unfit_for_chi_square = false;

  bool is_reciprocal() const { return extensions.coat == 0; }
};

BsdfParameters base(float metallic, float roughness) {
  BsdfParameters p;
  p.metallic = metallic;
  p.roughness = roughness;
  return p;
}

/// Coats over bases that scatter all light: only the rough facets of the coat lose energy.
void add_coats(std::vector<Case>* all) {
  BsdfParameters lambert = base(0, 1);
  lambert.specular_weight = 0;
  BsdfParameters thin = base(0, 0.25f);
  thin.transmission = 1;
  thin.interface = Interface::thin;
  for (const float r : {0.0f, 0.25f, 0.5f, 1.0f}) {
    const std::string name = "coat " + std::to_string(r).substr(0, 4) + " over ";
    const double least = r == 0 ? 0.999 : 0.85;
    const BsdfExtensions coat{.coat = 1, .coat_roughness = r};
    all->push_back({name + "lambert", lambert, least, 1, coat, true});
    all->push_back({name + "metal", base(1, 0.5f), least - 0.005, 1.001, coat, true});
    all->push_back({name + "thin", thin, least - 0.01, 1.001, coat, true});
    all->push_back({name + "tilted", lambert, 0.5, 1, coat, true, 0.4f});
  }
  all->push_back({"half a coat", lambert, 0.99, 1, {.coat = 0.5f, .coat_roughness = 0.5f}, true});
}

/// Anisotropic metals and sheets, from a mirror along the other direction upwards.
void add_anisotropic(std::vector<Case>* all) {
  for (const float r : {0.0f, 0.3f, 0.6f}) {
    for (const float strength : {0.3f, 1.0f}) {
      const std::string name =
          std::to_string(r).substr(0, 3) + " strength " + std::to_string(strength).substr(0, 3);
      const BsdfExtensions brushed{.anisotropy = strength};
      all->push_back({"brushed metal " + name, base(1, r), 0.94, 1.001, brushed, true, 0, r == 0});
      BsdfParameters thin = base(0, r);
      thin.transmission = 1;
      thin.interface = Interface::thin;
      all->push_back({"brushed sheet " + name, thin, 0.93, 1.001, brushed, true, 0, r == 0});
    }
  }
  BsdfParameters solid = base(0, 0.4f);
  solid.transmission = 1;
  solid.interface = Interface::solid;
  all->push_back({"brushed glass", solid, 0.5, 1.001, {.anisotropy = 0.7f}, true});
}

/// White sheen over white: choosing the smaller of two scalings loses a little, nothing is gained.
void add_sheen(std::vector<Case>* all) {
  BsdfParameters lambert = base(0, 1);
  lambert.specular_weight = 0;
  for (const float r : {0.0f, 0.1f, 0.3f, 0.6f, 1.0f}) {
    const std::string name = "sheen " + std::to_string(r).substr(0, 3);
    BsdfExtensions sheen;
    sheen.sheen = {1, 1, 1};
    sheen.sheen_roughness = r;
    all->push_back({name, lambert, 0.4, 1.001, sheen, true});
    sheen.coat = 0.5f;
    sheen.coat_roughness = 0.3f;
    all->push_back({name + " under a coat", lambert, 0.4, 1.001, sheen, true});
  }
}

void add_films(std::vector<Case>* all) {
  for (const float thickness : {150.0f, 400.0f, 1200.0f}) {
    const std::string name = "film " + std::to_string(thickness).substr(0, 4) + " on ";
    BsdfExtensions film;
    film.film = {1, 1.8f, thickness};
    film.film.cap = thin_film_cap(film.film, base(0, 0).f0, 0);
    all->push_back({name + "metal", base(1, 0.3f), 0.4, 1.001, film, true});
    all->push_back({name + "dielectric", base(0, 0.5f), 0.85, 1.001, film, true});
    BsdfParameters glass = base(0, 0.3f);
    glass.transmission = 1;
    glass.interface = Interface::thin;
    all->push_back({name + "sheet", glass, 0.3, 1.001, film, true});
    glass.interface = Interface::solid;
    all->push_back({name + "glass", glass, 0.3, 1.001, film, true});
    glass.front = false;
    all->push_back({name + "glass from inside", glass, 0.3, 1.001, film, true});
  }
}

void add_diffuse_transmission(std::vector<Case>* all) {
  BsdfParameters leaf = base(0, 1);
  leaf.specular_weight = 0;
  leaf.interface = Interface::thin;
  BsdfExtensions through;
  through.diffuse_transmission = 0.7f;
  all->push_back({"leaf", leaf, 0.999, 1.001, through, true});
  leaf.specular_weight = 1;
  leaf.roughness = 0.4f;
  all->push_back({"shiny leaf", leaf, 0.998, 1.001, through, true});
  leaf.transmission = 0.5f;
  all->push_back({"half a sheet, half a leaf", leaf, 0.998, 1.001, through, true});
  leaf.transmission = 0;
  leaf.interface = Interface::solid;
  all->push_back({"wax", leaf, 0.98, 1.001, through, true});
  leaf.front = false;
  all->push_back({"wax from inside", leaf, 0.9, 1.001, through, true});
  through.diffuse_transmission = 1;
  leaf.roughness = 0;
  all->push_back({"smooth wax from inside", leaf, 0.98, 1.001, through, true, 0, true});
}

/// Half glass, half diffuse. Inside, the diffuse half must not return light that is totally
/// reflected.
void add_dirty_glass(std::vector<Case>* all) {
  for (const float r : {0.0f, 0.25f, 0.5f, 1.0f}) {
    BsdfParameters dirty = base(0, r);
    dirty.transmission = 0.5f;
    dirty.interface = Interface::solid;
    const std::string name = "dirty glass " + std::to_string(r).substr(0, 4);
    all->push_back({name, dirty, 0.98, 1.001});
    dirty.front = false;
    all->push_back({name + " from inside", dirty, 0.95, 1.001});
    all->back().unfit_for_chi_square = r == 0;
  }
}

/// TESSERA_material: white rough facets, and conductors with almost no absorption.
void add_optics(std::vector<Case>* all) {
  BsdfParameters lambert = base(0, 1);
  lambert.specular_weight = 0;
  for (const float r : {0.3f, 1.0f}) {
    BsdfExtensions rough;
    rough.diffuse_roughness = r;
    const std::string name = "rough diffuse " + std::to_string(r).substr(0, 3);
    all->push_back({name, lambert, 0.995, 1.001, rough, true});
    rough.exact_fresnel = true;
    all->push_back({name + " under a dielectric", base(0, 0.3f), 0.94, 1.001, rough, true});
    rough.coat = 0.5f;
    all->push_back({name + " under half a coat", lambert, 0.985, 1.001, rough, true});
  }
  BsdfExtensions metal;
  metal.conductor = {true, {0.001f, 0.001f, 0.001f}, {30, 30, 30}, {1, 1, 1}};
  for (const float r : {0.25f, 0.5f, 1.0f}) {
    all->push_back(
        {"conductor " + std::to_string(r).substr(0, 4), base(1, r), 0.99, 1.001, metal, true});
  }
}

std::vector<Case> cases() {
  std::vector<Case> all;
  add_optics(&all);
  add_coats(&all);
  add_anisotropic(&all);
  add_sheen(&all);
  add_films(&all);
  add_diffuse_transmission(&all);
  add_dirty_glass(&all);
  BsdfParameters lambert = base(0, 1);
  lambert.specular_weight = 0;
  all.push_back({"lambert", lambert, 1, 1});
  for (const float r : {0.25f, 0.5f, 1.0f}) {
    const std::string name = std::to_string(r).substr(0, 4);
    all.push_back({"dielectric " + name, base(0, r), 0.998, 1.001});
    all.push_back({"metal " + name, base(1, r), 0.995, 1.001});
    BsdfParameters thin = base(0, r);
    thin.transmission = 1;
    thin.interface = Interface::thin;
    all.push_back({"thin " + name, thin, 0.99, 1.001});
    BsdfParameters solid = thin;
    solid.interface = Interface::solid;
    all.push_back({"glass from outside " + name, solid, 0.985, 1.001});
    solid.front = false;
    all.push_back({"glass from inside " + name, solid, 0.98, 1.001});
  }
  BsdfParameters mixed = base(0.5f, 0.4f);
  mixed.transmission = 0.5f;
  mixed.interface = Interface::thin;
  all.push_back({"half metal, half thin", mixed, 0.995, 1.001});
  BsdfParameters gloss = base(0, 0.5f);
  gloss.specular_glossiness = true;
  gloss.f0 = {0.5f, 0.5f, 0.5f};
  gloss.base = {0.5f, 0.5f, 0.5f};
  all.push_back({"specular-glossiness", gloss, 0.3, 1});
  return all;
}

Bsdf bsdf_for(const BsdfParameters& p, double cos_o) {
  const Frame f = Frame::from_normal({0, 0, 1});
  const Vec3f wo(Vec3d{std::sqrt(1 - cos_o * cos_o), 0, cos_o});
  return make_bsdf(p, tables().all(), {f.s, f.t, f.n, f.n}, wo);
}

Bsdf bsdf_for(const Case& c, const Vec3f& wo) {
  const Frame f = Frame::from_normal({0, 0, 1});
  const BsdfFrame frame{f.s, f.t, f.n, f.n};
  if (!c.extended) return make_bsdf(c.parameters, tables().all(), frame, wo);
  const Frame coat = Frame::from_normal({std::sin(c.coat_tilt), 0, std::cos(c.coat_tilt)});
  return make_extended_bsdf(c.parameters, c.extensions, tables().all(), frame,
                            {coat.s, coat.t, coat.n, f.n}, wo);
}

/// Viewed at this cosine; materials with extensions are viewed from the side as well.
Bsdf bsdf_for(const Case& c, double cos_o) {
  const double phi = c.extended ? 0.7 : 0, s = std::sqrt(1 - cos_o * cos_o);
  return bsdf_for(c, Vec3f(Vec3d{s * std::cos(phi), s * std::sin(phi), cos_o}));
}

class Random {
 public:
  explicit Random(std::uint32_t seed) : engine_(seed) {}
  float next() { return static_cast<float>(engine_() >> 8) * 0x1p-24f; }

 private:
  std::mt19937 engine_;
};

constexpr double kCosines[] = {0.98, 0.5, 0.0017};  // the last is 89.9 degrees

TEST(Bsdf, AlbedoNeverExceedsOne) {  // hard cases 38, 46
  for (const Case& c : cases()) {
    for (const double cos_o : kCosines) {
      const Bsdf bsdf = bsdf_for(c, cos_o);
      Random random(7);
      double sum = 0, squares = 0;
      constexpr int kSamples = 60000;
      for (int i = 0; i < kSamples; ++i) {
        const float lobe = random.next(), u1 = random.next(), u2 = random.next();
        BsdfSample s;
        if (!sample_bsdf(bsdf, lobe, {u1, u2}, &s)) continue;
        ASSERT_TRUE(is_finite(s.weight) && std::isfinite(s.pdf)) << c.name;
        const double w = static_cast<double>(luminance(s.weight));
        sum += w;
        squares += w * w;
      }
      const double mean = sum / kSamples;
      const double variance = std::max(squares / kSamples - mean * mean, 0.0);
      const double error = std::sqrt(variance / kSamples);
      EXPECT_GE(mean, c.albedo_low - 4 * error) << c.name << " at " << cos_o;
      EXPECT_LE(mean, c.albedo_high + 4 * error) << c.name << " at " << cos_o;
    }
  }
}

/// Albedo of the specification's dielectric facets, integrated in double: F D V, with the (n.h)^2
/// form of D.
double specification_albedo(double roughness, double cos_o) {
  const double alpha = roughness * roughness, a2 = alpha * alpha;
  const Vec3d v{std::sqrt(1 - cos_o * cos_o), 0, cos_o};
  double sum = 0;
  constexpr int kSteps = 250;
  for (int i = 0; i < kSteps; ++i) {
    const double z = (i + 0.5) / kSteps, s = std::sqrt(1 - z * z);
    for (int j = 0; j < kSteps; ++j) {
      const double phi = std::numbers::pi * (j + 0.5) / kSteps;
      const Vec3d l{s * std::cos(phi), s * std::sin(phi), z};
      const Vec3d h = normalize(v + l);
      const double f = 0.04 + 0.96 * std::pow(1 - dot(v, h), 5);
      const double q = h.z * h.z * (a2 - 1) + 1;
      const double d = a2 / (std::numbers::pi * q * q);
      const double vis = 0.5 / (z * std::sqrt(cos_o * cos_o * (1 - a2) + a2) +
                                cos_o * std::sqrt(z * z * (1 - a2) + a2));
      sum += f * d * vis * z;
    }
  }
  return sum * 2 * std::numbers::pi / kSteps / kSteps;
}

// Facets as specified, and the diffuse lobe that Kulla and Conty couple with them.
TEST(Bsdf, DielectricCouplesDiffuseWithFacets) {  // hard case 46
  constexpr Vec3f kBase = {0.8f, 0.5f, 0.1f};
  for (const float roughness : {0.25f, 0.5f, 1.0f}) {
    const auto r = static_cast<double>(roughness);
    double mean = 0;
    constexpr int kSteps = 16;  // Simpson's rule would do no better: E is steep at 0
    for (int i = 0; i < kSteps; ++i) {
      const double x = (i + 0.5) / kSteps;
      mean += 4 * x * x * x / kSteps * specification_albedo(r, x * x);
    }
    const double a = 0.9, b = 0.3, left_a = 1 - specification_albedo(r, a),
                 left_b = 1 - specification_albedo(r, b);
    BsdfParameters p = base(0, roughness);
    p.base = kBase;
    BsdfParameters black = p;
    black.base = {};
    const Vec3f wi(Vec3d{0, std::sqrt(1 - b * b), b});
    const Vec3d both(evaluate_bsdf(bsdf_for(p, a), wi).f_cos);
    const Vec3d facets(evaluate_bsdf(bsdf_for(black, a), wi).f_cos);
    for (int k = 0; k < 3; ++k) {
      const double expected =
          static_cast<double>(kBase[k]) / std::numbers::pi * left_a * left_b / (1 - mean);
      EXPECT_NEAR((both[k] - facets[k]) / b, expected, 2e-3 * expected) << roughness;
    }
  }
}

/// Expected counts of sample() over bins of (cos, azimuth), from the density.
constexpr int kRows = 20, kColumns = 20, kSub = 32;

std::vector<double> expected_counts(const Bsdf& bsdf, int samples) {
  std::vector<double> counts(kRows * kColumns);
  const double cell = 4 * std::numbers::pi / (kRows * kColumns * kSub * kSub);
  for (int i = 0; i < kRows * kSub; ++i) {
    const double z = -1 + 2 * (i + 0.5) / (kRows * kSub), s = std::sqrt(1 - z * z);
    for (int j = 0; j < kColumns * kSub; ++j) {
      const double phi = 2 * std::numbers::pi * (j + 0.5) / (kColumns * kSub);
      const Vec3f wi(Vec3d{s * std::cos(phi), s * std::sin(phi), z});
      const auto bin = static_cast<std::size_t>((i / kSub) * kColumns + j / kSub);
      counts[bin] += samples * cell * static_cast<double>(evaluate_bsdf(bsdf, wi).pdf);
    }
  }
  return counts;
}

std::vector<double> observed_counts(const Bsdf& bsdf, int samples, std::uint32_t seed) {
  std::vector<double> counts(kRows * kColumns);
  Random random(seed);
  for (int i = 0; i < samples; ++i) {
    const float lobe = random.next(), u1 = random.next(), u2 = random.next();
    BsdfSample s;
    if (!sample_bsdf(bsdf, lobe, {u1, u2}, &s) || s.delta) continue;
    double phi = std::atan2(static_cast<double>(s.wi.y), static_cast<double>(s.wi.x));
    if (phi < 0) phi += 2 * std::numbers::pi;
    const int row =
        std::min(static_cast<int>((static_cast<double>(s.wi.z) + 1) / 2 * kRows), kRows - 1);
    const int column =
        std::min(static_cast<int>(phi / (2 * std::numbers::pi) * kColumns), kColumns - 1);
    counts[static_cast<std::size_t>(row * kColumns + column)] += 1;
  }
  return counts;
}

TEST(Bsdf, SamplesFollowDensity) {  // hard case 48
  constexpr int kSamples = 150000;
  std::uint32_t seed = 1;
  for (const Case& c : cases()) {
    if (c.unfit_for_chi_square) continue;
    for (const double cos_o : {0.98, 0.5, 0.1}) {
      const Bsdf bsdf = bsdf_for(c, cos_o);
      const auto expected = expected_counts(bsdf, kSamples);
      const auto observed = observed_counts(bsdf, kSamples, seed++);
      double chi2 = 0, pooled_expected = 0, pooled_observed = 0;
      int freedom = 0;
      for (std::size_t i = 0; i < expected.size(); ++i) {
        if (expected[i] < 5) {
          pooled_expected += expected[i];
          pooled_observed += observed[i];
          continue;
        }
        const double d = observed[i] - expected[i];
        // The quadrature of the density has an error of half a percent of a bin.
        chi2 += d * d / (expected[i] + 2.5e-5 * expected[i] * expected[i]);
        ++freedom;
      }
      if (pooled_expected > 5) {
        const double d = pooled_observed - pooled_expected;
        chi2 += d * d / pooled_expected;
        ++freedom;
      }
      // Wilson-Hilferty: normal to within a percent; 4.5 sigma for the whole table of cases.
      const double k = freedom;
      const double z = (std::cbrt(chi2 / k) - (1 - 2 / (9 * k))) / std::sqrt(2 / (9 * k));
      EXPECT_LT(z, 4.5) << c.name << " at " << cos_o << ": chi2 " << chi2 << " of " << freedom;
    }
  }
}

TEST(Bsdf, ReflectionIsReciprocal) {  // hard case 47
  Random random(3);
  for (const Case& c : cases()) {
    if (c.parameters.interface != Interface::opaque || !c.is_reciprocal()) continue;
    for (int i = 0; i < 2000; ++i) {
      const float phi = 6.2831f * random.next(), a = random.next() * 0.99f + 0.005f,
                  b = random.next() * 0.99f + 0.005f;
      const Vec3f wa{std::sqrt(1 - a * a), 0, a};
      const Vec3f wb{std::sqrt(1 - b * b) * std::cos(phi), std::sqrt(1 - b * b) * std::sin(phi), b};
      const Bsdf from_a = bsdf_for(c, wa), from_b = bsdf_for(c, wb);
      const float there = evaluate_bsdf(from_a, wb).f_cos.x / b;
      const float back = evaluate_bsdf(from_b, wa).f_cos.x / a;
      ASSERT_NEAR(there, back, 1e-5f * (1 + there)) << c.name;
    }
  }
}

TEST(Bsdf, RefractionIsReciprocalUpToEtaSquared) {  // hard case 47
  Random random(4);
  BsdfParameters p = base(0, 0.5f);
  p.transmission = 1;
  p.interface = Interface::solid;
  const Frame f = Frame::from_normal({0, 0, 1});
  const BsdfFrame outside{f.s, f.t, f.n, f.n};
  const BsdfFrame inside{f.s, -f.t, -f.n, -f.n};
  int lit = 0;
  for (int i = 0; i < 20000; ++i) {
    const float phi = 6.2831f * random.next(), a = random.next() * 0.98f + 0.01f,
                b = random.next() * 0.98f + 0.01f;
    const Vec3f wa{std::sqrt(1 - a * a), 0, a};
    const Vec3f wb{std::sqrt(1 - b * b) * std::cos(phi), std::sqrt(1 - b * b) * std::sin(phi), -b};
    p.front = true;
    const Bsdf from_a = make_bsdf(p, tables().all(), outside, wa);
    p.front = false;
    const Bsdf from_b = make_bsdf(p, tables().all(), inside, wb);
    // Radiance in a medium of index n is scaled by n^2; the compensation of rough glass depends on
    // wo.
    const double there = static_cast<double>(evaluate_bsdf(from_a, wb).f_cos.x) / b / 2.25 /
                         static_cast<double>(from_a.transmit_gain);
    const double back = static_cast<double>(evaluate_bsdf(from_b, wa).f_cos.x) / a /
                        static_cast<double>(from_b.transmit_gain);
    ASSERT_NEAR(there, back, 2e-3 * there + 1e-6);
    lit += there > 1e-6 ? 1 : 0;
  }
  EXPECT_GT(lit, 2000) << "too few directions hit the lobe";
}

TEST(Bsdf, MirrorAndNarrowLobeMatch) {  // hard case 37
  for (const float alpha : {0.999e-3f, 1.001e-3f}) {
    const Bsdf bsdf = bsdf_for(base(1, std::sqrt(alpha)), 0.6);
    EXPECT_EQ(bsdf.mirror, alpha < 1e-3f);
    Random random(5);
    double sum = 0;
    int near = 0;
    for (int i = 0; i < 20000; ++i) {
      const float lobe = random.next(), u1 = random.next(), u2 = random.next();
      BsdfSample s;
      if (!sample_bsdf(bsdf, lobe, {u1, u2}, &s)) continue;
      near += dot(s.wi, Vec3f{-0.8f, 0, 0.6f}) > 0.9998f ? 1 : 0;  // within 20 alpha
      sum += static_cast<double>(s.weight.x);
    }
    EXPECT_NEAR(sum / 20000, 1, 5e-3) << alpha;
    EXPECT_GT(near, 18500) << alpha;
  }
}

TEST(Bsdf, ReflectionStaysOnItsSide) {
  // The shading normal is 60 degrees off: directions between the two planes are dark.
  const Vec3f n = normalize(Vec3f{std::sqrt(0.75f), 0, 0.5f});
  const Frame f = Frame::from_normal(n);
  const Bsdf bsdf = make_bsdf(base(0, 0.3f), tables().all(), {f.s, f.t, n, {0, 0, 1}},
                              normalize(Vec3f{0.5f, 0, 1}));
  Random random(9);
  for (int i = 0; i < 20000; ++i) {
    const float lobe = random.next(), u1 = random.next(), u2 = random.next();
    BsdfSample s;
    if (!sample_bsdf(bsdf, lobe, {u1, u2}, &s)) continue;
    ASSERT_GT(s.wi.z, 0);
    ASSERT_FALSE(s.transmitted);
  }
  const BsdfValue below = evaluate_bsdf(bsdf, normalize(Vec3f{1, 0, -0.1f}));
  EXPECT_EQ(below.f_cos, Vec3f{});
}

// Where the interpolated normal would mirror light into the surface, the geometric normal mirrors
// it.
TEST(Bsdf, SmoothGlassMirrorsAtGeometricNormal) {
  BsdfParameters glass = base(0, 0);
  glass.transmission = 1;
  glass.interface = Interface::solid;
  // The normals enclose 60 degrees; a viewer 10 degrees off the geometric one is mirrored to 110.
  const Frame f = Frame::from_normal(normalize(Vec3f{std::sqrt(0.75f), 0, 0.5f}));
  const float sine = std::sin(0.1745f), cosine = std::cos(0.1745f);
  const Bsdf bsdf = make_bsdf(glass, tables().all(), {f.s, f.t, f.n, {0, 0, 1}}, {sine, 0, cosine});
  int mirrored = 0, refracted = 0;
  for (int i = 0; i < 1000; ++i) {
    BsdfSample s;
    ASSERT_TRUE(sample_bsdf(bsdf, (static_cast<float>(i) + 0.5f) / 1000, {0.5f, 0.5f}, &s));
    if (s.transmitted) {
      ASSERT_LT(s.wi.z, 0);
      ++refracted;
    } else {  // within a few roundings of unit vectors
      ASSERT_LT(length(s.wi - Vec3f{-sine, 0, cosine}), 1e-6f);
      ++mirrored;
    }
  }
  EXPECT_GT(mirrored, 0);
  EXPECT_GT(refracted, 0);
}

// Each side of a leaf is chosen with its share of the light, so that all samples weigh the same.
TEST(Bsdf, SidesOfLeafAreSampledByTheirEnergy) {
  Case leaf{"leaf", base(0, 1), 0, 1};
  leaf.parameters.specular_weight = 0;
  leaf.parameters.interface = Interface::thin;
  leaf.parameters.base = {0.5f, 0.5f, 0.5f};
  leaf.extensions.diffuse_transmission = 0.7f;
  leaf.extended = true;
  const Bsdf bsdf = bsdf_for(leaf, 0.5);
  Random random(11);
  float least = 1, most = 0;
  int transmitted = 0;
  for (int i = 0; i < 1000; ++i) {
    const float lobe = random.next(), u1 = random.next(), u2 = random.next();
    BsdfSample s;
    ASSERT_TRUE(sample_bsdf(bsdf, lobe, {u1, u2}, &s));
    least = std::min(least, s.weight.x);
    most = std::max(most, s.weight.x);
    transmitted += s.transmitted ? 1 : 0;
  }
  EXPECT_LT(most / least, 1 + 1e-5f);
  EXPECT_GT(transmitted, 0);
  EXPECT_LT(transmitted, 1000);
}

// Materials without extensions use the plain code. Results differ only by rounding: one evaluates
// the direction in the world, the other in the frame.
TEST(Bsdf, NeutralExtensionsMatchPlainBsdf) {
  for (Case c : cases()) {
    if (c.extended) continue;
    for (const double cos_o : kCosines) {
      const Vec3f wo(Vec3d{std::sqrt(1 - cos_o * cos_o), 0, cos_o});
      c.extended = false;
      const Bsdf plain = bsdf_for(c, wo);
      c.extended = true;
      const Bsdf extended = bsdf_for(c, wo);
      ASSERT_TRUE(extended.extended.has_value());
      Random random(10);
      for (int i = 0; i < 2000; ++i) {
        const float lobe = random.next(), u1 = random.next(), u2 = random.next();
        BsdfSample a, b;
        const bool drawn = sample_bsdf(plain, lobe, {u1, u2}, &a);
        ASSERT_EQ(sample_bsdf(extended, lobe, {u1, u2}, &b), drawn) << c.name;
        if (!drawn) continue;
        ASSERT_EQ(a.wi, b.wi) << c.name;
        ASSERT_EQ(a.transmitted, b.transmitted) << c.name;
        ASSERT_EQ(a.delta, b.delta) << c.name;
        const BsdfValue there = evaluate_bsdf(plain, a.wi), same = evaluate_bsdf(extended, a.wi);
        ASSERT_EQ(there.f_cos, same.f_cos) << c.name;
        ASSERT_EQ(there.pdf, same.pdf) << c.name;
        ASSERT_EQ(b.pdf, a.delta ? a.pdf : there.pdf) << c.name;
        ASSERT_EQ(b.weight, a.delta ? a.weight : there.f_cos / there.pdf) << c.name;
      }
    }
  }
}

TEST(Bsdf, IorZeroReflectsEverything) {  // hard case 41
  BsdfParameters p = base(0, 0);
  p.ior = 0;
  p.f0 = {f0_from_ior(0), f0_from_ior(0), f0_from_ior(0)};
  p.transmission = 1;
  p.interface = Interface::solid;
  const Bsdf bsdf = bsdf_for(p, 0.7);
  BsdfSample s;
  ASSERT_TRUE(sample_bsdf(bsdf, 0.3f, {0.5f, 0.5f}, &s));
  EXPECT_FALSE(s.transmitted);
  EXPECT_EQ(s.weight, (Vec3f{1, 1, 1}));
}

}  // namespace
}  // namespace tessera::render
