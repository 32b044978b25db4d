#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "worker/math/vector.h"
#include "worker/render/camera/aperture.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// A camera ray, computed in double and rounded once.
struct CameraRay {
  Vec3f origin;     // on the near plane (curved projections: near sphere), recentred world
  Vec3f direction;  // unit
  float t_max = 0;  // to the far plane or sphere
};

/// A point of the film, pixels from its top left corner.
struct FilmPoint {
  double x = 0, y = 0;
};

/// Generates camera rays from film points. yfov or ymag is kept and the image's aspect ratio
/// determines the width; y points down the film, and pixel (i, j) covers [i, i + 1) x [j, j + 1). A
/// spherical or cylindrical panorama fills the image, a fisheye the largest circle in it.
class CameraRays {
 public:
  /// `assumed`: see TraceOptions.
  CameraRays(const Camera& camera, std::int32_t width, std::int32_t height,
             std::uint64_t assumed = 0);

  /// Starts rays just before the box `low` to `high` (recentred world), which contains everything
  /// that they can meet, if the camera is so far from it that the rounding of rays at the near
  /// plane would show. Requires !moves().
  void start_near(const Vec3d& low, const Vec3d& high);

  /// Returns whether rays depend on the time.
  bool moves() const { return !keys_.empty(); }
  /// The camera at a time in [0, 1] of the exposure. Requires moves().
  CameraRays at(float time) const;

  /// Returns whether ray() uses `lens`.
  bool takes_lens() const { return takes_lens_; }

  /// The ray through film point (x, y), in pixels of the full frame, and through the point of the
  /// aperture to which `lens`, in [0, 1)^2, is mapped uniformly. Returns false and leaves `out`
  /// unchanged where the film receives no light: outside a fisheye's circle or behind the lens's
  /// rim.
  bool ray(double x, double y, Vec2f lens, CameraRay* out) const;

  /// The lens; its radius is 0 without one. The functions below are for cameras with a lens.
  const Lens& lens() const { return lens_; }
  /// The same ray through a given point of the aperture.
  bool ray_through(double x, double y, const AperturePoint& point, CameraRay* out) const;
  /// How far to the right and up a ray through the lens's centre is after 1 metre of depth, for a
  /// film point, and the film point for that.
  Vec2d slope_at(double x, double y) const;
  FilmPoint film_point(const Vec2d& slope) const;
  /// Coordinates of `p` (recentred world): right, up and forward of the camera, metres.
  Vec3d local(const Vec3d& p) const;
  /// Unit vectors to the right, up and forward.
  std::array<Vec3d, 3> axes() const { return {right_, up_, forward_}; }

  /// Width of a pixel's footprint at the ray's origin, metres, and its growth per metre.
  float footprint_at_start() const { return footprint_at_start_; }
  float footprint_growth() const { return footprint_growth_; }

  /// Distance of `p` (recentred world) along the viewing direction, metres.
  double depth(const Vec3f& p) const;

  /// Film point, as for ray(), of `p` (recentred world) for a ray through the lens's centre. It may
  /// be outside the image. nullopt if there is no such ray, as for points behind a perspective
  /// camera.
  std::optional<FilmPoint> project(const Vec3d& p) const;

 private:
  void place(const Affine3d& camera_to_world);
  void set_footprint();
  bool through_lens(const Vec2d& slope, const AperturePoint& point, CameraRay* out) const;
  bool from_curved_projection(double x, double y, CameraRay* out) const;
  std::optional<FilmPoint> to_curved_projection(const Vec3d& local) const;

  Vec3d right_, up_, forward_, eye_;
  Vec3d along_;                      // direction of orthographic rays per metre of depth
  double along_length_ = 1;          // its length
  double pixel_ = 0;                 // world units per pixel, at unit distance if perspective
  double half_width_, half_height_;  // pixels
  double center_x_, center_y_;       // film centre in world units, at unit distance if perspective
  double near_, far_;
  double horizontal_angle_, vertical_angle_;
  float footprint_at_start_ = 0, footprint_growth_ = 0;
  Camera::Kind kind_;
  Lens lens_;
  bool takes_lens_;
  double slant_x_, slant_y_;
  std::span<const CameraKey> keys_;  // of the camera, which must outlive this if it moves
};

}  // namespace tessera::render
