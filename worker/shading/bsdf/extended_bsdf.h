#pragma once

#include "worker/shading/bsdf/base_bsdf.h"
#include "worker/shading/bsdf/bsdf.h"

/// The functions of bsdf.h for materials with an extension of BsdfExtensions. Kept apart so that
/// other materials pay only one branch for them. All require `b.extended`.
namespace tessera::render::extended_bsdf {

BsdfValue evaluate(const Bsdf& b, const Vec3f& wi);
bool sample(const Bsdf& b, float u_lobe, const Vec2f& u, BsdfSample* sample);
Vec3f straight_transmittance(const Bsdf& b);
float scattered_albedo(const Bsdf& b);
base_bsdf::LobeChoice choice_of(const Bsdf& b, DeltaLobe lobe);
bool has_smooth_density(const Bsdf& b);

}  // namespace tessera::render::extended_bsdf
