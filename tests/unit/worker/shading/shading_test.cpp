#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include "worker/geometry/frame.h"
#include "worker/sampling/sampler.h"
#include "worker/sampling/warp.h"
#include "worker/shading/bsdf/bsdf.h"
#include "worker/shading/microfacet/dispersion.h"
#include "worker/shading/microfacet/fresnel.h"
#include "worker/shading/microfacet/microfacet.h"
#include "worker/shading/microfacet/thin_film.h"
#include "worker/shading/tables/facet_albedo.h"
#include "worker/shading/tables/facet_quadrature.h"
#include "worker/shading/tables/glass_albedo.h"
#include "worker/shading/texture/srgb.h"
#include "worker/shading/texture/texture.h"

namespace tessera::render {
namespace {

double cos_degrees(double degrees) {
  return std::cos(degrees * std::numbers::pi / 180);
}

TEST(Bsdf, LambertSpecialisationMatchesGeneral) {
  BsdfParameters parameters;
  parameters.base = {0.7f, 0.3f, 0.11f};
  parameters.specular_weight = 0;
  for (std::int32_t i = 0; i < 1000; ++i) {
    const Sampler dice(1, 0, i, 0, 0);
    const Frame f = Frame::from_normal(warp::uniform_sphere(dice.get_2d(0)));
    const BsdfFrame frame{f.s, f.t, f.n, f.n};
    const Vec3f wo = f.to_world(warp::uniform_hemisphere(dice.get_2d(1)));
    const Vec3f wi = warp::uniform_sphere(dice.get_2d(2));
    const Bsdf general = make_bsdf(parameters, {}, frame, wo);
    const Bsdf lambert = make_lambert(parameters.base, frame, wo);
    ASSERT_EQ(evaluate_bsdf(lambert, wi).f_cos, evaluate_bsdf(general, wi).f_cos);
    ASSERT_EQ(evaluate_bsdf(lambert, wi).pdf, evaluate_bsdf(general, wi).pdf);
    BsdfSample a, b;
    ASSERT_EQ(sample_bsdf(lambert, dice.get_1d(3), dice.get_2d(4), &a),
              sample_bsdf(general, dice.get_1d(3), dice.get_2d(4), &b));
    ASSERT_EQ(a.wi, b.wi);
    ASSERT_EQ(a.weight, b.weight);
    ASSERT_EQ(a.pdf, b.pdf);
    ASSERT_EQ(straight_transmittance(lambert), straight_transmittance(general));
    ASSERT_EQ(has_smooth_density(lambert), has_smooth_density(general));
  }
}

TEST(Fresnel, MatchesExactFormula) {  // hard case 39
  EXPECT_NEAR(fresnel_dielectric(1, 1.5f), 0.04, 1e-6);
  EXPECT_NEAR(fresnel_dielectric(static_cast<float>(cos_degrees(89)), 1.5f), 0.904185, 1e-6);
  EXPECT_NEAR(fresnel_dielectric(static_cast<float>(cos_degrees(89.9)), 1.5f), 0.989912, 1e-6);
}

double hemispherical_average(double eta) {
  double sum = 0;
  constexpr int kSteps = 200000;
  for (int i = 0; i < kSteps; ++i) {
    const double c = (i + 0.5) / kSteps;
    sum += 2 * c *
           static_cast<double>(fresnel_dielectric(static_cast<float>(c), static_cast<float>(eta)));
  }
  return sum / kSteps;
}

TEST(Fresnel, AveragesAreRelatedByEtaSquared) {  // hard case 39
  const double outside = hemispherical_average(1.5), inside = hemispherical_average(1 / 1.5);
  EXPECT_NEAR(outside, 0.091778, 2e-6);
  EXPECT_NEAR(inside, 0.596346, 2e-6);
  EXPECT_NEAR(inside, 1 - (1 - outside) / 2.25, 2e-6);
}

TEST(Fresnel, ReflectsAllBeyondCriticalAngle) {  // hard case 40
  const float eta = 1 / 1.5f;
  EXPECT_NEAR(fresnel_dielectric(static_cast<float>(cos_degrees(30)), eta), 0.055190, 1e-6);
  EXPECT_NEAR(fresnel_dielectric(static_cast<float>(cos_degrees(41)), eta), 0.379751, 1e-6);
  EXPECT_EQ(fresnel_dielectric(static_cast<float>(cos_degrees(42)), eta), 1);
}

TEST(Fresnel, TotalReflectionMatchesRefraction) {  // hard case 40
  const float eta = 1 / 1.5f;
  const double critical = std::asin(1 / 1.5);
  for (int i = -1000; i <= 1000; ++i) {
    const double angle = critical + i * 1e-9;
    const Vec3f w(Vec3d{std::sin(angle), 0, std::cos(angle)});
    Vec3f t;
    const bool passes = refract(w, {0, 0, 1}, eta, &t);
    const float f = fresnel_dielectric(w.z, eta);
    ASSERT_TRUE(f >= 0 && f <= 1);
    ASSERT_EQ(passes, f < 1) << i;
    ASSERT_TRUE(!passes || (is_finite(t) && t.z <= 0));
  }
}

TEST(Fresnel, StaysAccurateForMatchedIndices) {  // hard case 41
  // eta = 1 + 2^-23, 1 + 1e-7 rounded to float, at cos = 0.01.
  EXPECT_NEAR(fresnel_dielectric(0.01f, 1 + 0x1p-23f) / 3.5436e-7, 1, 1e-3);
  EXPECT_EQ(fresnel_dielectric(0.01f, 1), 0);
  EXPECT_EQ(f0_from_ior(0), 1);  // KHR_materials_ior: ior 0 means F = 1
}

TEST(Microfacet, DensityIsPreciseForTinyAlpha) {  // hard case 37
  for (const float alpha : {1e-4f, 1e-3f, 1e-2f, 0.1f, 0.5f, 1.0f}) {
    for (int i = 0; i <= 40; ++i) {
      const double tangent = 0.25 * i * static_cast<double>(alpha);
      const double c = 1 / std::sqrt(1 + tangent * tangent), s = tangent * c;
      const Vec3f h{static_cast<float>(s), 0, static_cast<float>(c)};
      // The half vector passed to the float function, in double.
      const double x = h.x, z = h.z, a = alpha;
      const double q = a / (x * x + a * a * z * z);
      ASSERT_NEAR(ggx_d(h, alpha) / (q * q / std::numbers::pi), 1, 1e-5) << alpha << " " << i;
    }
  }
}

TEST(FacetAlbedo, MatchesKnownGgxAlbedos) {  // hard case 38
  struct Known {
    float alpha;
    double upright, slanted, mean;  // at cosine 1, at .5, and over the hemisphere
  };
  constexpr Known kKnown[] = {{1, 0.30685, 0.45069, 0.40920},
                              {0.5f, 0.68785, 0.69825, 0.70020},
                              {0.1f, 0.98830, 0.96921, 0.97207}};
  for (const Known& known : kKnown) {
    const float roughness = std::sqrt(known.alpha);
    const FacetRow row = facet_row(roughness);
    const FacetAlbedo upright = facet_albedo(row, 1), slanted = facet_albedo(row, 0.5f),
                      mean = mean_facet_albedo(row);
    EXPECT_NEAR(upright.a + upright.b, known.upright, 1e-3) << known.alpha;
    EXPECT_NEAR(slanted.a + slanted.b, known.slanted, 1e-3) << known.alpha;
    EXPECT_NEAR(mean.a + mean.b, known.mean, 1e-3) << known.alpha;
  }
}

/// Coordinates of points in [0, 1]^2 that fill it evenly.
Vec2f lattice_point(int i) {
  const double x = 0.75487766624669276 * i, y = 0.56984029099805327 * i;
  return {static_cast<float>(x - std::floor(x)), static_cast<float>(y - std::floor(y))};
}

TEST(FacetAlbedo, IsRoundedUpByAtMostOneInThousand) {  // hard case 46
  const VisibleNormals normals(4096);
  for (int i = 0; i < 400; ++i) {
    const Vec2f u = lattice_point(i);
    const float roughness = 0.0317f + 0.9683f * u.x, cosine = std::max(u.y * u.y, 1e-4f);
    const double alpha = static_cast<double>(roughness) * static_cast<double>(roughness);
    const double c = static_cast<double>(cosine);
    const SchlickAlbedo exact =
        schlick_albedo(normals, {std::sqrt((1 - c) * (1 + c)), 0, c}, alpha, alpha);
    const FacetAlbedo table = facet_albedo(facet_row(roughness), cosine);
    for (const double f0 : {0.0, 0.04, 0.2, 1.0}) {
      const double excess =
          f0 * (static_cast<double>(table.a) - exact.a) + (static_cast<double>(table.b) - exact.b);
      ASSERT_GE(excess, -2e-5) << roughness << " " << cosine << " " << f0;
      ASSERT_LE(excess, 1e-3) << roughness << " " << cosine << " " << f0;
    }
  }
}

TEST(GlassTable, CoversSingleScattering) {  // hard case 46
  for (const double eta : {1.5, 1 / 1.5, 1.01, 2.4}) {
    const GlassTable table(eta);
    for (int i = 0; i < 2500; ++i) {
      const Vec2f u = lattice_point(i);
      const ScatteredAlbedo e = table.scattered(u.y, u.x);
      const ReflectedAlbedo reflected = GlassTable::reflected(table.row(u.x), u.y);
      for (const float f0 : {0.0f, 0.04f, 1.0f}) {
        ASSERT_GT(e.at(f0, 1), 0.1f);
        ASSERT_LE(e.at(f0, 1), 1.03f);
        ASSERT_LE(f0 * reflected.a + reflected.b + reflected.total, e.at(f0, 1) + 0.15f);
      }
    }
  }
}

TEST(Srgb, EveryCodeIsWithinOneUlp) {  // hard case 75
  const auto table = srgb8_table();
  for (int i = 0; i < 256; ++i) {
    const long double c = i / 255.0L;
    const long double exact = c <= 0.04045L ? c / 12.92L : std::pow((c + 0.055L) / 1.055L, 2.4L);
    const float got = table[static_cast<std::size_t>(i)];
    const float ulp = std::nextafter(got, 2.0f) - got;
    ASSERT_LE(std::fabs(static_cast<double>(got - exact)), ulp) << i;
  }
  EXPECT_EQ(table[0], 0);
  EXPECT_EQ(table[255], 1);
  EXPECT_EQ(srgb16_table()[65535], 1);
}

/// A scene with one image of width x height single-channel floats.
struct OneImage {
  Scene scene;
  TextureRef ref;

  OneImage(std::int32_t width, std::int32_t height, std::vector<float> values, Wrap wrap) {
    Image image;
    image.width = width;
    image.height = height;
    image.channels = 1;
    image.storage = Image::Storage::f32;
    image.f32 = std::move(values);
    scene.images.push_back(std::move(image));
    scene.textures.push_back({0, wrap, wrap, false});
    ref.texture = 0;
  }
  float at(float u, float v) const { return TextureTable(scene).lookup(ref, {u, v}).x; }
};

TEST(Texture, InterpolatesBetweenTexelCentres) {
  const OneImage t(2, 1, {10, 20}, Wrap::clamp);
  EXPECT_EQ(t.at(0.25f, 0.5f), 10);
  EXPECT_EQ(t.at(0.75f, 0.5f), 20);
  EXPECT_EQ(t.at(0.5f, 0.5f), 15);
  EXPECT_EQ(t.at(0, 0.5f), 10);
  EXPECT_EQ(t.at(1, 0.5f), 20);
}

TEST(Texture, WrapModesFollowSampler) {
  const OneImage repeat(4, 1, {1, 2, 3, 4}, Wrap::repeat);
  EXPECT_EQ(repeat.at(1.125f, 0), 1);
  EXPECT_EQ(repeat.at(-0.125f, 0), 4);
  EXPECT_EQ(repeat.at(0, 0), 2.5f);  // between the last texel and the first
  const OneImage mirror(4, 1, {1, 2, 3, 4}, Wrap::mirror);
  EXPECT_EQ(mirror.at(1.125f, 0), 4);
  EXPECT_EQ(mirror.at(-0.125f, 0), 1);
  EXPECT_EQ(mirror.at(1.875f, 0), 1);
  EXPECT_EQ(mirror.at(2.125f, 0), 1);
  EXPECT_EQ(mirror.at(1, 0), 4);
  const OneImage clamped(4, 1, {1, 2, 3, 4}, Wrap::clamp);
  EXPECT_EQ(clamped.at(7, 0), 4);
  EXPECT_EQ(clamped.at(-7, 0), 1);
}

TEST(Texture, NearestSelectsContainingTexel) {
  OneImage t(4, 1, {1, 2, 3, 4}, Wrap::repeat);
  t.scene.textures[0].nearest = true;
  EXPECT_EQ(t.at(0.24f, 0), 1);
  EXPECT_EQ(t.at(0.25f, 0), 2);
  EXPECT_EQ(t.at(-0.01f, 0), 4);
  EXPECT_EQ(t.at(1, 0), 1);
}

TEST(Texture, ConstantIsReadExactly) {  // hard case 74
  for (const Wrap wrap : {Wrap::repeat, Wrap::mirror, Wrap::clamp}) {
    const OneImage t(3, 5, std::vector<float>(15, 0.1f), wrap);
    for (int i = 0; i < 2000; ++i) {
      const auto x = static_cast<float>(i) * 0.0137f - 9;
      ASSERT_EQ(t.at(x, -x * 1.7f), 0.1f);
    }
    for (const float huge : {1e20f, -3e38f, std::numeric_limits<float>::infinity(),
                             std::numeric_limits<float>::quiet_NaN()}) {
      ASSERT_EQ(t.at(huge, huge), 0.1f);
    }
  }
}

TEST(Texture, TransformIsApplied) {
  OneImage t(4, 1, {1, 2, 3, 4}, Wrap::repeat);
  t.ref.has_transform = true;
  t.ref.uv_matrix = {0.5f, 0, 0.25f, 0, 1, 0};
  EXPECT_EQ(t.at(0.25f, 0), 2);  // 0.375
}

TEST(Texture, DecodesSrgbBeforeFiltering) {
  Scene scene;
  Image image;
  image.width = 2;
  image.height = 1;
  image.channels = 4;
  image.u8 = {0, 255, 188, 128, 255, 0, 188, 255};
  scene.images.push_back(image);
  scene.textures.push_back({0, Wrap::clamp, Wrap::clamp, false});
  TextureRef ref;
  ref.texture = 0;
  ref.srgb = true;
  const Vec4f mid = TextureTable(scene).lookup(ref, {0.5f, 0});
  EXPECT_EQ(mid.x, 0.5f);  // filtering the codes would give 0.214
  EXPECT_EQ(mid.y, 0.5f);
  EXPECT_FLOAT_EQ(mid.z, static_cast<float>(srgb_to_linear(188.0 / 255)));
  EXPECT_FLOAT_EQ(mid.w, (128.0f / 255 + 1) / 2);  // alpha is linear
}

TEST(Dispersion, MatchesIorAndAbbeNumber) {  // hard case 54
  for (const float abbe : {10.0f, 55.0f}) {
    const float ior = 1.6f, dispersion = 20 / abbe;
    const float at_d = dispersed_ior(ior, dispersion, 587.56f);
    EXPECT_NEAR(at_d, ior, 5e-5f * (ior - 1) / abbe + 2e-7f);
    const float spread =
        dispersed_ior(ior, dispersion, 486.13f) - dispersed_ior(ior, dispersion, 656.27f);
    EXPECT_NEAR(spread, (ior - 1) / abbe, 1e-3f * spread + 3e-7f);
  }
  EXPECT_EQ(dispersed_ior(1.05f, 200, 680), 1) << "never below 1";
}

TEST(Dispersion, WavelengthWeightsSumToWhite) {
  Vec3d sum;
  float longest = 0, shortest = 1000;
  constexpr int kSteps = 1 << 16;
  for (int i = 0; i < kSteps; ++i) {
    const Wavelength w = wavelength_at((static_cast<float>(i) + 0.5f) / kSteps);
    ASSERT_TRUE(is_finite(w.weight));
    ASSERT_NEAR(w.weight.x + w.weight.y + w.weight.z, 3, 1e-6f);
    sum += Vec3d(w.weight);
    longest = std::max(longest, w.nanometres);
    shortest = std::min(shortest, w.nanometres);
  }
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(sum[k] / kSteps, 1, 1e-4);
  EXPECT_LT(longest, 680.1f);
  EXPECT_GT(shortest, 399.9f);
  EXPECT_LT(longest - shortest, 280.1f);
}

TEST(ThinFilm, ZeroThicknessIsBaseAndAlbedoIsBounded) {  // hard case 54
  const Vec3f f0{0.04f, 0.5f, 0.9f};
  const Vec3f bare = thin_film_reflectance({1, 1.3f, 0}, f0, 1);
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(bare[k], f0[k], 1e-4f);
  for (int nanometres = 0; nanometres < 2000; nanometres += 7) {
    const auto thickness = static_cast<float>(nanometres);
    for (const float c : {1.0f, 0.5f, 0.02f, 0.0f}) {
      const Vec3f f = thin_film_reflectance({1, 1.8f, thickness}, f0, c);
      for (int k = 0; k < 3; ++k) ASSERT_TRUE(f[k] >= 0 && f[k] <= 1) << thickness << " " << c;
    }
  }
}

}  // namespace
}  // namespace tessera::render
