#pragma once

#include "worker/math/vector.h"

namespace tessera::render {

/// A film on a surface in air (KHR_materials_iridescence).
struct ThinFilm {
  float weight = 0;     // iridescence, [0, 1]: fraction of the surface with the film
  float ior = 1.3f;     // at least 1
  float thickness = 0;  // nanometres
  float cap = 1;        // thin_film_cap() of the base under it; 1 lets no diffuse light pass
};

/// Reflectance per channel, in [0, 1], of the film over a base of reflectance `f0` at normal
/// incidence, for light at `cos_theta` in [0, 1] outside. Ignores the weight.
///
/// The extension's approximation of L. Belcour, P. Barla, "A Practical Extension to Microfacet
/// Theory for the Modeling of Varying Iridescence", 2017: Schlick's Fresnel terms without
/// polarisation, two orders of interference, and the eye's sensitivities as Gaussians in Fourier
/// space.
Vec3f thin_film_reflectance(const ThinFilm& film, const Vec3f& f0, float cos_theta);

/// The reflectance at normal incidence with which a Fresnel term is nowhere below the film's, in
/// any channel: Schlick's term, or the exact one of index `exact_ior` if that is not 0, scaled to
/// start there. Ignores the weight. Takes as long as 40 reflectances.
float thin_film_cap(const ThinFilm& film, const Vec3f& f0, float exact_ior);

}  // namespace tessera::render
