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
/// Limits of what is a spot: its area, in areas of the pixel filter, and the chance that a sample
/// of a pixel in it finds it.
constexpr double kMaxArea = 256, kMaxChance = 0.25;
/// Radius of a spot in standard deviations of the light's points: the corners of a square are at
/// this distance.
constexpr double kRadius = 2.4494897427831781;
constexpr int kMaxSteps = 12;
/// Newton's method ends at this squared distance from the centre, relative to the ellipse.
constexpr double kCloseEnough = 0.01;
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

/// How far a ray passes the centre of a light.
struct Miss {
  Vec3d by;          // from the ray's closest point to the light
  double along = 0;  // distance to that point; of a distant light a cosine
};

Miss miss_of(const Ray& ray, const SmallLight& light) {
  const Vec3d direction(ray.direction);
  const Vec3d to = light.distant ? light.centre : light.centre - Vec3d(ray.origin);
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
  Search(const SpotSearch& search, std::span<const SmallLight> lights,
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
  std::vector<Cell> first_cells() const;
  std::vector<Cell> divided(std::vector<Cell> cells) const;
  class Collection;
  std::vector<Found> search_cells(const std::vector<Cell>& cells) const;
  void search_cell(const Cell& cell, std::vector<Found>* found) const;
  void search_triangle(const std::array<const Probe*, 3>& corners, int level,
                       SpecularTracer* tracer, std::vector<Found>* found) const;
  struct View;
  std::optional<View> view(const Vec2d& at, double offset, const SpecularSegment& like,
                           const SmallLight& light, SpecularTracer* tracer) const;
  bool is_rare(const LightSpot& spot) const;
  std::optional<LightSpot> refine(Vec2d at, const SpecularSegment& like, const SmallLight& light,
                                  SpecularTracer* tracer) const;
  SpecularTracer tracer() const { return {search_.shading, search_.accel, search_.max_depth}; }

  const SpotSearch& search_;
  std::span<const SmallLight> lights_;
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
                                 const std::array<Vec2d, 3>& points, const SmallLight& light) {
  const Across plane(rays[0]->ray.direction);
  std::array<Vec2d, 3> misses;
  for (std::size_t k = 0; k < 3; ++k) {
    const Miss miss = miss_of(rays[k]->ray, light);
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
    if (level > 0 && first.surfaces == 0) continue;
    const SpecularSegment* second = with_way(corners[1]->segments, first.way);
    const SpecularSegment* third = with_way(corners[2]->segments, first.way);
    if (second == nullptr || third == nullptr) continue;
    for (std::size_t i = 0; i < lights_.size(); ++i) {
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
double covariance(const SmallLight& light, const Vec3d& p, const Vec3d& q) {
  return dot(p, Vec3d{dot(light.covariance[0], q), dot(light.covariance[1], q),
                      dot(light.covariance[2], q)});
}

/// Sets the ellipse that the light's points cover in the picture. `back` maps the plane `across`
/// the ray to the picture.
void set_ellipse(const SmallLight& light, const Across& across, const Matrix2& back,
                 LightSpot* spot) {
  const Vec3d x = across.u * back.xx + across.v * back.xy;
  const Vec3d y = across.u * back.yx + across.v * back.yy;
  double xx = covariance(light, x, x), yy = covariance(light, y, y);
  const double xy = covariance(light, x, y);
  const double least = (xx + yy) * 1e-4;  // of a light that is seen edge-on
  xx += least;
  yy += least;
  spot->a = kRadius * std::sqrt(xx);
  spot->b = kRadius * xy / std::sqrt(xx);
  spot->c = kRadius * std::sqrt(std::max(yy - xy * xy / xx, 0.0));
}

/// Whether the segment ends at the light, which it meets after `along` metres.
bool reaches(const SpecularSegment& segment, const SmallLight& light, double along) {
  if (light.distant) return !std::isfinite(segment.ray.t_max);
  const double beside = std::fabs(double{segment.ray.t_max} - along);
  return segment.emitted > 0 && beside <= 1.1 * light.radius + 1e-3 * along;
}

/// The image of a light, estimated from three rays near a point of the picture.
struct Search::View {
  SpecularSegment segment;  // of the ray through the point
  double along = 0;         // to the light
  Vec2d step;               // from the point to the image's centre, if the picture were linear
  LightSpot spot;           // its ellipse
};

/// Differences of rays `offset` pixels apart are the derivatives.
std::optional<Search::View> Search::view(const Vec2d& at, double offset,
                                         const SpecularSegment& like, const SmallLight& light,
                                         SpecularTracer* tracer) const {
  std::array<std::optional<SpecularSegment>, 3> rays;
  const std::array<Vec2d, 3> points = {at, {at.x + offset, at.y}, {at.x, at.y + offset}};
  for (std::size_t k = 0; k < 3; ++k) {
    const std::optional<Ray> camera_ray = ray(points[k]);
    if (camera_ray) rays[k] = tracer->follow(*camera_ray, like);
    if (!rays[k]) return std::nullopt;
  }
  const Across across(rays[0]->ray.direction);
  const Miss miss = miss_of(rays[0]->ray, light);
  if (!(miss.along > 0)) return std::nullopt;
  const Vec2d by = across.at(miss.by);
  const Vec2d right = across.at(miss_of(rays[1]->ray, light).by);
  const Vec2d down = across.at(miss_of(rays[2]->ray, light).by);
  const Matrix2 slope{(right.x - by.x) / offset, (down.x - by.x) / offset,
                      (right.y - by.y) / offset, (down.y - by.y) / offset};
  if (slope.determinant() == 0) return std::nullopt;
  const Matrix2 back = slope.inverse();
  View view{*rays[0], miss.along, back.times({-by.x, -by.y}), {}};
  set_ellipse(light, across, back, &view.spot);
  if (!(view.spot.area() > 0) || !std::isfinite(view.spot.area())) return std::nullopt;
  return view;
}

/// Whether so few samples find the image that it counts.
bool Search::is_rare(const LightSpot& spot) const {
  const double parts = spot.area() / search_.pixel_area;
  return parts <= kMaxArea && std::min(parts, 1.0) * double{spot.probability} <= kMaxChance;
}

/// Newton's method from a start in the picture: finds the ray along the same way that meets the
/// centre of the light.
std::optional<LightSpot> Search::refine(Vec2d at, const SpecularSegment& like,
                                        const SmallLight& light, SpecularTracer* tracer) const {
  double offset = step_ / 32;
  for (int i = 0; i < kMaxSteps; ++i) {
    const std::optional<View> here = view(at, offset, like, light, tracer);
    if (!here) return std::nullopt;
    LightSpot spot = here->spot;
    const double qx = here->step.x / spot.a, qy = (here->step.y - spot.b * qx) / spot.c;
    if (qx * qx + qy * qy < kCloseEnough) {
      spot.x = at.x + here->step.x;
      spot.y = at.y + here->step.y;
      spot.lobes = here->segment.lobes;
      spot.probability = here->segment.probability;
      spot.brightness =
          here->segment.throughput *
          (light.distant ? static_cast<float>(light.radiance) : here->segment.emitted);
      if (!std::isfinite(spot.brightness) || !is_rare(spot) ||
          !reaches(here->segment, light, here->along))
        return std::nullopt;
      return spot;
    }
    const double far = length_of(here->step), most = 2 * step_;
    const double scale = far > most ? most / far : 1;
    at = {at.x + here->step.x * scale, at.y + here->step.y * scale};
    offset = clamp(std::sqrt(spot.area()) / 4, step_ / 1024, step_ / 8);
  }
  return std::nullopt;
}

bool is_same(const LightSpot& a, const LightSpot& b) {
  const double qx = (b.x - a.x) / a.a, qy = (b.y - a.y - a.b * qx) / a.c;
  return qx * qx + qy * qy < 0.25;
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

std::vector<LightSpot> Search::find() const {
  Collection collection;
  std::vector<Cell> cells = first_cells();
  for (int level = 0;; ++level) {
    for (const Found& found : search_cells(cells)) collection.add(found);
    if (level == kLevels) return collection.take();
    cells = divided(std::move(cells));
  }
}

}  // namespace

double LightSpot::area() const {
  return kPi * a * c;
}

std::vector<LightSpot> find_spots(const SpotSearch& search, std::span<const SmallLight> lights,
                                  const ParallelFor& parallel_for) {
  if (lights.empty()) return {};
  return Search(search, lights, parallel_for).find();
}

}  // namespace tessera::render
