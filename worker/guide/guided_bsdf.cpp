#include "worker/guide/guided_bsdf.h"

#include <cmath>

namespace tessera::render {

bool sample_guided(const Bsdf& bsdf, const GuideLobe& lobe, const Vec4f& u, BsdfSample* next,
                   float* unguided) {
  const float probability = lobe.probability;
  BsdfValue value;
  if (u.z < probability) {
    next->wi = lobe.sample(u.z / probability, {u.x, u.y});
    next->delta = false;
    next->transmitted = dot(next->wi, bsdf.frame.geometric_normal) < 0;
    value = evaluate_bsdf(bsdf, next->wi);
  } else {
    constexpr float kBelowOne = 1 - 0x1p-24f;
    const float rest = (u.z - probability) / (1 - probability);
    if (!sample_bsdf(bsdf, rest < kBelowOne ? rest : kBelowOne, {u.x, u.y}, next)) return false;
    if (next->delta) {
      next->weight = next->weight / (1 - probability);
      *unguided *= 1 - probability;
      return true;
    }
    value = {next->weight * next->pdf, next->pdf};
  }
  next->pdf = lerp(value.pdf, lobe.pdf(next->wi), probability);
  if (!(max_component(value.f_cos) > 0) || !(next->pdf < INFINITY)) return false;
  next->weight = value.f_cos / next->pdf;
  constexpr float kMaxUnguided = 1e30f;
  const float factor = *unguided * (next->pdf / value.pdf);
  *unguided = factor < kMaxUnguided ? factor : kMaxUnguided;
  return true;
}

}  // namespace tessera::render
