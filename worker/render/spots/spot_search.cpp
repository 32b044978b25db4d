#include "worker/render/spots/spot_search.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "worker/geometry/frame.h"
#include "worker/math/elementary.h"
#include "worker/render/spots/specular_segments.h"

namespace tessera::render {
namespace {

constexpr double kPi = 3.14159265358979323846;
/// Rays of the grid, about.
constexpr double kGridRays = 16384;
/// Levels of division of the grid's cells, and how many cells each level divides at most.
constexpr int kLevels = 4;
constexpr std::size_t kDividedCells = 2048;
/// Rays along one way that differ by more than this angle, in radians, are too far apart.
constexpr double kMaxAngle = 0.2;
/// Radius of a disk in standard deviations of its points.
constexpr double kRadius = 2;
/// The outline of a light without corners is a polygon around its ellipse.
constexpr int kSides = 12;
constexpr int kMaxSteps = 12, kCornerSteps = 4;
/// Newton's method ends at this squared distance from the centre, relative to the ellipse, and at
/// this distance from a corner, pixels.
constexpr double kCloseEnough = 0.01, kCloseToCorner = 1e-4;
/// A triangle of the grid may surround an image if linear interpolation puts it this far outside,
/// relative to the triangle.
constexpr double kSlack = 0.25;

/// Two-dimensional linear algebra, in pixels or metres.
struct Matrix2 {
  double xx = 0, xy = 0, yx = 0, yy = 0;
  double determinant() const { return xx * yy - xy * yx; }
  Matrix2 inverse() const {
    const double d = 1 / determinant();
    return {yy * d, -xy * d, -yx * d, xx * d};
  }
  Vec2d times(const Vec2d& v) const { return {xx * v.x + xy * v.y, yx * v.x + yy * v.y}; }
};

/// A plane across a ray through a light, in which rays are compared.
struct Across {
  Vec3d u, v;

  explicit Across(const Vec3f& direction) {
    const Frame frame = Frame::from_normal(direction);
    u = Vec3d(frame.s);
    v = Vec3d(frame.t);
  }
  Vec2d at(const Vec3d& d) const { return {dot(u, d), dot(v, d)}; }
};

/// Where a ray is aimed: at a point, or in the unit direction towards a distant one.
struct Target {
  bool distant = false;
  Vec3d at;

  explicit Target(const SearchedLight& light) : distant(light.distant), at(light.centre) {}
  explicit Target(const Vec3d& point) : at(point) {}
};

/// How far a ray passes a target.
struct Miss {
  Vec3d by;          // from the ray's closest point to the target
  double along = 0;  // distance to that point; of a distant target a cosine
};

Miss miss_of(const Ray& ray, const Target& target) {
  const Vec3d direction(ray.direction);
  const Vec3d to = target.distant ? target.at : target.at - Vec3d(ray.origin);
  const double along = dot(to, direction);
  return {to - direction * along, along};
}

double length_of(const Vec2d& v) {
  return std::sqrt(v.x * v.x + v.y * v.y);
}

using Segments = std::vector<SpecularSegment>;

/// A camera ray of the search, by its place in the picture.
struct Probe {
  Vec2d at;
  Segments segments;
};

/// A square of the picture. Corners are in the order of rows.
struct Cell {
  std::array<std::shared_ptr<const Probe>, 4> corners;
  int level = 0;
  float score = 0;  // of dividing it
};

class Search {
 public:
  Search(const SpotSearch& search, std::span<const SearchedLight> lights,
         const ParallelFor& parallel_for)
      : search_(search), lights_(lights), parallel_for_(parallel_for) {
    step_ = std::sqrt((search.width + 2 * search.margin) * (search.height + 2 * search.margin) /
                      kGridRays);
  }

  std::vector<LightSpot> find() const;

 private:
  /// A spot, and which light it shows by which way.
  struct Found {
    std::pair<std::size_t, std::uint64_t> key;
    LightSpot spot;
  };

  std::optional<Ray> ray(const Vec2d& at) const;
  std::shared_ptr<const Probe> probe(const Vec2d& at, SpecularTracer* tracer) const;
  bool is_in_picture(const LightSpot& spot) const;
  std::vector<Found> seen_directly() const;
  std::vector<Cell> first_cells() const;
  std::vector<Cell> divided(std::vector<Cell> cells) const;
  class Collection;
  std::vector<Found> search_cells(const std::vector<Cell>& cells) const;
  void search_cell(const Cell& cell, std::vector<Found>* found) const;
  void search_triangle(const std::array<const Probe*, 3>& corners, int level,
                       SpecularTracer* tracer, std::vector<Found>* found) const;
  struct View;
  std::optional<View> view(const Vec2d& at, double offset, const SpecularSegment& like,
                           const Target& target, SpecularTracer* tracer) const;
  Vec2d image_of(const Target& corner, Vec2d at, double offset, const View& centre,
                 SpecularTracer* tracer) const;
  std::optional<LightSpot> refine(Vec2d at, const SpecularSegment& like, const SearchedLight& light,
                                  SpecularTracer* tracer) const;
  SpecularTracer tracer() const { return {search_.shading, search_.accel, search_.max_depth}; }

  const SpotSearch& search_;
  std::span<const SearchedLight> lights_;
  const ParallelFor& parallel_for_;
  double step_ = 1;  // of the grid, pixels
};

std::optional<Ray> Search::ray(const Vec2d& at) const {
  CameraRay camera{{}, {0, 0, 1}, -1};
  if (!search_.camera.ray(at.x, at.y, {}, &camera) || !(camera.t_max > 0)) return std::nullopt;
  Ray ray;
  ray.origin = camera.origin;
  ray.direction = camera.direction;
  ray.t_max = camera.t_max;
  return ray;
}

std::shared_ptr<const Probe> Search::probe(const Vec2d& at, SpecularTracer* tracer) const {
  auto probe = std::make_shared<Probe>();
  probe->at = at;
  const std::optional<Ray> camera_ray = ray(at);
  if (camera_ray) tracer->trace(*camera_ray, &probe->segments);
  return probe;
}

const SpecularSegment* with_way(const std::vector<SpecularSegment>& segments, std::uint64_t way) {
  for (const SpecularSegment& s : segments) {
    if (s.way == way) return &s;
  }
  return nullptr;
}

/// Where in a triangle of the picture a light's centre lies by linear interpolation of how far the
/// rays through its corners miss it; nullopt if outside.
std::optional<Vec2d> interpolate(const std::array<const SpecularSegment*, 3>& rays,
                                 const std::array<Vec2d, 3>& points, const SearchedLight& light) {
  const Across plane(rays[0]->ray.direction);
  std::array<Vec2d, 3> misses;
  for (std::size_t k = 0; k < 3; ++k) {
    const Miss miss = miss_of(rays[k]->ray, Target(light));
    if (!(miss.along > 0)) return std::nullopt;
    misses[k] = plane.at(miss.by);
  }
  const Matrix2 edges{misses[1].x - misses[0].x, misses[2].x - misses[0].x,
                      misses[1].y - misses[0].y, misses[2].y - misses[0].y};
  if (edges.determinant() == 0) return std::nullopt;
  const Vec2d st = edges.inverse().times({-misses[0].x, -misses[0].y});
  if (!(st.x >= -kSlack) || !(st.y >= -kSlack) || !(st.x + st.y <= 1 + kSlack)) return std::nullopt;
  const auto mix = [&](double a, double b, double c) {
    return a + st.x * (b - a) + st.y * (c - a);
  };
  return Vec2d{mix(points[0].x, points[1].x, points[2].x),
               mix(points[0].y, points[1].y, points[2].y)};
}

/// How much light may be in images that the corners of a cell do not show: the greatest throughput
/// of a way that not all corners have, or have with very different directions.
float score(const std::array<std::shared_ptr<const Probe>, 4>& corners) {
  float most = 0;
  for (const auto& corner : corners) {
    for (const SpecularSegment& segment : corner->segments) {
      if (segment.surfaces == 0 || segment.throughput <= most) continue;
      for (const auto& other : corners) {
        const SpecularSegment* same = with_way(other->segments, segment.way);
        const bool is_alike = same != nullptr && length(Vec3d(same->ray.direction) -
                                                        Vec3d(segment.ray.direction)) <= kMaxAngle;
        if (!is_alike) most = segment.throughput;
      }
    }
  }
  return most;
}

void Search::search_triangle(const std::array<const Probe*, 3>& corners, int level,
                             SpecularTracer* tracer, std::vector<Found>* found) const {
  for (const SpecularSegment& first : corners[0]->segments) {
    const SpecularSegment* second = with_way(corners[1]->segments, first.way);
    const SpecularSegment* third = with_way(corners[2]->segments, first.way);
    if (second == nullptr || third == nullptr) continue;
    for (std::size_t i = 0; i < lights_.size(); ++i) {
      const bool is_seen_directly = first.surfaces == 0;
      if (is_seen_directly && (level > 0 || !lights_[i].distant)) continue;
      const std::optional<Vec2d> start = interpolate(
          {&first, second, third}, {corners[0]->at, corners[1]->at, corners[2]->at}, lights_[i]);
      if (!start) continue;
      const std::optional<LightSpot> spot = refine(*start, first, lights_[i], tracer);
      if (spot) found->push_back({{i, first.way}, *spot});
    }
  }
}

void Search::search_cell(const Cell& cell, std::vector<Found>* found) const {
  SpecularTracer specular = tracer();
  const auto corner = [&](std::size_t k) { return cell.corners[k].get(); };
  search_triangle({corner(0), corner(1), corner(2)}, cell.level, &specular, found);
  search_triangle({corner(3), corner(2), corner(1)}, cell.level, &specular, found);
}

std::vector<Cell> Search::first_cells() const {
  const auto count = [&](std::int32_t pixels) {
    return static_cast<std::int64_t>(std::ceil((pixels + 2 * search_.margin) / step_)) + 1;
  };
  const std::int64_t columns = count(search_.width), rows = count(search_.height);
  std::vector<std::vector<std::shared_ptr<const Probe>>> grid(static_cast<std::size_t>(rows));
  parallel_for_(rows, [&](std::int64_t row) {
    SpecularTracer specular = tracer();
    for (std::int64_t column = 0; column < columns; ++column) {
      grid[static_cast<std::size_t>(row)].push_back(
          probe({static_cast<double>(column) * step_ - search_.margin,
                 static_cast<double>(row) * step_ - search_.margin},
                &specular));
    }
  });
  std::vector<Cell> cells;
  for (std::size_t row = 0; row + 1 < grid.size(); ++row) {
    for (std::size_t column = 0; column + 1 < grid[row].size(); ++column) {
      Cell cell{{grid[row][column], grid[row][column + 1], grid[row + 1][column],
                 grid[row + 1][column + 1]},
                0,
                0};
      cell.score = score(cell.corners);
      cells.push_back(std::move(cell));
    }
  }
  return cells;
}

/// The quarters of the cells with the highest scores.
std::vector<Cell> Search::divided(std::vector<Cell> cells) const {
  std::erase_if(cells, [](const Cell& cell) { return !(cell.score > 0); });
  std::stable_sort(cells.begin(), cells.end(),
                   [](const Cell& a, const Cell& b) { return a.score > b.score; });
  if (cells.size() > kDividedCells) cells.resize(kDividedCells);
  std::vector<Cell> quarters(cells.size() * 4);
  parallel_for_(static_cast<std::int64_t>(cells.size()), [&](std::int64_t i) {
    const Cell& cell = cells[static_cast<std::size_t>(i)];
    SpecularTracer specular = tracer();
    const auto between = [&](std::size_t j, std::size_t k) {
      const Vec2d &a = cell.corners[j]->at, &b = cell.corners[k]->at;
      return probe({(a.x + b.x) / 2, (a.y + b.y) / 2}, &specular);
    };
    const auto& c = cell.corners;
    const auto top = between(0, 1), left = between(0, 2), middle = between(0, 3),
               right = between(1, 3), bottom = between(2, 3);
    const std::array<std::array<std::shared_ptr<const Probe>, 4>, 4> parts = {
        {{c[0], top, left, middle},
         {top, c[1], middle, right},
         {left, middle, c[2], bottom},
         {middle, right, bottom, c[3]}}};
    for (std::size_t k = 0; k < 4; ++k) {
      quarters[static_cast<std::size_t>(i) * 4 + k] = {parts[k], cell.level + 1, score(parts[k])};
    }
  });
  return quarters;
}

/// The covariance of a light's points along two directions.
double covariance(const SearchedLight& light, const Vec3d& p, const Vec3d& q) {
  return dot(p, Vec3d{dot(light.covariance[0], q), dot(light.covariance[1], q),
                      dot(light.covariance[2], q)});
}

/// The points (a q.x, b q.x + c q.y) with |q| <= 1, in pixels.
struct Ellipse {
  double a = 0, b = 0, c = 0;

  double area() const { return kPi * a * c; }
  /// Square of a vector's length, relative to the ellipse.
  double square(const Vec2d& v) const {
    const double qx = v.x / a, qy = (v.y - b * qx) / c;
    return qx * qx + qy * qy;
  }
};

/// The ellipse that the light's points cover in the picture. `back` maps the plane `across` the ray
/// to the picture.
Ellipse ellipse_of(const SearchedLight& light, const Across& across, const Matrix2& back) {
  const Vec3d x = across.u * back.xx + across.v * back.xy;
  const Vec3d y = across.u * back.yx + across.v * back.yy;
  double xx = covariance(light, x, x), yy = covariance(light, y, y);
  const double xy = covariance(light, x, y);
  const double least = (xx + yy) * 1e-4;  // of a light that is seen edge-on
  xx += least;
  yy += least;
  return {kRadius * std::sqrt(xx), kRadius * xy / std::sqrt(xx),
          kRadius * std::sqrt(std::max(yy - xy * xy / xx, 0.0))};
}

/// A polygon around an ellipse.
std::vector<Vec2d> outline_of(const Ellipse& ellipse, const Vec2d& centre) {
  std::vector<Vec2d> outline;
  for (int k = 0; k < kSides; ++k) {
    const elementary::SinCosf angle = elementary::sincos(static_cast<float>(2 * kPi * k / kSides));
    constexpr double kAround = 1.0352761804100830;  // 1 / cos(pi / 12)
    const double x = kAround * double{angle.cos}, y = kAround * double{angle.sin};
    outline.push_back({centre.x + ellipse.a * x, centre.y + ellipse.b * x + ellipse.c * y});
  }
  return convex_hull(std::move(outline));
}

/// Whether the segment ends at the light, which it meets after `along` metres.
bool reaches(const SpecularSegment& segment, const SearchedLight& light, double along) {
  if (light.distant) return !std::isfinite(segment.ray.t_max);
  const double beside = std::fabs(double{segment.ray.t_max} - along);
  return segment.emitted > 0 && beside <= 1.1 * light.radius + 1e-3 * along;
}

/// The picture around the image of a target, estimated from three rays near a point.
struct Search::View {
  SpecularSegment segment;  // of the ray through the point
  Across across;            // this ray
  Matrix2 back;             // from the plane across it to the picture
  double along = 0;         // to the target
  Vec2d step;               // from the point to the image, if the picture were linear
};

/// Differences of rays `offset` pixels apart are the derivatives.
std::optional<Search::View> Search::view(const Vec2d& at, double offset,
                                         const SpecularSegment& like, const Target& target,
                                         SpecularTracer* tracer) const {
  std::array<std::optional<SpecularSegment>, 3> rays;
  const std::array<Vec2d, 3> points = {at, {at.x + offset, at.y}, {at.x, at.y + offset}};
  for (std::size_t k = 0; k < 3; ++k) {
    const std::optional<Ray> camera_ray = ray(points[k]);
    if (camera_ray) rays[k] = tracer->follow(*camera_ray, like);
    if (!rays[k]) return std::nullopt;
  }
  const Across across(rays[0]->ray.direction);
  const Miss miss = miss_of(rays[0]->ray, target);
  if (!(miss.along > 0)) return std::nullopt;
  const Vec2d by = across.at(miss.by);
  const Vec2d right = across.at(miss_of(rays[1]->ray, target).by);
  const Vec2d down = across.at(miss_of(rays[2]->ray, target).by);
  const Matrix2 slope{(right.x - by.x) / offset, (down.x - by.x) / offset,
                      (right.y - by.y) / offset, (down.y - by.y) / offset};
  if (slope.determinant() == 0) return std::nullopt;
  const Matrix2 back = slope.inverse();
  return View{*rays[0], across, back, miss.along, back.times({-by.x, -by.y})};
}

/// The image of a corner of a light, by Newton's method from `at`, near the view of the light's
/// centre. Where the rays take other ways, the picture counts as linear.
Vec2d Search::image_of(const Target& corner, Vec2d at, double offset, const View& centre,
                       SpecularTracer* tracer) const {
  const Vec2d by = centre.across.at(miss_of(centre.segment.ray, corner).by);
  const Vec2d linear = centre.back.times({-by.x, -by.y});
  at = {at.x + linear.x, at.y + linear.y};
  for (int i = 0; i < kCornerSteps; ++i) {
    const std::optional<View> here = view(at, offset, centre.segment, corner, tracer);
    if (!here || !(length_of(here->step) <= length_of(linear))) break;
    at = {at.x + here->step.x, at.y + here->step.y};
    if (length_of(here->step) < kCloseToCorner) break;
  }
  return at;
}

/// Whether part of the spot may be in the frame or its margin.
bool Search::is_in_picture(const LightSpot& spot) const {
  const auto reaches_into = [&](double Vec2d::*axis, double size) {
    const auto [low, high] =
        std::minmax_element(spot.outline.begin(), spot.outline.end(),
                            [axis](const Vec2d& a, const Vec2d& b) { return a.*axis < b.*axis; });
    const double first = (*low).*axis;
    const double last = (*high).*axis;
    return first < size + search_.margin && last > -search_.margin;
  };
  return reaches_into(&Vec2d::x, search_.width) && reaches_into(&Vec2d::y, search_.height);
}

/// Newton's method from a start in the picture: finds the ray along the same way that meets the
/// centre of the light.
std::optional<LightSpot> Search::refine(Vec2d at, const SpecularSegment& like,
                                        const SearchedLight& light, SpecularTracer* tracer) const {
  double offset = step_ / 32;
  for (int i = 0; i < kMaxSteps; ++i) {
    const std::optional<View> here = view(at, offset, like, Target(light), tracer);
    if (!here) return std::nullopt;
    const Ellipse ellipse = ellipse_of(light, here->across, here->back);
    if (!(ellipse.area() > 0) || !std::isfinite(ellipse.area())) return std::nullopt;
    if (ellipse.square(here->step) < kCloseEnough) {
      LightSpot spot;
      spot.lobes = here->segment.lobes;
      spot.probability = here->segment.probability;
      spot.brightness =
          here->segment.throughput *
          (light.distant ? static_cast<float>(light.radiance) : here->segment.emitted);
      if (!std::isfinite(spot.brightness) || !reaches(here->segment, light, here->along))
        return std::nullopt;
      std::vector<Vec2d> corners;
      for (const Vec3d& corner : light.corners)
        corners.push_back(image_of(Target(corner), at, offset, *here, tracer));
      const auto is_finite = [](const Vec2d& v) {
        return std::isfinite(v.x) && std::isfinite(v.y);
      };
      if (!std::all_of(corners.begin(), corners.end(), is_finite)) return std::nullopt;
      spot.outline = corners.empty()
                         ? outline_of(ellipse, {at.x + here->step.x, at.y + here->step.y})
                         : convex_hull(std::move(corners));
      if (!(spot.area() > 0) || !std::isfinite(spot.area()) || !is_in_picture(spot))
        return std::nullopt;
      return spot;
    }
    const double far = length_of(here->step), most = 2 * step_;
    const double scale = far > most ? most / far : 1;
    at = {at.x + here->step.x * scale, at.y + here->step.y * scale};
    offset = clamp(std::sqrt(ellipse.area()) / 4, step_ / 1024, step_ / 8);
  }
  return std::nullopt;
}

/// Whether the centres are nearer than half the radius of a disk of the same area.
bool is_same(const LightSpot& a, const LightSpot& b) {
  const Vec2d from = centre_of(a.outline), to = centre_of(b.outline);
  const double x = to.x - from.x, y = to.y - from.y;
  return 4 * kPi * (x * x + y * y) < a.area();
}

/// Spots of the same light by the same way count once.
class Search::Collection {
 public:
  void add(const Found& found) {
    std::vector<LightSpot>& others = known_[found.key];
    const bool is_known = std::any_of(others.begin(), others.end(), [&](const LightSpot& other) {
      return is_same(other, found.spot);
    });
    if (is_known) return;
    others.push_back(found.spot);
    spots_.push_back(found.spot);
  }
  std::vector<LightSpot> take() { return std::move(spots_); }

 private:
  std::map<std::pair<std::size_t, std::uint64_t>, std::vector<LightSpot>> known_;
  std::vector<LightSpot> spots_;
};

/// Spots that the cells surround, in the order of the cells.
std::vector<Search::Found> Search::search_cells(const std::vector<Cell>& cells) const {
  constexpr std::int64_t kCellsPerPart = 64;
  const auto count = static_cast<std::int64_t>(cells.size());
  std::vector<std::vector<Found>> parts(
      static_cast<std::size_t>((count + kCellsPerPart - 1) / kCellsPerPart));
  parallel_for_(static_cast<std::int64_t>(parts.size()), [&](std::int64_t part) {
    const std::int64_t end = std::min((part + 1) * kCellsPerPart, count);
    for (std::int64_t i = part * kCellsPerPart; i < end; ++i)
      search_cell(cells[static_cast<std::size_t>(i)], &parts[static_cast<std::size_t>(part)]);
  });
  std::vector<Found> found;
  for (const std::vector<Found>& part : parts) found.insert(found.end(), part.begin(), part.end());
  return found;
}

/// Lights in the picture themselves, also with a centre outside the frame.
std::vector<Search::Found> Search::seen_directly() const {
  SpecularTracer specular = tracer();
  std::vector<Found> found;
  for (std::size_t i = 0; i < lights_.size(); ++i) {
    if (lights_[i].distant) continue;
    const std::optional<FilmPoint> start = search_.camera.project(lights_[i].centre);
    if (!start) continue;
    const std::optional<LightSpot> spot =
        refine({start->x, start->y}, SpecularSegment{}, lights_[i], &specular);
    if (spot) found.push_back({{i, 0}, *spot});
  }
  return found;
}

std::vector<LightSpot> Search::find() const {
  Collection collection;
  for (const Found& found : seen_directly()) collection.add(found);
  std::vector<Cell> cells = first_cells();
  for (int level = 0;; ++level) {
    for (const Found& found : search_cells(cells)) collection.add(found);
    if (level == kLevels) return collection.take();
    cells = divided(std::move(cells));
  }
}

}  // namespace

std::vector<LightSpot> find_spots(const SpotSearch& search, std::span<const SearchedLight> lights,
                                  const ParallelFor& parallel_for) {
  if (lights.empty()) return {};
  return Search(search, lights, parallel_for).find();
}

}  // namespace tessera::render
