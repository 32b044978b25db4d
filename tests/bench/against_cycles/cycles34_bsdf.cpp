// The BSDF of Blender Cycles 3.4 for opaque metallic-roughness materials, linked in place of
// worker/shading/bsdf/extended_bsdf.cpp, so that materials cause no difference between the images
// of the two renderers. Directions are sampled as in Tessera; only values differ. It applies to
// materials with any extension, even one without effect; clearcoat, sheen and others are ignored.
//
// Formula: Principled v1 (Disney diffuse, not scaled by the reflectance of the layer above it;
// exact Fresnel; separable Smith), as measured in Blender 3.4.1 with the importer's defaults.

#include <cmath>

#include "worker/shading/bsdf/base_bsdf.h"
#include "worker/shading/bsdf/base_prepare.h"
#include "worker/shading/bsdf/extended_bsdf.h"

namespace tessera::render {

using base_bsdf::to_local;

Bsdf make_extended_bsdf(const BsdfParameters& p, const BsdfExtensions& extensions,
                        const BsdfTables& tables, const BsdfFrame& frame,
                        const BsdfFrame& /*coat_frame*/, const Vec3f& wo) {
  Bsdf b;
  base_bsdf::prepare<true>(p, &extensions, tables, frame, wo, &b);
  return b;
}

namespace extended_bsdf {
namespace {

float smith(float cosine, float alpha) {
  return 2 * cosine / (cosine + smith_root(cosine, alpha));
}

Vec3f value_of(const Bsdf& b, const Vec3f& wi) {
  const Vec3f h = direction_of(b.wo + wi);
  const float c = dot(b.wo, h), nl = wi.z, nv = b.wo.z;
  const float fl = schlick_weight(nl), fv = schlick_weight(nv);
  const float rr = b.roughness * (dot(b.wo, wi) + 1);
  const float disney = (1 - 0.5f * fv) * (1 - 0.5f * fl) + rr * (fl + fv + fl * fv * (rr - 1));
  Vec3f f = b.diffuse * (warp::kInvPi * disney);
  if (!b.mirror) {
    const Vec3f c0 = lerp(Vec3f{0.04f, 0.04f, 0.04f}, b.metal_f0, b.metallic);
    const float fh = (fresnel_dielectric(c, 1.5f) - 0.04f) / 0.96f;
    const Vec3f fresnel = c0 + (Vec3f{1, 1, 1} - c0) * fh;
    f += fresnel * (ggx_d(h, b.alpha) * smith(nl, b.alpha) * smith(nv, b.alpha) / (4 * nl * nv));
  }
  return f * nl;
}

}  // namespace

BsdfValue evaluate(const Bsdf& b, const Vec3f& wi) {
  const Vec3f local = to_local(b.frame, wi);
  if ((local.z > 0) != (dot(wi, b.frame.geometric_normal) > 0)) return {};
  BsdfValue value = base_bsdf::evaluate<true>(b, local);
  const bool is_theirs = local.z > 0 && !b.lambert && b.interface == Interface::opaque;
  if (is_theirs) value.f_cos = value_of(b, local);
  return value;
}

bool sample(const Bsdf& b, float u_lobe, const Vec2f& u, BsdfSample* sample) {
  Vec3f local;
  if (!base_bsdf::draw<true>(b, u_lobe, u, sample, &local)) return false;
  if (sample->delta) {
    sample->pdf = 0;
    return max_component(sample->weight) > 0;
  }
  const BsdfValue value = evaluate(b, sample->wi);
  sample->pdf = value.pdf;
  if (!(value.pdf > 0)) return false;
  sample->weight = value.f_cos / value.pdf;
  return max_component(sample->weight) > 0;
}

Vec3f straight_transmittance(const Bsdf& b) {
  return base_bsdf::straight_transmittance<true>(b);
}

float scattered_albedo(const Bsdf& b) {
  return base_bsdf::scattered_albedo<true>(b);
}

bool has_smooth_density(const Bsdf& b) {
  return base_bsdf::has_smooth_density<true>(b);
}

}  // namespace extended_bsdf
}  // namespace tessera::render
