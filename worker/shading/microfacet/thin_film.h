#pragma once

#include "worker/math/vector.h"

namespace tessera::render {

/// A film on a surface in air (KHR_materials_iridescence).
struct ThinFilm {
  float weight = 0;     // iridescence, [0, 1]: share of the surface that has the film
  float ior = 1.3f;     // at least 1
  float thickness = 0;  // nanometres
};

/// Reflectance per channel of the film over a base of reflectance `f0` at normal incidence, for
/// light at `cos_theta` in [0, 1] outside; within [0, 1]. Takes no account of the weight.
///
/// The extension's approximation of L. Belcour, P. Barla, "A Practical Extension to Microfacet
/// Theory for the Modeling of Varying Iridescence", 2017: Schlick's Fresnel terms without
/// polarisation, two orders of interference, sensitivities of the eye as Gaussians in Fourier
/// space.
Vec3f thin_film_reflectance(const ThinFilm& film, const Vec3f& f0, float cos_theta);

}  // namespace tessera::render
