#include "worker/light/tree/light_bounds.h"

#include <algorithm>
#include <cmath>

#include "worker/math/elementary.h"

namespace tessera::render {
namespace {

constexpr double kPi = 3.14159265358979323846;

double angle_of_cosine(double cosine) {
  return elementary::acos(clamp(cosine, -1.0, 1.0));
}

/// Mean of the axes and the angle around it that contains their cones; all directions if the axes
/// cancel. Poses in which the light vanishes have no direction.
void unite_directions(const std::vector<LightBounds>& poses, LightBounds& all) {
  Vec3d sum;
  for (const LightBounds& pose : poses) {
    if (pose.strength > 0) sum += pose.axis;
  }
  const double size = length(sum);
  all.normal_angle = kPi;
  if (!(size > 0)) return;
  all.axis = sum / size;
  double widest = 0;
  for (const LightBounds& pose : poses) {
    if (!(pose.strength > 0)) continue;
    widest = std::max(widest, angle_of_cosine(dot(all.axis, pose.axis)) + pose.normal_angle);
  }
  all.normal_angle = std::min(widest, kPi);
}

}  // namespace

LightBounds bounds_of(const Corners& corners, bool mirrored) {
  const auto& [a, b, c] = corners;
  LightBounds light;
  light.box_min = min(a, min(b, c));
  light.box_max = max(a, max(b, c));
  const Vec3d normal = cross(b - a, c - a);
  const double size = length(normal);
  light.strength = 0.5 * size;
  if (size > 0) light.axis = normal * ((mirrored ? -1 : 1) / size);
  light.emission_angle = kPi / 2;
  return light;
}

LightBounds bounds_of(const PunctualLight& light, const PunctualPose& pose) {
  LightBounds b;
  b.box_min = b.box_max = pose.position;
  b.axis = Vec3d(pose.direction);
  b.strength = luminance(light.intensity);
  if (light.kind == PunctualLight::Kind::spot) {
    b.normal_angle = angle_of_cosine(static_cast<double>(light.cos_inner));
    b.emission_angle =
        std::max(angle_of_cosine(static_cast<double>(light.cos_outer)) - b.normal_angle, 0.0);
  } else {
    b.normal_angle = kPi;
    b.emission_angle = kPi / 2;
  }
  return b;
}

LightBounds bounds_over(const std::vector<LightBounds>& poses) {
  LightBounds all = poses.front();
  for (const LightBounds& pose : poses) {
    all.box_min = min(all.box_min, pose.box_min);
    all.box_max = max(all.box_max, pose.box_max);
    all.strength = std::max(all.strength, pose.strength);
  }
  unite_directions(poses, all);
  return all;
}

}  // namespace tessera::render
