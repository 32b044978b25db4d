#include "worker/render/spots/lens_spots.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>

#include "worker/geometry/ray.h"

namespace tessera::render {
namespace {

/// A light matters to a block of pixels if this part of their samples at most would find it anyway.
constexpr double kMaxChance = 0.75;
/// Pixels on each side of a block.
constexpr std::int32_t kBlock = 8;
/// Lights of a block, at most: those of the greatest weight.
constexpr std::size_t kMaxShares = 16;
/// Semiaxes of an ellipsoid in standard deviations of the projections of its points.
constexpr double kRadius = 2;

double covariance(const SearchedLight& light, const Vec3d& axis) {
  return dot(axis, Vec3d{dot(light.covariance[0], axis), dot(light.covariance[1], axis),
                         dot(light.covariance[2], axis)});
}

/// The box around the light's corners, or around its ellipsoid if they are unknown.
LensSpot box_of(const SearchedLight& light, const CameraRays& camera) {
  LensSpot spot;
  if (light.corners.empty()) {
    const std::array<Vec3d, 3> axes = camera.axes();
    const Vec3d centre = camera.local(light.centre);
    for (int k = 0; k < 3; ++k) {
      const double half =
          kRadius * std::sqrt(std::max(covariance(light, axes[static_cast<std::size_t>(k)]), 0.0));
      spot.low[k] = centre[k] - half;
      spot.high[k] = centre[k] + half;
    }
    return spot;
  }
  spot.low = spot.high = camera.local(light.corners[0]);
  for (const Vec3d& corner : light.corners) {
    const Vec3d p = camera.local(corner);
    for (int k = 0; k < 3; ++k) {
      spot.low[k] = std::min(spot.low[k], p[k]);
      spot.high[k] = std::max(spot.high[k], p[k]);
    }
  }
  return spot;
}

/// Luminance of the light as seen from a point of the lens; 0 if it is hidden from there.
float brightness_from(const AperturePoint& point, const SearchedLight& light,
                      const CameraRays& camera, SpecularTracer* tracer) {
  const Vec3d centre = camera.local(light.centre);
  const double out_of_focus = 1 - centre.z / camera.lens().focus_distance;
  const Vec2d slope{(centre.x - point.x * out_of_focus) / centre.z,
                    (centre.y - point.y * out_of_focus) / centre.z};
  CameraRay start{{}, {0, 0, 1}, -1};
  const FilmPoint film = camera.film_point(slope);
  if (!camera.ray_through(film.x, film.y, point, &start) || !(start.t_max > 0)) return 0;
  Ray ray;
  ray.origin = start.origin;
  ray.direction = start.direction;
  ray.t_max = start.t_max;
  const double along = dot(light.centre - Vec3d(ray.origin), Vec3d(ray.direction));
  const std::optional<SpecularSegment> met = tracer->follow(ray, SpecularSegment{});
  if (!met) return 0;
  const double beside = std::fabs(double{met->ray.t_max} - along);
  return beside <= 1.1 * light.radius + 1e-3 * along ? met->emitted : 0;
}

}  // namespace

std::vector<LensSpot> find_lens_spots(const CameraRays& camera, SpecularTracer tracer,
                                      std::span<const SearchedLight> lights) {
  const double part = 0.7 * camera.lens().radius;
  const std::array<AperturePoint, 5> points = {
      AperturePoint{0, 0}, {part, 0}, {-part, 0}, {0, part}, {0, -part}};
  const double focus = camera.lens().focus_distance;
  std::vector<LensSpot> spots;
  for (const SearchedLight& light : lights) {
    if (light.distant) continue;
    LensSpot spot = box_of(light, camera);
    if (!(spot.low.z > 0) || (spot.low.z <= focus && focus <= spot.high.z)) continue;
    for (const AperturePoint& point : points)
      spot.brightness = std::max(spot.brightness, brightness_from(point, light, camera, &tracer));
    if (spot.brightness > 0 && std::isfinite(spot.brightness)) spots.push_back(spot);
  }
  return spots;
}

/// A part of the lens, metres.
struct LensSpots::Rectangle {
  std::array<Interval, 2> sides;  // across and up

  double area() const { return sides[0].length() * sides[1].length(); }
  bool contains(const AperturePoint& p) const {
    return sides[0].contains(p.x) && sides[1].contains(p.y);
  }
};

/// Where rays from film points between `first` and `last` to the box of the light pass through the
/// lens, on one axis: at l = (q - s z) / (1 - z / f) for a film point s, a point (q, z) of the box
/// and the distance f of the plane of focus. Each of them moves l in one direction, so the corners
/// have the extremes.
LensSpots::Interval LensSpots::seen_through(const LensSpot& spot, int axis, double first,
                                            double last) const {
  Interval all{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  for (const double z : {spot.low.z, spot.high.z}) {
    const double scale = 1 / (1 - z / camera_.lens().focus_distance);
    for (const double q : {spot.low[axis], spot.high[axis]}) {
      for (const double slope : {first, last}) {
        const double l = (q - slope * z) * scale;
        all = {std::min(all.low, l), std::max(all.high, l)};
      }
    }
  }
  return all;
}

/// The part of the lens through which a light is seen from a film point, in the square around the
/// aperture.
LensSpots::Rectangle LensSpots::seen_through(const LensSpot& spot, const Vec2d& slope) const {
  const double radius = camera_.lens().radius;
  return {{seen_through(spot, 0, slope.x, slope.x).cut(radius),
           seen_through(spot, 1, slope.y, slope.y).cut(radius)}};
}

/// Density of second paths per square metre of the lens.
double LensSpots::density(std::span<const Share> shares, const AperturePoint& point,
                          const Vec2d& slope) const {
  double sum = 0;
  for (const Share& share : shares) {
    const Rectangle r = seen_through(spots_[share.spot], slope);
    const double area = r.area();
    if (area > 0 && r.contains(point)) sum += double{share.probability} / area;
  }
  return sum;
}

float LensSpots::Pixel::weight(const AperturePoint& point, const Vec2d& slope) const {
  const double usual = 1 / aperture_area(all_->camera_.lens());
  return static_cast<float>(usual / (usual + all_->density(shares_, point, slope)));
}

LensSpots::Pixel::Second LensSpots::Pixel::sample(float choice, const Vec2f& u,
                                                  const Vec2d& slope) const {
  const Share* share = shares_.data();
  for (; share != &shares_.back() && choice >= share->probability; ++share)
    choice -= share->probability;
  const Rectangle r = all_->seen_through(all_->spots_[share->spot], slope);
  Second second;
  if (!(r.area() > 0)) return second;
  second.point = {r.sides[0].at(double{u.x}), r.sides[1].at(double{u.y})};
  // Balance heuristic: the density of the second path cancels. There is no light beyond the
  // aperture.
  if (is_in_aperture(all_->camera_.lens(), second.point))
    second.weight = weight(second.point, slope);
  return second;
}

/// Adds the lights that samples with film points between `first` and `last` may find, among those
/// in the same row of blocks.
void LensSpots::add_block(const std::vector<std::uint32_t>& in_row, const Vec2d& first,
                          const Vec2d& last) {
  struct Candidate {
    std::uint32_t spot = 0;
    double weight = 0;
  };
  const Lens& lens = camera_.lens();
  const Vec2d middle{(first.x + last.x) / 2, (first.y + last.y) / 2};
  std::vector<Candidate> found;
  for (const std::uint32_t i : in_row) {
    const LensSpot& spot = spots_[i];
    const double width = seen_through(spot, 0, first.x, last.x).cut(lens.radius).length();
    if (!(width > 0)) continue;
    const double reached = width * seen_through(spot, 1, first.y, last.y).cut(lens.radius).length();
    const double area = seen_through(spot, 0, middle.x, middle.x).length() *
                        seen_through(spot, 1, middle.y, middle.y).length();
    if (!(area > 0) || area > kMaxChance * aperture_area(lens)) continue;
    found.push_back({i, double{spot.brightness} * std::min(area, reached)});
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const Candidate& a, const Candidate& b) { return a.weight > b.weight; });
  if (found.size() > kMaxShares) found.resize(kMaxShares);
  double sum = 0;
  for (const Candidate& candidate : found) sum += candidate.weight;
  for (const Candidate& candidate : found)
    shares_.push_back({candidate.spot, static_cast<float>(candidate.weight / sum)});
  first_.push_back(static_cast<std::uint32_t>(shares_.size()));
}

LensSpots::LensSpots(std::vector<LensSpot> spots, const CameraRays& camera,
                     const PixelFilterSampler& filter, std::int32_t width, std::int32_t height)
    : camera_(camera),
      spots_(std::move(spots)),
      columns_((width + kBlock - 1) / kBlock),
      first_{0} {
  const double margin = double{filter.width()} / 2 + 0.5;
  for (std::int32_t y = 0; y < height; y += kBlock) {
    // From the bottom left to the top right, as slopes go.
    const double bottom = y + kBlock - 0.5 + margin, top = y + 0.5 - margin;
    const double low = camera.slope_at(0, bottom).y, high = camera.slope_at(0, top).y;
    std::vector<std::uint32_t> in_row;
    for (std::uint32_t i = 0; i < spots_.size(); ++i) {
      if (seen_through(spots_[i], 1, low, high).cut(camera.lens().radius).length() > 0)
        in_row.push_back(i);
    }
    for (std::int32_t x = 0; x < width; x += kBlock) {
      add_block(in_row, camera.slope_at(x + 0.5 - margin, bottom),
                camera.slope_at(x + kBlock - 0.5 + margin, top));
    }
  }
}

LensSpots::Pixel LensSpots::at(std::int32_t x, std::int32_t y) const {
  const auto block = static_cast<std::size_t>(y / kBlock) * static_cast<std::size_t>(columns_) +
                     static_cast<std::size_t>(x / kBlock);
  Pixel pixel;
  pixel.shares_ = std::span(shares_).subspan(first_[block], first_[block + 1] - first_[block]);
  pixel.all_ = this;
  return pixel;
}

std::int64_t LensSpots::memory_bytes() const {
  return static_cast<std::int64_t>(spots_.size() * sizeof(LensSpot) +
                                   first_.size() * sizeof(std::uint32_t) +
                                   shares_.size() * sizeof(Share));
}

}  // namespace tessera::render
