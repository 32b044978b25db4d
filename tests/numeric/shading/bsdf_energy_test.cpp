// Energy of every material: the directional albedo of its BSDF is at most 1, and exactly 1 for a
// white dielectric (hard case 46). TESSERA_DENSE_GRID=1 tests more angles, roughnesses and indices.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <string>
#include <vector>

#include "worker/shading/bsdf/bsdf.h"
#include "worker/shading/microfacet/fresnel.h"

namespace tessera::render {
namespace {

constexpr double kBound = 1e-3;

struct Sample {
  BsdfParameters parameters;
  BsdfExtensions extensions = {};
  bool extended = false;
};

/// A kind of material: changes a white dielectric of some roughness and index.
struct Family {
  std::string name;
  std::function<void(Sample*)> change;
};

bool dense() {
  return std::getenv("TESSERA_DENSE_GRID") != nullptr;
}

std::vector<float> roughnesses() {
  if (dense())
    return {0, 0.03f, 0.0317f, 0.07f, 0.12f, 0.2f, 0.25f, 0.35f, 0.5f, 0.6f, 0.7f, 0.85f, 1};
  return {0, 0.0317f, 0.2f, 0.5f, 1};
}

std::vector<double> cosines() {
  if (dense()) return {1, 0.98, 0.9, 0.7, 0.5, 0.4, 0.3, 0.2, 0.1, 0.05, 0.02, 0.01, 0.003, 0.001};
  return {1, 0.5, 0.1, 0.01, 0.001};
}

std::vector<float> indices() {
  if (dense()) return {1.05f, 1.2f, 1.33f, 1.5f, 1.8f, 2.5f};
  return {1.5f};
}

/// Albedo per channel for light leaving at `cosine`, with a Kronecker sequence of `count` samples.
Vec3d albedo_of(const Sample& material, const BsdfTables& tables, double cosine, int count) {
  constexpr BsdfFrame kFrame = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 1}};
  const double sine = std::sqrt((1 - cosine) * (1 + cosine)), phi = 0.7;
  const Vec3f wo(Vec3d{sine * std::cos(phi), sine * std::sin(phi), cosine});
  const Bsdf bsdf = material.extended ? make_extended_bsdf(material.parameters, material.extensions,
                                                           tables, kFrame, kFrame, wo)
                                      : make_bsdf(material.parameters, tables, kFrame, wo);
  const Vec3d straight(straight_transmittance(bsdf));
  constexpr double kSteps[] = {0.81917251339616443970, 0.67104360670378920842,
                               0.54970047790197026775};  // powers of the root of x^4 = x + 1
  std::array<float, 3> u{};
  std::array<double, 3> at = {0.5, 0.5, 0.5};
  Vec3d sum{};
  for (int i = 0; i < count; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      at[k] += kSteps[k];
      at[k] -= std::floor(at[k]);
      u[k] = std::min(static_cast<float>(at[k]), 1 - 0x1p-24f);
    }
    BsdfSample s;
    if (!sample_bsdf(bsdf, u[0], {u[1], u[2]}, &s)) continue;
    EXPECT_TRUE(is_finite(s.weight) && std::isfinite(s.pdf));
    sum += Vec3d(s.weight);
  }
  return sum * (1.0 / count) + straight;
}

/// The largest channel of the albedo, as precise as it takes to compare it with 1.
double largest_albedo(const Sample& material, const BsdfTables& tables, double cosine) {
  for (int count = 1024;; count *= 8) {
    const double albedo = max_component(albedo_of(material, tables, cosine, count));
    const double error = 6.0 / std::pow(count, 0.85);  // of the sequence, generous
    if (count > 500000 || albedo + error < 1 + kBound) return albedo;
  }
}

void extend(std::vector<Family>* all, const std::string& name,
            const std::function<void(BsdfExtensions*)>& change) {
  all->push_back({name, [change](Sample* s) {
                    s->extended = true;
                    change(&s->extensions);
                  }});
}

/// Sets a film and its cap for the material's index.
void set_film(float weight, float ior, float thickness, Sample* s) {
  s->extended = true;
  ThinFilm& film = s->extensions.film;
  film = {weight, ior, thickness};
  const bool solid = s->parameters.interface == Interface::solid;
  film.cap = thin_film_cap(film, s->parameters.f0, solid ? s->parameters.ior : 0);
}

void add_opaque(std::vector<Family>* all) {
  all->push_back({"dielectric", [](Sample*) {}});
  all->push_back({"metal", [](Sample* s) { s->parameters.metallic = 1; }});
  all->push_back({"half metal", [](Sample* s) { s->parameters.metallic = 0.5f; }});
  all->push_back({"specular .5", [](Sample* s) { s->parameters.specular_weight = 0.5f; }});
  all->push_back({"specular colour", [](Sample* s) {
                    const Vec3f f0 = s->parameters.f0 * Vec3f{4, 1, 0};
                    s->parameters.f0 = min(f0, Vec3f{1, 1, 1});
                  }});
  all->push_back({"specular-glossiness", [](Sample* s) {
                    s->parameters.specular_glossiness = true;
                    s->parameters.f0 = {0.3f, 0.1f, 0.04f};
                    s->parameters.base = {0.7f, 0.7f, 0.7f};
                  }});
  extend(all, "exact Fresnel", [](BsdfExtensions* e) { e->exact_fresnel = true; });
  extend(all, "rough diffuse", [](BsdfExtensions* e) { e->diffuse_roughness = 1; });
  extend(all, "half rough diffuse", [](BsdfExtensions* e) { e->diffuse_roughness = 0.5f; });
  all->push_back(
      {"nearly perfect conductor", [](Sample* s) {
         s->extended = true;
         s->parameters.metallic = 1;
         s->extensions.conductor = {true, {0.001f, 0.001f, 0.001f}, {30, 30, 30}, {1, 1, 1}};
       }});
}

void add_layers(std::vector<Family>* all) {
  for (const float r : {0.0f, 0.2f, 1.0f}) {
    const std::string name = " " + std::to_string(r).substr(0, 3);
    extend(all, "coat" + name, [r](BsdfExtensions* e) {
      e->coat = 1;
      e->coat_roughness = r;
    });
    extend(all, "half a coat" + name, [r](BsdfExtensions* e) {
      e->coat = 0.5f;
      e->coat_roughness = r;
    });
    extend(all, "white sheen" + name, [r](BsdfExtensions* e) {
      e->sheen = {1, 1, 1};
      e->sheen_roughness = r;
    });
    extend(all, "dark sheen" + name, [r](BsdfExtensions* e) {
      e->sheen = {0.2f, 0.2f, 0.2f};
      e->sheen_roughness = r;
    });
  }
  for (const float thickness : {150.0f, 400.0f, 1200.0f}) {
    const std::string name = "film " + std::to_string(thickness).substr(0, 4);
    all->push_back({name, [thickness](Sample* s) { set_film(1, 1.8f, thickness, s); }});
    all->push_back(
        {"half a " + name, [thickness](Sample* s) { set_film(0.5f, 1.3f, thickness, s); }});
  }
}

void add_anisotropic(std::vector<Family>* all) {
  for (const float strength : {0.1f, 0.3f, 0.7f, 1.0f}) {
    const auto brushed = [strength](Sample* s) {
      s->extended = true;
      s->extensions.anisotropy = strength;
    };
    const std::string name = " strength " + std::to_string(strength).substr(0, 3);
    all->push_back({"brushed dielectric" + name, brushed});
    all->push_back({"brushed metal" + name, [brushed](Sample* s) {
                      brushed(s);
                      s->parameters.metallic = 1;
                    }});
    all->push_back({"brushed sheet" + name, [brushed](Sample* s) {
                      brushed(s);
                      s->parameters.transmission = 1;
                      s->parameters.interface = Interface::thin;
                    }});
  }
}

/// Sheets, leaves and solids: transmission `t` and diffuse transmission `d`.
void add_transmission(std::vector<Family>* all, Interface interface, bool front) {
  const std::string side = interface == Interface::thin ? "sheet"
                           : front                      ? "solid"
                                                        : "solid from inside";
  for (const auto [t, d] : {std::array{1.0f, 0.0f}, std::array{0.5f, 0.0f}, std::array{0.0f, 0.7f},
                            std::array{0.0f, 1.0f}, std::array{0.5f, 0.5f}}) {
    const auto base = [t = t, d = d, interface, front](Sample* s) {
      s->parameters.interface = interface;
      s->parameters.front = front;
      s->parameters.transmission = t;
      if (!(d > 0)) return;
      s->extended = true;
      s->extensions.diffuse_transmission = d;
    };
    const std::string name = side + ", transmission " + std::to_string(t).substr(0, 3) +
                             ", diffuse " + std::to_string(d).substr(0, 3);
    const auto with = [&](const std::string& more, const std::function<void(Sample*)>& change) {
      all->push_back({name + more, [base, change](Sample* s) {
                        base(s);
                        change(s);
                      }});
    };
    with("", [](Sample*) {});
    with(", specular .4", [](Sample* s) { s->parameters.specular_weight = 0.4f; });
    with(", film", [](Sample* s) { set_film(1, 1.8f, 400, s); });
    with(", brushed", [](Sample* s) {
      s->extended = true;
      s->extensions.anisotropy = 0.6f;
    });
    with(", coat", [](Sample* s) {
      s->extended = true;
      s->extensions.coat = 1;
    });
  }
}

std::vector<Family> families() {
  std::vector<Family> all;
  add_opaque(&all);
  add_layers(&all);
  add_anisotropic(&all);
  add_transmission(&all, Interface::thin, true);
  add_transmission(&all, Interface::solid, true);
  add_transmission(&all, Interface::solid, false);
  return all;
}

Sample material_of(const Family& family, float roughness, float ior) {
  Sample s;
  s.parameters.roughness = roughness;
  s.parameters.ior = ior;
  const float f0 = f0_from_ior(ior);
  s.parameters.f0 = {f0, f0, f0};
  family.change(&s);
  return s;
}

TEST(BsdfEnergy, NoMaterialGains) {  // hard case 46
  for (const float ior : indices()) {
    const GlassTable entering(ior), leaving(1 / static_cast<double>(ior));
    for (const Family& family : families()) {
      for (const float roughness : roughnesses()) {
        const Sample material = material_of(family, roughness, ior);
        for (const double cosine : cosines()) {
          EXPECT_LE(largest_albedo(material, {&entering, &leaving}, cosine), 1 + kBound)
              << family.name << ", roughness " << roughness << ", index " << ior << ", cosine "
              << cosine;
        }
      }
    }
  }
}

TEST(BsdfEnergy, WhiteDielectricScattersAll) {  // hard case 46
  for (const float ior : indices()) {
    for (const float roughness : roughnesses()) {
      const Sample material = material_of({"dielectric", [](Sample*) {}}, roughness, ior);
      for (const double cosine : cosines()) {
        const double albedo = albedo_of(material, {}, cosine, 1'000'000).x;
        EXPECT_NEAR(albedo, 1, kBound) << roughness << " " << ior << " " << cosine;
      }
    }
  }
}

}  // namespace
}  // namespace tessera::render
