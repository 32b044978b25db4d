#pragma once

#include "worker/math/vector.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// max(min(1 - (d / range)^4, 1), 0): 1 for an infinite range. Source: KHR_lights_punctual.
constexpr float range_attenuation(float distance, float range) {
  const float q = distance / range;
  const float q2 = q * q;
  return clamp(1 - q2 * q2, 0.0f, 1.0f);
}

/// Intensity of a spot in a direction `cos_theta` off its axis: 1 inside the inner cone, 0 outside
/// the outer cone, a squared ramp between them, a step if they are equal. Source:
/// KHR_lights_punctual, but without its lower limit of 0.001 for the ramp's width, which would
/// darken narrow spots inside their inner cone.
constexpr float spot_attenuation(float cos_theta, float cos_inner, float cos_outer) {
  const float width = cos_inner - cos_outer;
  if (!(width > 0)) return cos_theta >= cos_outer ? 1 : 0;
  const float a = clamp((cos_theta - cos_outer) * (1 / width), 0.0f, 1.0f);
  return a * a;
}

/// Light from a punctual light at one point.
struct PunctualSample {
  Vec3f direction;     // unit, towards the light
  float distance = 0;  // metres; infinite for directional lights
  Vec3f irradiance;    // on a surface facing it, lux: I / d^2, or E; zero outside cone and range
};

/// Samples the light at `pose`.
inline PunctualSample sample_punctual(const PunctualLight& light, const PunctualPose& pose,
                                      const Vec3f& point) {
  if (light.kind == PunctualLight::Kind::directional) {
    return {-pose.direction, std::numeric_limits<float>::infinity(), light.intensity};
  }
  const Vec3f to_light = Vec3f(pose.position) - point;
  const float distance = length(to_light);
  PunctualSample s;
  s.direction = normalize(to_light);
  s.distance = distance;
  if (!(distance > 0)) return s;
  float share = range_attenuation(distance, light.range);
  if (light.kind == PunctualLight::Kind::spot) {
    share *= spot_attenuation(-dot(s.direction, pose.direction), light.cos_inner, light.cos_outer);
  }
  s.irradiance = light.intensity * share / (distance * distance);
  return s;
}

inline PunctualSample sample_punctual(const PunctualLight& light, const Vec3f& point) {
  return sample_punctual(light, light, point);
}

}  // namespace tessera::render
