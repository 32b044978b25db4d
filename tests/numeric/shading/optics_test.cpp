/// TESSERA_material: conductors, exact dielectrics and rough diffuse reflection against complex
/// arithmetic and integrals in double. bsdf_test.cpp tests furnace, chi-square and reciprocity.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "tests/support/scene/gltf_builder.h"
#include "tests/support/scene/memory_scene.h"
#include "worker/shading/bsdf/bsdf.h"
#include "worker/shading/microfacet/fresnel.h"
#include "worker/shading/microfacet/rough_diffuse.h"
#include "worker/shading/surface/shading_scene.h"
#include "worker/shading/surface/surface.h"

namespace tessera::testing {
namespace {

using render::fresnel_conductor;
using render::fresnel_dielectric;
using render::Vec3d;
using render::Vec3f;

/// Fresnel's equations with a complex index.
double fresnel(double cos_i, std::complex<double> index) {
  const double s2 = 1 - cos_i * cos_i;
  const std::complex<double> cos_t = std::sqrt(1.0 - s2 / (index * index));
  const auto s = (cos_i - index * cos_t) / (cos_i + index * cos_t);
  const auto p = (index * cos_i - cos_t) / (index * cos_i + cos_t);
  return 0.5 * (std::norm(s) + std::norm(p));
}

TEST(Conductor, MatchesComplexFresnel) {
  for (const double n : {0.05, 0.2, 1.0, 1.5, 3.0, 30.0}) {
    for (const double k : {0.0, 1e-3, 0.5, 3.0, 30.0}) {
      for (int i = 0; i < 28; ++i) {
        const double c = 0.001 + 0.037 * i;
        const double expected = fresnel(c, {n, k});
        EXPECT_NEAR(double{fresnel_conductor(static_cast<float>(c), static_cast<float>(n),
                                             static_cast<float>(k))},
                    expected, 2e-6)
            << n << " " << k << " " << c;
      }
    }
  }
  for (int i = 0; i <= 20; ++i) {  // hard case 39
    const float c = static_cast<float>(i) / 20;
    EXPECT_NEAR(fresnel_conductor(c, 1.5f, 0), fresnel_dielectric(c, 1.5f), 1e-6);
  }
  EXPECT_EQ(fresnel_conductor(0, 0.2f, 3), 1);
  EXPECT_EQ(fresnel_conductor(0, 1, 0), 1);
}

double albedo(const render::RoughDiffuse& d, const Vec3f& wo) {
  double sum = 0;
  constexpr int kSteps = 400;
  for (int i = 0; i < kSteps; ++i) {
    const double z = std::sqrt((i + 0.5) / kSteps), s = std::sqrt(1 - z * z);
    for (int j = 0; j < kSteps; ++j) {
      const double phi = 2 * std::numbers::pi * (j + 0.5) / kSteps;
      sum += double{rough_diffuse(d, wo, Vec3f(Vec3d{s * std::cos(phi), s * std::sin(phi), z})).x};
    }
  }
  return sum / kSteps / kSteps;
}

/// Albedo of single scattering: the paper's equation for FON's directional albedo.
double single_albedo(double mu, double r) {
  const double si = std::sqrt(1 - mu * mu);
  const double g = si * (std::acos(mu) - si * mu) + 2.0 / 3 * (si / mu * (1 - si * si * si) - si);
  return (1 + r * g / std::numbers::pi) / (1 + r * (0.5 - 2 / (3 * std::numbers::pi)));
}

TEST(RoughDiffuse, ConservesEnergyAndMatchesFormula) {
  for (const float r : {0.0f, 0.3f, 1.0f}) {
    for (const double mu : {0.05, 0.3, 0.7, 1.0}) {
      const Vec3f wo(Vec3d{std::sqrt(1 - mu * mu), 0, mu});
      // The fit of the directional albedo is precise to 1e-3.
      EXPECT_NEAR(double{render::eon::single_albedo(static_cast<float>(mu), r)},
                  single_albedo(mu, double{r}), 1e-3);
      EXPECT_NEAR(albedo(render::make_rough_diffuse({1, 1, 1}, r, wo.z), wo), 1, 3e-3)
          << r << " " << mu;
      // Black facets scatter only once.
      EXPECT_NEAR(albedo(render::make_rough_diffuse({0, 0, 0}, r, wo.z), wo),
                  single_albedo(mu, double{r}), 3e-3);
      // Grey facets: the remainder is scattered again with albedo rho.
      const double one = single_albedo(mu, double{r});
      double mean = 0;
      for (int i = 0; i < 1000; ++i) mean += single_albedo(std::sqrt((i + 0.5) / 1000), double{r});
      mean /= 1000;
      const double grey = one + (1 - one) * 0.5 * mean / (1 - 0.5 * (1 - mean));
      EXPECT_NEAR(albedo(render::make_rough_diffuse({0.5f, 0.5f, 0.5f}, r, wo.z), wo), grey, 3e-3);
    }
  }
}

TEST(RoughDiffuse, ZeroRoughnessIsLambert) {
  const Vec3f wo(Vec3d{0.8, 0, 0.6}), back = wo, away{-wo.x, 0, wo.z};
  const auto rough = render::make_rough_diffuse({0.5f, 0.5f, 0.5f}, 1, wo.z);
  EXPECT_GT(rough_diffuse(rough, wo, back).x, 1.3 * double{rough_diffuse(rough, wo, away).x});
  const auto smooth = render::make_rough_diffuse({0.5f, 0.5f, 0.5f}, 0, wo.z);
  EXPECT_EQ(rough_diffuse(smooth, wo, back), (Vec3f{1, 1, 1}));
  EXPECT_EQ(rough_diffuse(smooth, wo, away), (Vec3f{1, 1, 1}));
}

/// Reflectance at cosine c of a smooth material with this TESSERA_material.
Vec3f mirrored(const std::string& optics, const std::string& pbr, float c) {
  GltfBuilder file;
  file.use_extension("TESSERA_material");
  const int material =
      file.add_material(R"({"pbrMetallicRoughness": )" + pbr +
                        R"(, "extensions": {"TESSERA_material": )" + optics + "}}");
  file.add_node_with_mesh(file.add_mesh(unit_quad(material)));
  const auto scene = load_and_pose(file);
  EXPECT_TRUE(scene.ok()) << scene.status();
  if (!scene.ok()) return {};
  const render::ShadingScene shading(*scene);
  const auto point = surface_at(shading, {0, 0, 0}, 0.3f, 0.3f, {0, 0, -1});
  const Vec3f wo{std::sqrt(1 - c * c), 0, c};
  const auto bsdf = bsdf_at(shading, point, base_color_at(shading, point), wo);
  render::BsdfSample sample;
  EXPECT_TRUE(sample_bsdf(bsdf, 0.999f, {0.5f, 0.5f}, &sample));
  EXPECT_TRUE(sample.delta);
  return sample.weight * (1 - bsdf.cosine_probability);
}

TEST(TesseraMaterial, GoldMatchesItsTable) {
  const std::string gold = R"({"conductor": {"metal": "gold"}})";
  const std::string smooth = R"({"roughnessFactor": 0})";
  for (const float c : {1.0f, 0.4f, 0.1f}) {
    const Vec3f f = mirrored(gold, smooth, c);
    EXPECT_NEAR(f.x, fresnel(double{c}, {0.143119, 3.98316}), 2e-6);
    EXPECT_NEAR(f.y, fresnel(double{c}, {0.374957, 2.385721}), 2e-6);
    EXPECT_NEAR(f.z, fresnel(double{c}, {1.442479, 1.603215}), 2e-6);
  }
  const std::string numbers = R"({"conductor": {"n": [1, 2, 3], "k": [4, 5, 6]}})";
  const Vec3f tinted =
      mirrored(numbers, R"({"roughnessFactor": 0, "baseColorFactor": [0.5, 1, 1, 1]})", 0.5f);
  EXPECT_NEAR(tinted.x, 0.5 * fresnel(0.5, {1, 4}), 2e-6);
  EXPECT_NEAR(tinted.y, fresnel(0.5, {2, 5}), 2e-6);
}

TEST(TesseraMaterial, SelectsExactOrSchlickFresnel) {
  const std::string smooth = R"({"roughnessFactor": 0, "metallicFactor": 0})";
  double largest = 0;
  for (int i = 1; i <= 50; ++i) {
    const float c = static_cast<float>(i) / 50;
    const Vec3f exact = mirrored(R"({"fresnel": "exact"})", smooth, c);
    const Vec3f schlick = mirrored(R"({"fresnel": "schlick"})", smooth, c);
    EXPECT_NEAR(exact.x, fresnel(double{c}, {1.5, 0}), 2e-6);
    EXPECT_NEAR(schlick.x, 0.04 + 0.96 * std::pow(1 - double{c}, 5), 2e-6);
    largest = std::max(largest, std::fabs(double{exact.x} - double{schlick.x}));
  }
  EXPECT_NEAR(largest, 0.0357, 2e-4);  // hard case 39
}

TEST(TesseraMaterial, RejectsInvalidProperties) {
  const std::string at = "materials[0].extensions.TESSERA_material";
  const auto refusal = [](const std::string& extension) {
    GltfBuilder file;
    file.use_extension("TESSERA_material");
    const int material =
        file.add_material(R"({"extensions": {"TESSERA_material": )" + extension + "}}");
    file.add_node_with_mesh(file.add_mesh(unit_quad(material)));
    return std::string(load_and_pose(file).status().message());
  };
  for (const auto& [extension, fault] : std::vector<std::pair<std::string, std::string>>{
           {R"({"metal": "gold"})", ".metal: unknown property; expected one of conductor"},
           {R"({"conductor": {"metal": "pyrite"}})", ".conductor.metal: must be one of aluminium"},
           {R"({"conductor": {"metal": "gold", "k": [1, 1, 1]}})",
            ".conductor: has both metal and"},
           {R"({"conductor": {"n": [1, 1, 1]}})", ".conductor: has no k"},
           {R"({"conductor": {"n": [0, 1, 1], "k": [1, 1, 1]}})", ".conductor.n: is not in [0.001"},
           {R"({"conductor": {"n": [1, 1, 1], "k": [1, -1, 1]}})", ".conductor.k: is not in [0,"},
           {R"({"fresnel": "cook"})", ".fresnel: is not exact or schlick"},
           {R"({"diffuseRoughness": 2})", ".diffuseRoughness: 2 is not in [0, 1]"}}) {
    EXPECT_NE(refusal(extension).find(at + fault), std::string::npos) << extension << "\n"
                                                                      << refusal(extension);
  }
}

}  // namespace
}  // namespace tessera::testing
