#include "worker/shading/bsdf/bsdf.h"

#include "worker/shading/bsdf/base_bsdf.h"
#include "worker/shading/bsdf/base_prepare.h"
#include "worker/shading/bsdf/extended_bsdf.h"

namespace tessera::render {

Bsdf make_bsdf(const BsdfParameters& parameters, const BsdfTables& tables, const BsdfFrame& frame,
               const Vec3f& wo) {
  Bsdf b;
  base_bsdf::prepare<false>(parameters, nullptr, tables, frame, wo, &b);
  return b;
}

Bsdf make_lambert(const Vec3f& albedo, const BsdfFrame& frame, const Vec3f& wo) {
  Bsdf b;
  base_bsdf::set_viewer(frame, wo, &b);
  b.diffuse = albedo;
  b.diffuse_albedo = luminance(albedo);
  b.lambert = true;
  return b;
}

BsdfValue evaluate_bsdf(const Bsdf& b, const Vec3f& wi) {
  if (b.extended) [[unlikely]]
    return extended_bsdf::evaluate(b, wi);
  const Vec3f local = base_bsdf::to_local(b.frame, wi);
  // Both normals must agree on the side, otherwise light leaks through the surface.
  if ((local.z > 0) != (dot(wi, b.frame.geometric_normal) > 0)) return {};
  return base_bsdf::evaluate<false>(b, local);
}

bool sample_bsdf(const Bsdf& b, float u_lobe, const Vec2f& u, BsdfSample* sample) {
  if (b.extended) [[unlikely]]
    return extended_bsdf::sample(b, u_lobe, u, sample);
  Vec3f local;
  if (!base_bsdf::draw<false>(b, u_lobe, u, sample, &local)) return false;
  if (sample->delta) {
    sample->pdf = 0;
    return max_component(sample->weight) > 0;
  }
  const BsdfValue value = base_bsdf::evaluate<false>(b, local);
  sample->pdf = value.pdf;
  if (!(value.pdf > 0)) return false;
  sample->weight = b.lambert ? b.diffuse : value.f_cos / value.pdf;
  return max_component(sample->weight) > 0;
}

Vec3f straight_transmittance(const Bsdf& b) {
  if (!b.mirror || b.interface != Interface::thin) return {};
  if (b.extended) [[unlikely]]
    return extended_bsdf::straight_transmittance(b);
  return base_bsdf::straight_transmittance<false>(b);
}

float scattered_albedo(const Bsdf& b) {
  if (b.extended) [[unlikely]]
    return extended_bsdf::scattered_albedo(b);
  return base_bsdf::scattered_albedo<false>(b);
}

float sample_delta(const Bsdf& b, DeltaLobe lobe, BsdfSample* sample) {
  const base_bsdf::LobeChoice choice =
      b.extended ? extended_bsdf::choice_of(b, lobe) : base_bsdf::choice_of<false>(b, lobe);
  if (!(choice.probability > 0) || !sample_bsdf(b, choice.u_lobe, {}, sample)) return 0;
  if (!sample->delta || sample->lobe != lobe) return 0;  // rounding of a tiny probability
  sample->weight *= choice.probability;
  return choice.probability;
}

bool has_smooth_density(const Bsdf& b) {
  return base_bsdf::has_smooth_density<false>(b) ||
         (b.extended && extended_bsdf::has_smooth_density(b));
}

}  // namespace tessera::render
