#include "worker/render/camera_rays.h"

#include <cmath>

#include "worker/math/elementary.h"

namespace tessera::render {
namespace {

Vec3d column(const Affine3d& m, int k) {
  return {m.rows[0][k], m.rows[1][k], m.rows[2][k]};
}

}  // namespace

CameraRays::CameraRays(const Camera& camera, std::int32_t width, std::int32_t height)
    : right_(normalize(column(camera.camera_to_world, 0))),
      up_(normalize(column(camera.camera_to_world, 1))),
      forward_(-normalize(column(camera.camera_to_world, 2))),
      eye_(camera.camera_to_world.translation),
      half_width_(0.5 * width),
      half_height_(0.5 * height),
      near_(camera.znear),
      far_(camera.zfar),
      perspective_(camera.kind == Camera::Kind::perspective) {
  const double half_extent =
      perspective_ ? elementary::sin(0.5 * camera.yfov) / elementary::cos(0.5 * camera.yfov)
                   : camera.ymag;
  pixel_ = half_extent / half_height_;
}

CameraRay CameraRays::ray(double x, double y) const {
  const Vec3d across = right_ * ((x - half_width_) * pixel_) + up_ * ((half_height_ - y) * pixel_);
  CameraRay r;
  if (perspective_) {
    const Vec3d d = forward_ + across;  // reaches depth 1 at d
    const double stretch = length(d);
    r.origin = Vec3f(eye_ + d * near_);
    r.direction = Vec3f(d / stretch);
    r.t_max = static_cast<float>((far_ - near_) * stretch);
  } else {
    r.origin = Vec3f(eye_ + across + forward_ * near_);
    r.direction = Vec3f(forward_);
    r.t_max = static_cast<float>(far_ - near_);
  }
  return r;
}

double CameraRays::depth(const Vec3f& p) const {
  return dot(Vec3d(p) - eye_, forward_);
}

}  // namespace tessera::render
