#include "worker/light/environment_map.h"

#include <algorithm>
#include <cmath>

#include "worker/math/elementary.h"

namespace tessera::render {
namespace {

constexpr double kPi = 3.14159265358979323846;

/// Index of the cell of a rising cdf (count + 1 values from 0 to 1) that holds u, and where in it.
struct Cell {
  std::int32_t index;
  double inside;  // [0, 1)
};
Cell find_cell(const double* cdf, std::int32_t count, double u) {
  // The last cell whose lower edge is at or below u; empty cells are stepped over.
  const double* upper = std::upper_bound(cdf, cdf + count, u);
  const auto i = static_cast<std::int32_t>(upper - cdf) - 1;
  const double low = cdf[i], width = cdf[i + 1] - low;
  return {i, width > 0 ? (u - low) / width : 0.5};
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

EnvironmentMap::Texel EnvironmentMap::texel_at(const Vec3f& d) const {
  const double x = d.x, y = d.y, z = d.z;
  double u = 0.5 + elementary::atan2(z, x) / (2 * kPi) + turn_;
  u -= std::floor(u);
  const double v = elementary::atan2(std::sqrt(x * x + z * z), y) / kPi;
  return {u * width_, v * height_};
}

Vec3f EnvironmentMap::bilinear(double x, double y) const {
  const double left = std::floor(x - 0.5), top = std::floor(y - 0.5);
  const auto i = static_cast<std::int32_t>(clamp(left, -1.0, width_ - 1.0));
  const auto j = static_cast<std::int32_t>(clamp(top, -1.0, height_ - 1.0));
  const auto fx = static_cast<float>(x - 0.5 - left), fy = static_cast<float>(y - 0.5 - top);
  const Vec3f upper = lerp(fetch(i, j), fetch(i + 1, j), fx);
  const Vec3f lower = lerp(fetch(i, j + 1), fetch(i + 1, j + 1), fx);
  return lerp(upper, lower, fy) * strength_;
}

Vec3f EnvironmentMap::radiance(const Vec3f& d) const {
  if (image_ == nullptr) return constant_ * strength_;
  const Texel t = texel_at(d);
  return bilinear(t.x, t.y);
}

void EnvironmentMap::build() {
  const auto w = static_cast<std::size_t>(width_), h = static_cast<std::size_t>(height_);
  row_cosines_.resize(h + 1);
  for (std::size_t j = 0; j <= h; ++j)
    row_cosines_[j] = elementary::cos(kPi * static_cast<double>(j) / height_);
  row_cosines_[0] = 1;
  row_cosines_[h] = -1;
  row_cdf_.assign(h + 1, 0);
  cdf_.assign(h * (w + 1), 0);
  density_.assign(h * w, 0);
  // The integral of the bilinear filter over a texel's square takes 1/8, 3/4, 1/8 of three
  // neighbours each way: positive exactly where some lookup inside is.
  std::vector<double> luminances((h + 2) * w);  // one row more at each end, as the lookup clamps
  for (std::size_t j = 0; j < h + 2; ++j) {
    for (std::size_t i = 0; i < w; ++i) {
      const Vec3d c(fetch(static_cast<std::int32_t>(i), static_cast<std::int32_t>(j) - 1));
      luminances[j * w + i] = 0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z;
    }
  }
  std::vector<double> columns(w);
  for (std::size_t j = 0; j < h; ++j) {
    const double* above = &luminances[j * w];
    for (std::size_t i = 0; i < w; ++i) {
      columns[i] = 0.125 * (above[i] + above[i + 2 * w]) + 0.75 * above[i + w];
    }
    double* cdf = &cdf_[j * (w + 1)];
    for (std::size_t i = 0; i < w; ++i) {
      const double value =
          0.125 * (columns[i == 0 ? w - 1 : i - 1] + columns[i + 1 == w ? 0 : i + 1]) +
          0.75 * columns[i];
      cdf[i + 1] = cdf[i] + value;
      density_[j * w + i] = static_cast<float>(value);
    }
    const double texel_angle = (row_cosines_[j] - row_cosines_[j + 1]) * 2 * kPi / width_;
    const double row = cdf[w];
    row_cdf_[j + 1] = row_cdf_[j] + row * texel_angle;
    for (std::size_t i = 1; i <= w; ++i)
      cdf[i] = row > 0 ? cdf[i] / row : static_cast<double>(i) / width_;
    cdf[w] = 1;
  }
  total_ = row_cdf_[h];
  if (!(total_ > 0) || !std::isfinite(total_)) {
    total_ = 0;
    return;
  }
  for (double& c : row_cdf_) c /= total_;
  row_cdf_[h] = 1;
  for (float& d : density_) d = static_cast<float>(d / total_);
}

EnvironmentMap::Sample EnvironmentMap::sample(double u1, double u2) const {
  const Cell row = find_cell(row_cdf_.data(), height_, u1);
  const auto j = static_cast<std::size_t>(row.index), w = static_cast<std::size_t>(width_);
  const Cell column = find_cell(&cdf_[j * (w + 1)], width_, u2);
  // Uniform in solid angle inside the texel, so the density is constant there.
  const double cosine = row_cosines_[j] + row.inside * (row_cosines_[j + 1] - row_cosines_[j]);
  const double sine2 = (1 - cosine) * (1 + cosine);
  const double sine = sine2 > 0 ? std::sqrt(sine2) : 0;
  const double x = column.index + column.inside;
  const double phi = 2 * kPi * (x / width_ - 0.5 - turn_);
  Sample s;
  s.direction = Vec3f(Vec3d{sine * elementary::cos(phi), cosine, sine * elementary::sin(phi)});
  s.direction = normalize(s.direction);
  // Looked up through the rounded direction, as a path that finds the sky by chance would.
  s.radiance = radiance(s.direction);
  s.pdf = density_[j * w + static_cast<std::size_t>(column.index)];
  return s;
}

float EnvironmentMap::pdf(const Vec3f& d) const {
  const Texel t = texel_at(d);
  const auto i = static_cast<std::int32_t>(clamp(t.x, 0.0, width_ - 1.0));
  const auto j = static_cast<std::int32_t>(clamp(t.y, 0.0, height_ - 1.0));
  return density_[static_cast<std::size_t>(j) * static_cast<std::size_t>(width_) +
                  static_cast<std::size_t>(i)];
}

double EnvironmentMap::power() const {
  if (image_ == nullptr) return 4 * kPi * luminance(constant_ * strength_);
  return total_ * strength_;
}

std::int64_t EnvironmentMap::memory_bytes() const {
  return static_cast<std::int64_t>((row_cosines_.size() + row_cdf_.size() + cdf_.size()) *
                                       sizeof(double) +
                                   density_.size() * sizeof(float));
}

}  // namespace tessera::render
