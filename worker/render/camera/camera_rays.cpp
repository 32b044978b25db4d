#include "worker/render/camera/camera_rays.h"

#include <cmath>
#include <limits>

#include "worker/geometry/motion.h"
#include "worker/math/elementary.h"
#include "worker/scene/features.h"

namespace tessera::render {
namespace {

Vec3d column(const Affine3d& m, int k) {
  return {m.rows[0][k], m.rows[1][k], m.rows[2][k]};
}

/// `m` with orthogonal axes, which interpolation between two keys does not preserve.
Affine3d upright(const Affine3d& m) {
  const Vec3d z = normalize(column(m, 2)), up = column(m, 1);
  const Vec3d y = normalize(up - z * dot(z, up)), x = cross(y, z);
  return {{Vec3d{x.x, y.x, z.x}, Vec3d{x.y, y.y, z.y}, Vec3d{x.z, y.z, z.z}}, m.translation};
}

}  // namespace

CameraRays::CameraRays(const Camera& camera, std::int32_t width, std::int32_t height,
                       std::uint64_t assumed)
    : half_width_(0.5 * width),
      half_height_(0.5 * height),
      center_x_(camera.center_x),
      center_y_(camera.center_y),
      near_(camera.znear),
      far_(camera.zfar),
      horizontal_angle_(camera.horizontal_angle),
      vertical_angle_(camera.vertical_angle),
      kind_(camera.kind),
      lens_(camera.lens),
      takes_lens_(camera.lens.radius > 0 || (assumed & kFeatureLens) != 0),
      slant_x_(camera.slant_x),
      slant_y_(camera.slant_y),
      keys_(camera.keys) {
  place(camera.camera_to_world);
  const double half_extent =
      kind_ == Camera::Kind::perspective
          ? elementary::sin(0.5 * camera.yfov) / elementary::cos(0.5 * camera.yfov)
          : camera.ymag;
  pixel_ = half_extent / half_height_;
  set_footprint();
}

void CameraRays::set_footprint() {
  const double angle_per_pixel = vertical_angle_ / (2 * half_height_);
  if (kind_ == Camera::Kind::orthographic) {
    footprint_at_start_ = static_cast<float>(pixel_);
  } else {
    const double growth = kind_ == Camera::Kind::perspective ? pixel_ : angle_per_pixel;
    footprint_growth_ = static_cast<float>(growth);
    footprint_at_start_ = static_cast<float>(growth * near_);
  }
}

void CameraRays::start_near(const Vec3d& low, const Vec3d& high) {
  // Rounding an origin and a direction to float moves the ray at distance D by up to 2^-23 D. Below
  // this number of box diagonals that is less than a diagonal / 8000, below a pixel of most images.
  constexpr double kFar = 1024;
  const double diagonal = length(high - low);
  double nearest = std::numeric_limits<double>::infinity();
  for (unsigned corner = 0; corner < 8; ++corner) {
    const Vec3d p{(corner & 1) != 0 ? high.x : low.x, (corner & 2) != 0 ? high.y : low.y,
                  (corner & 4) != 0 ? high.z : low.z};
    const double depth = dot(p - eye_, forward_);
    if (depth < nearest) nearest = depth;
  }
  // Rays of a curved projection start on a sphere, which the box's circumsphere must not meet.
  if (kind_ > Camera::Kind::orthographic) {
    nearest = length((low + high) * 0.5 - eye_) - 0.5 * diagonal;
  }
  const double start = nearest - diagonal;
  if (!(diagonal > 0 && start > kFar * diagonal && start > near_)) return;
  near_ = start < far_ ? start : far_;
  set_footprint();
}

void CameraRays::place(const Affine3d& camera_to_world) {
  right_ = normalize(column(camera_to_world, 0));
  up_ = normalize(column(camera_to_world, 1));
  forward_ = -normalize(column(camera_to_world, 2));
  eye_ = camera_to_world.translation;
  along_ = forward_;
  if (slant_x_ != 0 || slant_y_ != 0) {
    along_ = forward_ + right_ * slant_x_ + up_ * slant_y_;
    along_length_ = length(along_);
  }
}

CameraRays CameraRays::at(float time) const {
  std::size_t next = 1;
  while (next + 1 < keys_.size() && keys_[next].time <= time) ++next;
  const CameraKey &a = keys_[next - 1], &b = keys_[next];
  const float f = (time - a.time) / (b.time - a.time);
  CameraRays now = *this;
  now.place(upright(lerp(a.camera_to_world, b.camera_to_world, f)));
  now.lens_.focus_distance =
      a.focus_distance + (b.focus_distance - a.focus_distance) * static_cast<double>(f);
  return now;
}

bool CameraRays::ray(double x, double y, Vec2f lens, CameraRay* out) const {
  if (kind_ > Camera::Kind::orthographic) return from_curved_projection(x, y, out);
  const Vec2d at = slope_at(x, y);
  if (lens_.radius > 0) return through_lens(at, aperture_point(lens_, lens), out);
  const Vec3d across = right_ * at.x + up_ * at.y;
  if (kind_ == Camera::Kind::perspective) {
    const Vec3d d = forward_ + across;  // reaches depth 1 at d
    const double norm = length(d);
    out->origin = Vec3f(eye_ + d * near_);
    out->direction = Vec3f(d / norm);
    out->t_max = static_cast<float>((far_ - near_) * norm);
  } else {
    out->origin = Vec3f(eye_ + across + along_ * near_);
    out->direction = Vec3f(along_ / along_length_);
    out->t_max = static_cast<float>((far_ - near_) * along_length_);
  }
  return true;
}

bool CameraRays::ray_through(double x, double y, const AperturePoint& point, CameraRay* out) const {
  return through_lens(slope_at(x, y), point, out);
}

Vec2d CameraRays::slope_at(double x, double y) const {
  return {(x - half_width_) * pixel_ + center_x_, (half_height_ - y) * pixel_ + center_y_};
}

FilmPoint CameraRays::film_point(const Vec2d& slope) const {
  return {half_width_ + (slope.x - center_x_) / pixel_,
          half_height_ - (slope.y - center_y_) / pixel_};
}

Vec3d CameraRays::local(const Vec3d& p) const {
  const Vec3d from_eye = p - eye_;
  return {dot(from_eye, right_), dot(from_eye, up_), dot(from_eye, forward_)};
}

/// Thin lens: all rays of a film point meet where the ray through the lens's centre hits the plane
/// of focus. Source: Pharr, Jakob & Humphreys, "Physically Based Rendering", 4th edition, section
/// 5.2.3.
bool CameraRays::through_lens(const Vec2d& slope, const AperturePoint& point,
                              CameraRay* out) const {
  const double slope_x = slope.x - point.x / lens_.focus_distance;
  const double slope_y = slope.y - point.y / lens_.focus_distance;
  const double rim_x = point.x + slope_x * lens_.rim_distance;
  const double rim_y = point.y + slope_y * lens_.rim_distance;
  if (rim_x * rim_x + rim_y * rim_y > lens_.rim_radius * lens_.rim_radius) return false;
  const Vec3d d = forward_ + right_ * slope_x + up_ * slope_y;
  const double norm = length(d);
  out->origin = Vec3f(eye_ + right_ * point.x + up_ * point.y + d * near_);
  out->direction = Vec3f(d / norm);
  out->t_max = static_cast<float>((far_ - near_) * norm);
  return true;
}

bool CameraRays::from_curved_projection(double x, double y, CameraRay* out) const {
  Vec3d local;  // right, up, forward
  if (kind_ == Camera::Kind::spherical || kind_ == Camera::Kind::cylindrical) {
    const auto turn = elementary::sincos(0.5 * (x / half_width_ - 1) * horizontal_angle_);
    const double rise = 1 - y / half_height_;  // -1 to 1
    if (kind_ == Camera::Kind::spherical) {
      const auto lift = elementary::sincos(0.5 * rise * vertical_angle_);
      local = {turn.sin * lift.cos, lift.sin, turn.cos * lift.cos};
    } else {
      local = normalize(Vec3d{turn.sin, rise * elementary::tan(0.5 * vertical_angle_), turn.cos});
    }
  } else {
    const double circle = half_width_ < half_height_ ? half_width_ : half_height_;
    const double px = (x - half_width_) / circle, py = (half_height_ - y) / circle;
    const double r = std::sqrt(px * px + py * py);
    if (r > 1) return false;
    const double widest = 0.5 * horizontal_angle_;
    const double angle = kind_ == Camera::Kind::equidistant
                             ? r * widest
                             : 2 * elementary::asin(r * elementary::sin(0.5 * widest));
    const auto bend = elementary::sincos(angle);
    const double scale = r > 0 ? bend.sin / r : 0;
    local = {px * scale, py * scale, bend.cos};
  }
  const Vec3d d = right_ * local.x + up_ * local.y + forward_ * local.z;
  out->origin = Vec3f(eye_ + d * near_);
  out->direction = Vec3f(normalize(d));
  out->t_max = static_cast<float>(far_ - near_);
  return true;
}

std::optional<FilmPoint> CameraRays::project(const Vec3d& p) const {
  const Vec3d at = local(p);
  if (kind_ > Camera::Kind::orthographic) return to_curved_projection(at);
  if (kind_ != Camera::Kind::perspective)
    return film_point({at.x - slant_x_ * at.z, at.y - slant_y_ * at.z});
  if (!(at.z > 0)) return std::nullopt;
  return film_point({at.x / at.z, at.y / at.z});
}

std::optional<FilmPoint> CameraRays::to_curved_projection(const Vec3d& local) const {
  if (kind_ == Camera::Kind::spherical || kind_ == Camera::Kind::cylindrical) {
    const double turn = elementary::atan2(local.x, local.z);
    const double level = std::sqrt(local.x * local.x + local.z * local.z);
    if (!(level > 0)) return std::nullopt;
    const double rise = kind_ == Camera::Kind::spherical
                            ? elementary::atan2(local.y, level) / (0.5 * vertical_angle_)
                            : local.y / (level * elementary::tan(0.5 * vertical_angle_));
    return FilmPoint{half_width_ * (1 + turn / (0.5 * horizontal_angle_)),
                     half_height_ * (1 - rise)};
  }
  const double aside = std::sqrt(local.x * local.x + local.y * local.y);
  const double angle = elementary::atan2(aside, local.z), widest = 0.5 * horizontal_angle_;
  const double r = kind_ == Camera::Kind::equidistant
                       ? angle / widest
                       : elementary::sin(0.5 * angle) / elementary::sin(0.5 * widest);
  const double circle = half_width_ < half_height_ ? half_width_ : half_height_;
  const double scale = aside > 0 ? circle * r / aside : 0;
  return FilmPoint{half_width_ + local.x * scale, half_height_ - local.y * scale};
}

double CameraRays::depth(const Vec3f& p) const {
  return dot(Vec3d(p) - eye_, forward_);
}

}  // namespace tessera::render
