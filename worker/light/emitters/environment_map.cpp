#include "worker/light/emitters/environment_map.h"

#include <algorithm>
#include <cmath>

#include "worker/math/elementary.h"

namespace tessera::render {
namespace {

constexpr double kPi = 3.14159265358979323846;

/// Cell of a CDF (count + 1 values from 0 to 1) that contains u, and the position inside it.
struct Cell {
  std::int32_t index;
  double inside;  // [0, 1)
};
Cell find_cell(const double* cdf, std::int32_t count, double u) {
  // The last cell whose lower edge is at most u, which skips empty cells.
  const double* upper = std::upper_bound(cdf, cdf + count, u);
  const auto i = static_cast<std::int32_t>(upper - cdf) - 1;
  const double low = cdf[i], width = cdf[i + 1] - low;
  return {i, width > 0 ? (u - low) / width : 0.5};
}

/// Maps u to an offset in (-1, 1) with the tent density 1 - |x|.
double tent(double u) {
  return u < 0.5 ? std::sqrt(2 * u) - 1 : 1 - std::sqrt(2 * (1 - u));
}

}  // namespace

EnvironmentMap::EnvironmentMap(const Scene& scene)
    : constant_(scene.environment.constant), strength_(scene.environment.strength) {
  if (scene.environment.image == kNone) return;
  image_ = &scene.images[static_cast<std::size_t>(scene.environment.image)];
  width_ = image_->width;
  height_ = image_->height;
  const double turns = scene.environment.rotation_degrees / 360;
  turn_ = turns - std::floor(turns);
  build();
}

Vec3f EnvironmentMap::fetch(std::int32_t x, std::int32_t y) const {
  if (x < 0) x += width_;
  if (x >= width_) x -= width_;
  y = clamp(y, std::int32_t{0}, height_ - 1);
  const auto n = static_cast<std::size_t>(image_->channels);
  const float* p = &image_->f32[(static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                                 static_cast<std::size_t>(x)) *
                                n];
  const Vec3f c = n >= 3 ? Vec3f{p[0], p[1], p[2]} : Vec3f{p[0], p[0], p[0]};
  return max(c, Vec3f{0, 0, 0});
}

EnvironmentMap::Lookup EnvironmentMap::look_up(const Vec3f& d) const {
  if (image_ == nullptr) return {constant_ * strength_, 0};
  const double dx = d.x, dy = d.y, dz = d.z;
  double u = 0.5 + elementary::atan2(dz, dx) / (2 * kPi) + turn_;
  u -= std::floor(u);
  const double sine = std::sqrt(dx * dx + dz * dz);
  const double v = elementary::atan2(sine, dy) / kPi;
  const double x = u * width_ - 0.5, y = v * height_ - 0.5;
  const double left = std::floor(x), top = std::floor(y);
  const auto i = static_cast<std::int32_t>(clamp(left, -1.0, width_ - 1.0));
  const auto j = static_cast<std::int32_t>(clamp(top, -1.0, height_ - 1.0));
  const auto fx = static_cast<float>(x - left), fy = static_cast<float>(y - top);
  const Vec3f a = fetch(i, j), b = fetch(i + 1, j), c = fetch(i, j + 1), e = fetch(i + 1, j + 1);
  const float density =
      lerp(lerp(excess(a), excess(b), fx) * row_sines_[static_cast<std::size_t>(j < 0 ? 0 : j)],
           lerp(excess(c), excess(e), fx) *
               row_sines_[static_cast<std::size_t>(j + 1 < height_ ? j + 1 : height_ - 1)],
           fy);
  const auto spread = static_cast<float>(sine > 1e-18 ? sine : 1e-18);  // avoids 0 / 0
  return {lerp(lerp(a, b, fx), lerp(c, e, fx), fy) * strength_, density * density_scale_ / spread};
}

void EnvironmentMap::build() {
  const auto w = static_cast<std::size_t>(width_), h = static_cast<std::size_t>(height_);
  row_sines_.resize(h);
  std::vector<double> heights(h);  // of the rows on the axis of the sphere, which gives their area
  for (std::int32_t j = 0; j < height_; ++j) {
    const double above = elementary::cos(kPi * j / height_);
    const double below = elementary::cos(kPi * (j + 1) / height_);
    row_sines_[static_cast<std::size_t>(j)] =
        static_cast<float>(elementary::sin(kPi * (j + 0.5) / height_));
    double row = 0;
    for (std::int32_t i = 0; i < width_; ++i) row += luminance(fetch(i, j));
    power_ += row * (above - below) * 2 * kPi / width_;
    heights[static_cast<std::size_t>(j)] = above - below;
  }
  // Slightly increased, so that rounding gives uniform maps no texel above the mean.
  mean_ = static_cast<float>(power_ / (4 * kPi) * (1 + 0x1p-16));
  row_cdf_.assign(h + 1, 0);
  cdf_.assign(h * (w + 1), 0);
  for (std::size_t j = 0; j < h; ++j) {
    double* cdf = &cdf_[j * (w + 1)];
    for (std::size_t i = 0; i < w; ++i) {
      const Vec3f c = fetch(static_cast<std::int32_t>(i), static_cast<std::int32_t>(j));
      cdf[i + 1] = cdf[i] + static_cast<double>(excess(c));
    }
    const double row = cdf[w];
    excess_power_ += row * heights[j] * 2 * kPi / width_;
    row_cdf_[j + 1] = row_cdf_[j] + row * static_cast<double>(row_sines_[j]);
    for (std::size_t i = 1; i <= w; ++i) {
      cdf[i] = row > 0 ? cdf[i] / row : static_cast<double>(i) / width_;
    }
    cdf[w] = 1;
  }
  total_ = row_cdf_[h];
  if (!(total_ > 0) || !std::isfinite(total_)) {
    total_ = 0;
    return;
  }
  for (double& c : row_cdf_) c /= total_;
  row_cdf_[h] = 1;
  density_scale_ =
      static_cast<float>(static_cast<double>(width_) * height_ / (2 * kPi * kPi) / total_);
}

/// Unit direction to a point of the map, in texels.
Vec3d EnvironmentMap::towards(double x, double y) const {
  const double theta = kPi * y / height_, phi = 2 * kPi * (x / width_ - 0.5 - turn_);
  const elementary::SinCosd t = elementary::sincos(theta), p = elementary::sincos(phi);
  return {t.sin * p.cos, t.cos, t.sin * p.sin};
}

EnvironmentMap::Sample EnvironmentMap::sample(double u1, double u2) const {
  const Cell row = find_cell(row_cdf_.data(), height_, u1);
  const auto j = static_cast<std::size_t>(row.index), w = static_cast<std::size_t>(width_);
  const Cell column = find_cell(&cdf_[j * (w + 1)], width_, u2);
  double y = row.index + 0.5 + tent(row.inside);
  // Beyond the centres of the first and last row, lookups clamp to them, so half of their tent
  // is flat, uniform over half a texel.
  if (row.index == 0 && row.inside < 0.5) y = row.inside;
  if (row.index == height_ - 1 && row.inside >= 0.5) y = height_ - 1 + row.inside;
  const double x = column.index + 0.5 + tent(column.inside);
  Sample s;
  s.direction = normalize(Vec3f(towards(x, y)));
  // Looked up in the rounded direction, as BSDF sampling does.
  const Lookup found = look_up(s.direction);
  s.radiance = found.radiance;
  s.pdf = found.pdf;
  return s;
}

Vec3f EnvironmentMap::unsampled(const Vec3f& radiance) const {
  const float whole = luminance(radiance), limit = mean_ * strength_;
  return whole > limit ? radiance * (limit / whole) : radiance;
}

std::optional<EnvironmentMap::Sun> EnvironmentMap::sun() const {
  constexpr std::int32_t kReach = 8;             // texels, from the brightest one
  constexpr float kLeast = 64, kPart = 1 / 8.f;  // relative to the mean, and to the brightest
  if (is_constant()) return std::nullopt;
  std::int32_t column = 0, row = 0;
  float most = 0;
  for (std::int32_t j = 0; j < height_; ++j) {
    for (std::int32_t i = 0; i < width_; ++i) {
      const float here = luminance(fetch(i, j));
      if (here <= most) continue;
      most = here;
      column = i;
      row = j;
    }
  }
  if (!(most > kLeast * mean_) || width_ < 8 * kReach || height_ < 4 * kReach) return std::nullopt;
  Sun sun;
  Vec3d moment;
  std::array<Vec3d, 3> second{};
  double weights = 0, area = 0;
  for (std::int32_t j = std::max(row - kReach, 0); j <= std::min(row + kReach, height_ - 1); ++j) {
    for (std::int32_t i = column - kReach; i <= column + kReach; ++i) {
      const float here = luminance(fetch(i, j));
      if (here < most * kPart) continue;
      if (std::abs(i - column) == kReach || std::abs(j - row) == kReach) return std::nullopt;
      const double texel{row_sines_[static_cast<std::size_t>(j)]};
      const double weight = double{here} * texel;
      const Vec3d d = towards(i + 0.5, j + 0.5);
      weights += weight;
      area += texel;
      moment += d * weight;
      for (int k = 0; k < 3; ++k) second[static_cast<std::size_t>(k)] += d * (d[k] * weight);
    }
  }
  // A texel spreads as a tent, whose variance is a sixth.
  const double step = kPi / height_;
  const Vec3d mean = moment / weights;
  for (int k = 0; k < 3; ++k) {
    Vec3d& of = sun.covariance[static_cast<std::size_t>(k)];
    of = second[static_cast<std::size_t>(k)] / weights - mean * mean[k];
    of[k] += step * step / 6;
  }
  sun.towards = mean / length(mean);
  sun.radius = std::sqrt(area / kPi) * step;
  sun.radiance = weights / area * static_cast<double>(strength_);
  return sun;
}

double EnvironmentMap::power() const {
  if (image_ == nullptr) return 4 * kPi * luminance(constant_ * strength_);
  return power_ * strength_;
}

std::int64_t EnvironmentMap::memory_bytes() const {
  return static_cast<std::int64_t>((row_cdf_.size() + cdf_.size()) * sizeof(double) +
                                   row_sines_.size() * sizeof(float));
}

}  // namespace tessera::render
