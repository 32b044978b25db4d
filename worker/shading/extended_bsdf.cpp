#include "worker/shading/extended_bsdf.h"

#include "worker/shading/base_bsdf.h"

namespace tessera::render {
namespace {

using base_bsdf::to_local;
using base_bsdf::to_world;
using warp::kInvPi;

constexpr float kLeastProbability = 0.05f;  // of a lobe that carries anything

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

/// Value and density of the coat alone, before its weight and probability.
BsdfValue evaluate_coat(const CoatLobe& coat, const Vec3f& wi) {
  const Vec3f local = to_local(coat.frame, wi);
  if (coat.mirror || !(local.z > 0)) return {};
  const float d = ggx_d(direction_of(coat.wo + local), coat.alpha);
  const float v =
      smith_visibility(coat.wo.z, local.z, coat.root_o, smith_root(local.z, coat.alpha));
  const float f_cos = d * v * local.z;
  return {{f_cos, f_cos, f_cos}, visible_normal_density(d, coat.wo.z, coat.root_o) * 0.25f};
}

/// A direction the coat reflects wo to; false if it is lost.
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
  sample->wi = direction_of(to_world(coat.frame, local));
  if (local.z > 0 && dot(sample->wi, b.frame.geometric_normal) > 0) return true;
  if (!coat.mirror) return false;
  sample->wi = base_bsdf::mirrored_in_surface(b.frame, to_world(coat.frame, coat.wo));
  return dot(sample->wi, b.frame.geometric_normal) > 0;
}

/// Everything under the coat, as far as draw() scatters it.
float albedo_below(const Bsdf& b) {
  const bool straight = b.mirror && b.interface == Interface::thin;
  const float through = straight ? 0 : luminance(b.transmit * base_bsdf::layer_at(b, b.wo.z).pass);
  return base_bsdf::scattered_albedo(b) + through;
}

void choose_layers(Bsdf* b) {
  ExtendedLobes& x = *b->extended;
  if (!(x.coat.weight > 0)) return;
  const float below = (1 - x.coat.weight) * albedo_below(*b);
  x.coat_probability = below > 0 ? clamp(x.coat.weight / (x.coat.weight + below), kLeastProbability,
                                         1 - kLeastProbability)
                                 : 1;
}

/// Share of light that passes the layers over the base on its way to wo.
float passed_by_layers(const Bsdf& b) {
  return 1 - b.extended->coat.weight;
}

}  // namespace

Bsdf make_extended_bsdf(const BsdfParameters& p, const BsdfExtensions& extensions,
                        const BsdfTables& tables, const BsdfFrame& frame,
                        const BsdfFrame& coat_frame, const Vec3f& wo) {
  Bsdf b;
  base_bsdf::prepare(p, tables, frame, wo, &b);
  ExtendedLobes& x = b.extended.emplace();
  // A solid's boundary is coated on its outside.
  const bool outside = p.front || b.interface != Interface::solid;
  if (extensions.coat > 0 && outside) x.coat = coat_lobe(extensions, coat_frame, wo);
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
    value = base_bsdf::evaluate(b, local);
    value.f_cos *= passed_by_layers(b);
    value.pdf *= 1 - x.coat_probability;
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
  float probability = x.coat_probability;
  if (u_lobe < probability) {
    if (!draw_coat(b, u, sample)) return false;
    if (sample->delta) {
      const float weight = x.coat.weight / probability;
      sample->weight = {weight, weight, weight};
    }
  } else {
    probability = 1 - probability;
    Vec3f local;
    if (!base_bsdf::draw(b, (u_lobe - x.coat_probability) / probability, u, sample, &local)) {
      return false;
    }
    if (sample->delta) sample->weight *= passed_by_layers(b) / probability;
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
  return base_bsdf::straight_transmittance(b) * passed_by_layers(b);
}

float scattered_albedo(const Bsdf& b) {
  return base_bsdf::scattered_albedo(b) * passed_by_layers(b) + b.extended->coat.weight;
}

bool has_smooth_density(const Bsdf& b) {
  const CoatLobe& coat = b.extended->coat;
  return base_bsdf::has_smooth_density(b) || (coat.weight > 0 && !coat.mirror);
}

}  // namespace extended_bsdf
}  // namespace tessera::render
