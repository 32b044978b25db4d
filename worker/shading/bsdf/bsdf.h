#pragma once

#include <cstdint>
#include <optional>

#include "worker/math/vector.h"
#include "worker/shading/microfacet/microfacet.h"
#include "worker/shading/microfacet/rough_diffuse.h"
#include "worker/shading/microfacet/thin_film.h"
#include "worker/shading/tables/albedo_table.h"

namespace tessera::render {

class AnisotropicAlbedo;
class SheenTable;

/// What a surface separates.
enum class Interface : std::uint8_t {
  opaque,
  thin,   // a sheet: light that is not reflected goes straight on (KHR_materials_transmission)
  solid,  // a boundary of a volume: exact Fresnel, refraction (KHR_materials_volume)
};

/// The material at one point, as the glTF specification's layers leave it. Input of make_bsdf().
struct BsdfParameters {
  Vec3f base = {1, 1, 1};  // base colour, linear; diffuse colour in specular-glossiness
  float metallic = 0;
  float roughness = 1;  // perceptual; alpha is its square
  float ior = 1.5f;
  Vec3f f0 = {0.04f, 0.04f, 0.04f};  // dielectric reflectance at normal incidence, [0, 1]
  float specular_weight = 1;
  float transmission = 0;
  bool specular_glossiness = false;  // diffuse is scaled by 1 - F per channel, not by its maximum
  bool front = true;                 // the viewer is on the outside
  Interface interface = Interface::opaque;
};

/// A metal by its complex index of refraction, per channel.
struct Conductor {
  bool present = false;
  Vec3f n = {1, 1, 1}, k;
  Vec3f average = {};  // reflectance over the cosine-weighted hemisphere
};

/// What further extensions say of the material at one point; input of make_extended_bsdf().
struct BsdfExtensions {
  float coat = 0;            // KHR_materials_clearcoat: share that is coated, [0, 1]
  float coat_roughness = 0;  // perceptual
  Vec3f sheen = {};          // KHR_materials_sheen: colour, [0, 1]
  float sheen_roughness = 0;
  float anisotropy = 0;            // KHR_materials_anisotropy: strength, along the frame's tangent
  ThinFilm film = {};              // KHR_materials_iridescence
  float diffuse_transmission = 0;  // KHR_materials_diffuse_transmission
  Vec3f diffuse_transmission_color = {1, 1, 1};
  Conductor conductor = {};     // TESSERA_material, as the next two
  bool exact_fresnel = false;   // of the dielectric layer, where it bounds no solid
  float diffuse_roughness = 0;  // [0, 1]
};

/// Albedo tables a BSDF may need; those it does not need may be null.
struct BsdfTables {
  const AlbedoTable* reflector = nullptr;
  const AlbedoTable* entering = nullptr;  // dielectric(ior): transmissive solids seen from outside
  const AlbedoTable* leaving = nullptr;   // dielectric(1 / ior)
  const AnisotropicAlbedo* anisotropic = nullptr;
  const SheenTable* sheen = nullptr;
};

/// Orthonormal shading frame with the viewer on the +z side of both normals.
struct BsdfFrame {
  Vec3f tangent, bitangent, normal;
  Vec3f geometric_normal;  // unit, on the viewer's side: what lies above the surface and below it
};

/// A coat of clear varnish: facets over everything else, with a normal of their own.
struct CoatLobe {
  BsdfFrame frame;
  Vec3f wo;          // in that frame, z > 0
  float weight = 0;  // coat times Fresnel term at wo: what the coat reflects; 0: there is no coat
  float alpha = 0, root_o = 1;
  bool mirror = false;
};

/// Fibres over the base, under the coat.
struct SheenLobe {
  Vec3f color;       // zero: there are none
  float albedo = 0;  // of white sheen at wo
  float roughness = 1, alpha = 1;
  float lambda_o = 0;
  const SheenTable* table = nullptr;
};

/// What a Bsdf has only if its material has one of BsdfExtensions.
struct ExtendedLobes {
  CoatLobe coat;
  SheenLobe sheen;
  float coat_probability = 0, sheen_probability = 0;  // of sampling them; else the base

  // Of the base:
  ThinFilm film;
  float anisotropy = 0;
  float alpha_t = 0;  // along the tangent, Bsdf::alpha being across it; 0: isotropic
  const AnisotropicAlbedo* anisotropic = nullptr;
  Conductor conductor;
  float exact_ior = 0;         // of a dielectric layer with the exact Fresnel term; 0: Schlick's
  RoughDiffuse rough;          // what makes the cosine lobe of `diffuse` one of rough facets
  Vec3f diffuse_transmit;      // weight of the cosine lobe behind the surface
  float back_probability = 0;  // of taking that one, if one of the cosine lobes is sampled
};

/// Everything about scattering at one point for one viewer. Plain data, made per hit.
struct Bsdf {
  BsdfFrame frame;
  Vec3f wo;  // unit, in the frame, z > 0

  Vec3f diffuse;   // (1 - metallic)(1 - transmission) base
  Vec3f transmit;  // (1 - metallic) transmission base: weight of what the Fresnel layer lets pass
  Vec3f f0;
  Vec3f metal_f0;
  Vec3f metal_multiple;  // Kulla-Conty: factor of 1 - E(wi); zero when there is nothing to mend
  float specular_weight = 0;
  float metallic = 0;
  float alpha = 1, roughness = 1;
  float eta = 1;         // n(far side) / n(viewer's side) of a solid
  float dense_mean = 1;  // of a solid with a diffuse lobe: mean_transmittance_from_dense()
  float root_o = 1;
  float reflect_gain = 1, transmit_gain = 1;  // what multiple scattering gives back in glass
  float cosine_probability = 1;               // of sampling the cosine lobe
  Interface interface = Interface::opaque;
  bool lambert = false;  // nothing but `diffuse`: no lobe of facets
  bool mirror = false;   // the microfacet lobe is a delta
  bool channelwise = false;
  bool plain_fresnel = true;  // f0 follows from eta and the weight is 1
  const AlbedoTable* reflector = nullptr;
  std::optional<ExtendedLobes> extended;
};

struct BsdfValue {
  Vec3f f_cos;    // BSDF times |cos| of wi to the shading normal; delta lobes left out
  float pdf = 0;  // of sample_bsdf, over solid angle, delta lobes left out
};

struct BsdfSample {
  Vec3f wi;      // world
  Vec3f weight;  // f cos / pdf
  float pdf = 0;
  bool delta = false;
  bool transmitted = false;  // wi is on the far side
};

/// Prepares scattering for a viewer in direction `wo` (world, unit, on the side of both normals).
Bsdf make_bsdf(const BsdfParameters& parameters, const BsdfTables& tables, const BsdfFrame& frame,
               const Vec3f& wo);

/// The same where all there is is a diffuse lobe.
Bsdf make_lambert(const Vec3f& albedo, const BsdfFrame& frame, const Vec3f& wo);

/// The same for a material with extensions; `coat_frame` is the frame of the coat's own normal.
Bsdf make_extended_bsdf(const BsdfParameters& parameters, const BsdfExtensions& extensions,
                        const BsdfTables& tables, const BsdfFrame& frame,
                        const BsdfFrame& coat_frame, const Vec3f& wo);

/// Value and density for `wi` (world, unit).
///
/// Reflection is the specification's BRDF (glTF 2.0, appendix B; KHR_materials_specular, _ior,
/// _transmission, pbrSpecularGlossiness), metals with Kulla & Conty's multiple-scattering lobe.
/// Transmission through solids is Walter et al. 2007, equation 21, without the change of radiance
/// by eta^2, which cancels for closed solids; rough glass is divided by its single-scattering
/// albedo at wo, so reciprocity holds for it up to that factor. A coat takes its Fresnel term at
/// wo alone and leaves the rest to what lies below (KHR_materials_clearcoat), so reciprocity does
/// not hold for it. Sheen scales the base by what it leaves at wo and at wi (KHR_materials_sheen).
BsdfValue evaluate_bsdf(const Bsdf& bsdf, const Vec3f& wi);

/// Draws a direction: `u_lobe` in [0, 1) chooses, `u` places. False when the sample is lost (below
/// the surface, or nothing scatters). Light going straight through a thin mirror-smooth sheet is
/// left out: see straight_transmittance().
bool sample_bsdf(const Bsdf& bsdf, float u_lobe, const Vec2f& u, BsdfSample* sample);

/// Share of light that goes straight through a thin, smooth, transmissive sheet; 0 for others.
Vec3f straight_transmittance(const Bsdf& bsdf);

/// Estimate of the albedo sample_bsdf() scatters with, for choosing between that and going
/// straight.
float scattered_albedo(const Bsdf& bsdf);

/// Whether a light of zero size, or next-event estimation at all, can contribute.
bool has_smooth_density(const Bsdf& bsdf);

}  // namespace tessera::render
