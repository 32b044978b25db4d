#pragma once

#include <cstdint>
#include <optional>

#include "worker/math/vector.h"
#include "worker/shading/microfacet/microfacet.h"
#include "worker/shading/microfacet/rough_diffuse.h"
#include "worker/shading/microfacet/thin_film.h"
#include "worker/shading/tables/anisotropic_albedo.h"
#include "worker/shading/tables/facet_albedo.h"
#include "worker/shading/tables/glass_albedo.h"

namespace tessera::render {

/// Kind of interface that a surface forms.
enum class Interface : std::uint8_t {
  opaque,
  thin,   // thin surface: transmitted light keeps its direction (KHR_materials_transmission)
  solid,  // boundary of a volume: exact Fresnel, refraction (KHR_materials_volume)
};

/// Material at one point, as defined by the layers of the glTF specification. Input of make_bsdf().
struct BsdfParameters {
  Vec3f base = {1, 1, 1};  // base colour, linear; diffuse colour in specular-glossiness
  float metallic = 0;
  float roughness = 1;  // perceptual; alpha is its square
  float ior = 1.5f;
  Vec3f f0 = {0.04f, 0.04f, 0.04f};  // dielectric reflectance at normal incidence, [0, 1]
  float specular_weight = 1;
  float transmission = 0;
  bool specular_glossiness = false;  // diffuse is scaled by 1 - F per channel, not by its maximum
  bool front = true;                 // the viewer is outside
  Interface interface = Interface::opaque;
};

/// A metal with a complex index of refraction per channel.
struct Conductor {
  bool present = false;
  Vec3f n = {1, 1, 1}, k;
  Vec3f average = {};  // reflectance over the cosine-weighted hemisphere
};

/// Material extensions at one point. Input of make_extended_bsdf().
struct BsdfExtensions {
  float coat = 0;            // KHR_materials_clearcoat: coated fraction, [0, 1]
  float coat_roughness = 0;  // perceptual
  Vec3f sheen = {};          // KHR_materials_sheen: colour, [0, 1]
  float sheen_roughness = 0;
  float anisotropy = 0;            // KHR_materials_anisotropy: strength, along the frame's tangent
  ThinFilm film = {};              // KHR_materials_iridescence
  float diffuse_transmission = 0;  // KHR_materials_diffuse_transmission
  Vec3f diffuse_transmission_color = {1, 1, 1};
  Conductor conductor = {};     // TESSERA_material, like the next two
  bool exact_fresnel = false;   // of the dielectric layer, unless it bounds a solid
  float diffuse_roughness = 0;  // [0, 1]
};

/// Albedo tables of a BSDF that depend on the index of refraction. Rough solids need both, and if
/// they have a diffuse lobe, reflected albedos as well; so do rough dielectric layers with an exact
/// Fresnel term, of `entering`. Others may be null.
struct BsdfTables {
  const GlassTable* entering = nullptr;  // of ior: seen from outside
  const GlassTable* leaving = nullptr;   // of 1 / ior
};

/// Orthonormal shading frame with the viewer on the +z side of both normals.
struct BsdfFrame {
  Vec3f tangent, bitangent, normal;
  Vec3f geometric_normal;  // unit, on the viewer's side: separates reflection from transmission
};

/// Clearcoat: a dielectric microfacet layer over all others, with its own normal.
struct CoatLobe {
  BsdfFrame frame;
  Vec3f wo;          // in that frame, z > 0
  float weight = 0;  // coat times Fresnel term at wo: reflectance of the coat; 0: no coat
  float alpha = 0, root_o = 1;
  bool mirror = false;
};

/// Sheen: fibres over the base, below the coat.
struct SheenLobe {
  Vec3f color;       // zero: no sheen
  float albedo = 0;  // of white sheen at wo
  float roughness = 1, alpha = 1;
  float lambda_o = 0;
};

/// Lobes that only materials with an extension of BsdfExtensions have.
struct ExtendedLobes {
  CoatLobe coat;
  SheenLobe sheen;
  float coat_probability = 0, sheen_probability = 0;  // of sampling them; otherwise the base

  // Parameters of the base:
  ThinFilm film;
  float anisotropy = 0;
  float alpha_t = 0;  // along the tangent (Bsdf::alpha is across it); 0: isotropic
  AnisotropicAlbedo anisotropic;
  Conductor conductor;
  float exact_ior = 0;         // index of a dielectric layer with exact Fresnel term; 0: Schlick
  RoughDiffuse rough;          // makes the lobe of `diffuse` rough (EON)
  Vec3f diffuse_transmit;      // weight of the cosine lobe on the other side, coupled like
                               // Bsdf::coupled
  float behind_albedo = 0;     // luminance of the albedo of that lobe
  float back_probability = 0;  // of choosing that lobe among the two cosine lobes
  GlassTable::Row far_glass;   // of the other side of a rough solid
  GlassTable::Row dense_t;     // of its denser side, with alpha_t
};

/// Scattering at one point for one viewer. Plain data, made per hit.
struct Bsdf {
  BsdfFrame frame;
  Vec3f wo;  // unit, in the frame, z > 0

  Vec3f diffuse;   // (1 - metallic)(1 - transmission) base
  Vec3f coupled;   // that times (1 - E(wo)) / (1 - mean of E): factor of 1 - E(wi). E is the albedo
                   // of the dielectric layer's facets, base_coupling.h. Unset for `lambert`
  Vec3f cover_f0;  // specular_weight times f0 of E, at most specular_weight
  Vec3f transmit;  // (1 - metallic) transmission base: colour of transmitted light
  Vec3f f0;
  Vec3f metal_f0;
  Vec3f metal_multiple;  // Kulla-Conty: factor of 1 - E(wi); zero if no energy is lost
  float specular_weight = 0;
  float metallic = 0;
  float alpha = 1, roughness = 1;
  float eta = 1;  // n(far side) / n(viewer's side) of a solid
  float root_o = 1;
  float diffuse_albedo = 0;                   // luminance of the albedo of the lobe of `diffuse`
  float reflect_gain = 1, transmit_gain = 1;  // compensation of multiple scattering in rough glass
  float cosine_probability = 1;               // of sampling the cosine lobe
  Interface interface = Interface::opaque;
  bool lambert = false;  // only `diffuse`, without a microfacet lobe
  bool mirror = false;   // the microfacet lobe is a delta
  bool channelwise = false;
  bool plain_fresnel = true;  // f0 follows from eta and the weight is 1
  FacetRow facets;
  GlassTable::Row glass;  // of the viewer's side, if E has an exact Fresnel term and is rough
  std::optional<ExtendedLobes> extended;
};

struct BsdfValue {
  Vec3f f_cos;    // BSDF times |cos| of wi to the shading normal, without delta lobes
  float pdf = 0;  // of sample_bsdf(), over solid angle, without delta lobes
};

/// Delta lobes of a BSDF.
enum class DeltaLobe : std::uint8_t { coat, reflection, refraction };

struct BsdfSample {
  Vec3f wi;      // world
  Vec3f weight;  // f cos / pdf
  float pdf = 0;
  bool delta = false;
  DeltaLobe lobe = DeltaLobe::reflection;  // set if `delta`
  bool transmitted = false;                // wi is on the far side
};

/// Prepares scattering for a viewer in direction `wo` (world, unit, on the side of both normals).
Bsdf make_bsdf(const BsdfParameters& parameters, const BsdfTables& tables, const BsdfFrame& frame,
               const Vec3f& wo);

/// A BSDF with only a diffuse lobe.
Bsdf make_lambert(const Vec3f& albedo, const BsdfFrame& frame, const Vec3f& wo);

/// make_bsdf() for a material with extensions; `coat_frame` is the frame of the coat's normal.
Bsdf make_extended_bsdf(const BsdfParameters& parameters, const BsdfExtensions& extensions,
                        const BsdfTables& tables, const BsdfFrame& frame,
                        const BsdfFrame& coat_frame, const Vec3f& wo);

/// Value and density for `wi` (world, unit).
///
/// Reflection is the specification's BRDF (glTF 2.0, appendix B; KHR_materials_specular, _ior,
/// _transmission, pbrSpecularGlossiness) except that diffuse light is what the facets' albedo
/// leaves, towards the viewer and from the light (Kulla & Conty 2017), which conserves energy;
/// metals add the same authors' multiple-scattering lobe.
/// Transmission through solids is Walter et al. 2007, equation 21, without the scaling of radiance
/// by eta^2, which cancels for closed solids. Rough glass is divided by its single-scattering
/// albedo at wo, and a coat uses its Fresnel term at wo alone (KHR_materials_clearcoat), so these
/// are not reciprocal. Sheen scales the base by the remaining energy at wo and at wi
/// (KHR_materials_sheen).
BsdfValue evaluate_bsdf(const Bsdf& bsdf, const Vec3f& wi);

/// Samples a direction: `u_lobe` in [0, 1) chooses the lobe, `u` the direction. False if the sample
/// is lost (below the surface, or nothing scatters). Light going straight through a thin, smooth
/// surface is excluded: see straight_transmittance().
bool sample_bsdf(const Bsdf& bsdf, float u_lobe, const Vec2f& u, BsdfSample* sample);

/// Transmittance of a thin, smooth, transmissive surface for light going straight on; 0 for others.
Vec3f straight_transmittance(const Bsdf& bsdf);

/// Estimated albedo of sample_bsdf(), for choosing between it and straight transmission.
float scattered_albedo(const Bsdf& bsdf);

/// Samples a delta lobe. Its weight is f cos, not divided by the probability of the lobe. Light
/// going straight through a thin surface is excluded. Returns the probability with which
/// sample_bsdf() draws the lobe; 0 if the BSDF has no such lobe or the sample is lost.
float sample_delta(const Bsdf& bsdf, DeltaLobe lobe, BsdfSample* sample);

/// Returns whether light sampling can contribute: the BSDF has a non-delta lobe.
bool has_smooth_density(const Bsdf& bsdf);

}  // namespace tessera::render
