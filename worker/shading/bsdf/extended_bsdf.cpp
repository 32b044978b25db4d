#include "worker/shading/bsdf/extended_bsdf.h"

#include <algorithm>
#include <cmath>

#include "worker/shading/bsdf/base_bsdf.h"
#include "worker/shading/bsdf/base_prepare.h"
#include "worker/shading/tables/sheen.h"

namespace tessera::render {
namespace {

using base_bsdf::to_local;
using base_bsdf::to_world;
using warp::kInvPi;

constexpr float kMinProbability = 0.05f;  // of a lobe with any energy

CoatLobe coat_lobe(const BsdfExtensions& e, const BsdfFrame& frame, const Vec3f& wo) {
  CoatLobe coat;
  coat.frame = frame;
  coat.wo = to_local(frame, wo);
  if (coat.wo.z < 1e-6f) coat.wo.z = 1e-6f;  // rounding only, as in base_bsdf::prepare()
  coat.weight = coat_reflectance(e.coat, coat.wo.z);
  coat.alpha = e.coat_roughness * e.coat_roughness;
  coat.mirror = coat.alpha < kMirrorAlpha;
  coat.root_o = smith_root(coat.wo.z, coat.alpha);
  return coat;
}

/// Value and density of the coat, without its weight and probability.
BsdfValue evaluate_coat(const CoatLobe& coat, const Vec3f& wi) {
  const Vec3f local = to_local(coat.frame, wi);
  if (coat.mirror || !(local.z > 0)) return {};
  const float d = ggx_d(direction_of(coat.wo + local), coat.alpha);
  const float v =
      smith_visibility(coat.wo.z, local.z, coat.root_o, smith_root(local.z, coat.alpha));
  const float f_cos = d * v * local.z;
  return {{f_cos, f_cos, f_cos}, visible_normal_density(d, coat.wo.z, coat.root_o) * 0.25f};
}

/// Samples a reflection of wo at the coat; false if it is lost.
bool draw_coat(const Bsdf& b, const Vec2f& u, BsdfSample* sample) {
  const CoatLobe& coat = b.extended->coat;
  Vec3f h{0, 0, 1};
  if (!coat.mirror) {
    const Vec2f circle = base_bsdf::point_on_circle(u.x);
    h = sample_visible_normal(coat.wo, coat.alpha, circle.x, circle.y, u.y);
  }
  const Vec3f local = h * (2 * dot(coat.wo, h)) - coat.wo;
  sample->transmitted = false;
  sample->delta = coat.mirror;
  if (coat.mirror) {
    sample->lobe = DeltaLobe::coat;
    const float weight = coat.weight / b.extended->coat_probability;
    sample->weight = {weight, weight, weight};
  }
  sample->wi = direction_of(to_world(coat.frame, local));
  if (local.z > 0 && dot(sample->wi, b.frame.geometric_normal) > 0) return true;
  if (!coat.mirror) return false;
  sample->wi = base_bsdf::mirrored_in_surface(b.frame, to_world(coat.frame, coat.wo));
  return dot(sample->wi, b.frame.geometric_normal) > 0;
}

SheenLobe sheen_lobe(const BsdfExtensions& e, float cos_o) {
  SheenLobe sheen;
  sheen.color = e.sheen;
  sheen.roughness = e.sheen_roughness;
  sheen.alpha = sheen_alpha(e.sheen_roughness);
  sheen.lambda_o = sheen_lambda(cos_o, sheen.alpha);
  sheen.albedo = sheen_albedo(cos_o, e.sheen_roughness);
  return sheen;
}

bool has_sheen(const SheenLobe& sheen) {
  return max_component(sheen.color) > 0;
}

/// Fraction of light that sheen leaves to the base between wo and a direction of cosine `cos_i`.
/// Clamped to 0 where the model's albedo exceeds 1.
float passed_by_sheen(const SheenLobe& sheen, float cos_i) {
  if (!has_sheen(sheen)) return 1;
  const float albedo_i = sheen_albedo(cos_i, sheen.roughness);
  const float albedo = clamp(sheen.albedo > albedo_i ? sheen.albedo : albedo_i, 0.0f, 1.0f);
  return 1 - max_component(sheen.color) * albedo;
}

/// Sheen for light from `wi` (base frame, above the surface).
Vec3f evaluate_sheen(const Bsdf& b, const Vec3f& wi) {
  const SheenLobe& sheen = b.extended->sheen;
  const Vec3f h = b.wo + wi;
  const float across = h.x * h.x + h.y * h.y;
  const float d = sheen_d(across / (across + h.z * h.z), sheen.alpha);
  const float shadowing = 1 + sheen.lambda_o + sheen_lambda(wi.z, sheen.alpha);
  const float albedo_i = sheen_albedo(wi.z, sheen.roughness);
  const float max_albedo = sheen.albedo > albedo_i ? sheen.albedo : albedo_i;
  const float f_cos = d / (4 * b.wo.z * shadowing * (max_albedo > 1 ? max_albedo : 1));
  return sheen.color * f_cos;
}

/// Estimated albedo of the layers below coat and sheen, as far as draw() scatters their light.
float base_albedo(const Bsdf& b) {
  const bool straight = b.mirror && b.interface == Interface::thin;
  const float through =
      straight ? 0 : luminance(b.transmit * base_bsdf::layer_at<true>(b, b.wo.z).pass);
  return base_bsdf::scattered_albedo<true>(b) + through;
}

/// Sets the sampling probabilities of the layers from their estimated energy.
void choose_layers(Bsdf* b) {
  ExtendedLobes& x = *b->extended;
  const float under_coat = 1 - x.coat.weight;
  const float sheen = under_coat * luminance(x.sheen.color) * clamp(x.sheen.albedo, 0.0f, 1.0f);
  const float base = under_coat * passed_by_sheen(x.sheen, b->wo.z) * base_albedo(*b);
  const float sum = x.coat.weight + sheen + base;
  const auto share = [sum](float part) {
    return part > 0 ? std::max(part / sum, kMinProbability) : 0;
  };
  const float coat_share = share(x.coat.weight), sheen_share = share(sheen);
  const float all = coat_share + sheen_share + share(base);
  if (!(all > 0)) return;
  x.coat_probability = coat_share / all;
  x.sheen_probability = sheen_share / all;
}

float base_probability(const ExtendedLobes& x) {
  return 1 - x.coat_probability - x.sheen_probability;
}

/// Fraction of light that passes the layers above the base from cosine `cos_i` to wo.
float passed_by_layers(const Bsdf& b, float cos_i) {
  const ExtendedLobes& x = *b.extended;
  return (1 - x.coat.weight) * passed_by_sheen(x.sheen, cos_i);
}

/// Samples the base; `u_lobe` in [0, 1). Sets the weight of a delta lobe.
bool draw_base(const Bsdf& b, float u_lobe, const Vec2f& u, BsdfSample* sample) {
  Vec3f local;
  if (!base_bsdf::draw<true>(b, u_lobe, u, sample, &local)) return false;
  if (sample->delta) {
    sample->weight *= passed_by_layers(b, std::fabs(local.z)) / base_probability(*b.extended);
  }
  return true;
}

bool draw_sheen(const Bsdf& b, const Vec2f& u, BsdfSample* sample) {
  sample->transmitted = sample->delta = false;
  sample->wi = direction_of(to_world(b.frame, warp::uniform_hemisphere(u)));
  return dot(sample->wi, b.frame.geometric_normal) > 0;
}

}  // namespace

Bsdf make_extended_bsdf(const BsdfParameters& p, const BsdfExtensions& extensions,
                        const BsdfTables& tables, const BsdfFrame& frame,
                        const BsdfFrame& coat_frame, const Vec3f& wo) {
  Bsdf b;
  base_bsdf::prepare<true>(p, &extensions, tables, frame, wo, &b);
  ExtendedLobes& x = *b.extended;
  // The layers of a solid's boundary are outside.
  if (p.front || b.interface != Interface::solid) {
    if (extensions.coat > 0) x.coat = coat_lobe(extensions, coat_frame, wo);
    if (max_component(extensions.sheen) > 0) {
      x.sheen = sheen_lobe(extensions, b.wo.z);
    }
  }
  choose_layers(&b);
  return b;
}

namespace extended_bsdf {

BsdfValue evaluate(const Bsdf& b, const Vec3f& wi) {
  const ExtendedLobes& x = *b.extended;
  const Vec3f local = to_local(b.frame, wi);
  const bool same_side = dot(wi, b.frame.geometric_normal) > 0;
  BsdfValue value;
  if ((local.z > 0) == same_side) {
    value = base_bsdf::evaluate<true>(b, local);
    value.f_cos *= passed_by_layers(b, std::fabs(local.z));
    value.pdf *= base_probability(x);
    if (has_sheen(x.sheen) && local.z > 0) {
      value.f_cos += evaluate_sheen(b, local) * (1 - x.coat.weight);
      value.pdf += warp::kUniformHemispherePdf * x.sheen_probability;
    }
  }
  if (x.coat.weight > 0 && same_side) {
    const BsdfValue coat = evaluate_coat(x.coat, wi);
    value.f_cos += coat.f_cos * x.coat.weight;
    value.pdf += coat.pdf * x.coat_probability;
  }
  return value;
}

bool sample(const Bsdf& b, float u_lobe, const Vec2f& u, BsdfSample* sample) {
  const ExtendedLobes& x = *b.extended;
  const float layers = x.coat_probability + x.sheen_probability;
  if (u_lobe < x.coat_probability) {
    if (!draw_coat(b, u, sample)) return false;
  } else if (u_lobe < layers) {
    if (!draw_sheen(b, u, sample)) return false;
  } else {
    const float rest = std::min((u_lobe - layers) / base_probability(x), 1 - 0x1p-24f);
    if (!draw_base(b, rest, u, sample)) return false;
  }
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
  return base_bsdf::straight_transmittance<true>(b) * passed_by_layers(b, b.wo.z);
}

float scattered_albedo(const Bsdf& b) {
  const ExtendedLobes& x = *b.extended;
  return base_bsdf::scattered_albedo<true>(b) * passed_by_layers(b, b.wo.z) + x.coat.weight +
         luminance(x.sheen.color) * clamp(x.sheen.albedo, 0.0f, 1.0f);
}

base_bsdf::LobeChoice choice_of(const Bsdf& b, DeltaLobe lobe) {
  const ExtendedLobes& x = *b.extended;
  if (lobe == DeltaLobe::coat) {
    if (!x.coat.mirror) return {};
    return {x.coat_probability * 0.5f, x.coat_probability};
  }
  base_bsdf::LobeChoice choice = base_bsdf::choice_of<true>(b, lobe);
  choice.u_lobe = x.coat_probability + x.sheen_probability + base_probability(x) * choice.u_lobe;
  choice.probability *= base_probability(x);
  return choice;
}

bool has_smooth_density(const Bsdf& b) {
  const ExtendedLobes& x = *b.extended;
  return base_bsdf::has_smooth_density<true>(b) || has_sheen(x.sheen) ||
         (x.coat.weight > 0 && !x.coat.mirror);
}

}  // namespace extended_bsdf
}  // namespace tessera::render
