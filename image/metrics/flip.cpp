#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "image/metrics/image_metrics.h"

// LDR-FLIP, implemented from the paper. Filters are separable passes in double; borders repeat
// the outermost pixel.

namespace tessera::contract {
namespace {

constexpr double kPi = 3.14159265358979323846;
using Color = std::array<double, 3>;

// Table 1 of the paper.
constexpr double kColorExponent = 0.7, kFeatureExponent = 0.5;
constexpr double kColorKnee = 0.4, kColorKneeValue = 0.95;
constexpr double kFeatureWidthDegrees = 0.082;

/// One plane of an image.
struct Plane {
  std::int32_t width, height;
  std::vector<double> values;

  Plane(std::int32_t w, std::int32_t h)
      : width(w), height(h), values(static_cast<std::size_t>(w) * static_cast<std::size_t>(h)) {}
};

/// Symmetric support: taps for offsets −radius … radius.
using Kernel = std::vector<double>;

/// Filters one value of a line of pixels. `line` points to its first pixel, pixels are `step`
/// apart.
double filtered_at(const double* line, std::int32_t length, std::int64_t step, std::int32_t i,
                   const Kernel& kernel) {
  const auto radius = static_cast<std::int32_t>(kernel.size() / 2);
  double sum = 0;
  std::int32_t at = i - radius;
  for (const double tap : kernel) sum += tap * line[std::clamp(at++, 0, length - 1) * step];
  return sum;
}

Plane filtered(const Plane& in, const Kernel& along_x, const Kernel& along_y) {
  Plane rows(in.width, in.height), out(in.width, in.height);
  const std::int64_t width = in.width;
  for (std::int32_t y = 0; y < in.height; ++y) {
    const double* from = in.values.data() + y * width;
    double* to = rows.values.data() + y * width;
    for (std::int32_t x = 0; x < in.width; ++x) {
      to[x] = filtered_at(from, in.width, 1, x, along_x);
    }
  }
  for (std::int32_t y = 0; y < in.height; ++y) {
    double* to = out.values.data() + y * width;
    for (std::int32_t x = 0; x < in.width; ++x) {
      to[x] = filtered_at(rows.values.data() + x, in.height, width, y, along_y);
    }
  }
  return out;
}

// Colour spaces: linear Rec. 709 and D65 white, which is RGB (1, 1, 1).

Color xyz_of(const Color& rgb) {
  return {0.41238656 * rgb[0] + 0.35759149 * rgb[1] + 0.18045049 * rgb[2],
          0.21263682 * rgb[0] + 0.71518298 * rgb[1] + 0.07218020 * rgb[2],
          0.01933062 * rgb[0] + 0.11919716 * rgb[1] + 0.95037259 * rgb[2]};
}

Color white() {
  return xyz_of({1, 1, 1});
}

/// Inverse of xyz_of(), by Cramer's rule on its columns.
Color rgb_of(const Color& xyz) {
  const Color r = xyz_of({1, 0, 0}), g = xyz_of({0, 1, 0}), b = xyz_of({0, 0, 1});
  const auto det = [](const Color& u, const Color& v, const Color& w) {
    return u[0] * (v[1] * w[2] - v[2] * w[1]) - u[1] * (v[0] * w[2] - v[2] * w[0]) +
           u[2] * (v[0] * w[1] - v[1] * w[0]);
  };
  const double whole = det(r, g, b);
  return {det(xyz, g, b) / whole, det(r, xyz, b) / whole, det(r, g, xyz) / whole};
}

Color ycxcz_of(const Color& rgb) {
  const Color xyz = xyz_of(rgb), w = white();
  const double x = xyz[0] / w[0], y = xyz[1] / w[1], z = xyz[2] / w[2];
  return {116 * y - 16, 500 * (x - y), 200 * (y - z)};
}

Color rgb_of_ycxcz(const Color& c) {
  const Color w = white();
  const double y = (c[0] + 16) / 116;
  return rgb_of({(y + c[1] / 500) * w[0], y * w[1], (y - c[2] / 200) * w[2]});
}

/// CIELab with the Hunt effect: colourfulness shrinks with lightness.
Color hunt_lab_of(const Color& rgb) {
  const Color xyz = xyz_of(rgb), w = white();
  const auto f = [](double t) {
    constexpr double kDelta = 6.0 / 29;
    return t > kDelta * kDelta * kDelta ? std::cbrt(t) : t / (3 * kDelta * kDelta) + 4.0 / 29;
  };
  const double fx = f(xyz[0] / w[0]), fy = f(xyz[1] / w[1]), fz = f(xyz[2] / w[2]);
  const double lightness = 116 * fy - 16;
  return {lightness, 0.01 * lightness * 500 * (fx - fy), 0.01 * lightness * 200 * (fy - fz)};
}

double hyab(const Color& a, const Color& b) {
  return std::fabs(a[0] - b[0]) + std::hypot(a[1] - b[1], a[2] - b[2]);
}

/// Maximum distance, between green and blue, raised to the exponent of all distances.
double largest_color_distance() {
  return std::pow(hyab(hunt_lab_of({0, 1, 0}), hunt_lab_of({0, 0, 1})), kColorExponent);
}

/// Maps distances up to the knee to most of [0, 1] and compresses the rest.
double color_difference(const Color& a, const Color& b, double largest) {
  const double distance = std::pow(hyab(a, b), kColorExponent), knee = kColorKnee * largest;
  if (distance < knee) return kColorKneeValue / knee * distance;
  return kColorKneeValue + (distance - knee) / (largest - knee) * (1 - kColorKneeValue);
}

// Contrast sensitivity: a sum of Gaussians a √(π/b) exp(−π² d²/b), d in degrees.

struct Gaussian {
  double a, b;
};

/// Radius of the widest filter, b = 0.04, at three standard deviations, pixels.
std::int32_t color_radius() {
  return static_cast<std::int32_t>(
      std::ceil(3 * std::sqrt(0.04 / (2 * kPi * kPi)) * kFlipPixelsPerDegree));
}

/// `plane` filtered by the normalised sum of the Gaussians; each is separable, their sum is not.
Plane sensitivity_filtered(const Plane& plane, std::initializer_list<Gaussian> gaussians) {
  const std::int32_t radius = color_radius();
  Plane out(plane.width, plane.height);
  double whole = 0;
  for (const Gaussian& gaussian : gaussians) {
    Kernel kernel;
    double sum = 0;
    for (std::int32_t k = -radius; k <= radius; ++k) {
      const double degrees = k / kFlipPixelsPerDegree;
      kernel.push_back(std::exp(-kPi * kPi * degrees * degrees / gaussian.b));
      sum += kernel.back();
    }
    const double amplitude = gaussian.a * std::sqrt(kPi / gaussian.b);
    whole += amplitude * sum * sum;
    const Plane part = filtered(plane, kernel, kernel);
    for (std::size_t i = 0; i < out.values.size(); ++i) {
      out.values[i] += amplitude * part.values[i];
    }
  }
  for (double& value : out.values) value /= whole;
  return out;
}

/// An image prepared for both parts of the metric.
struct Prepared {
  Plane luma;              // Y of YCxCz, [0, 1]
  std::vector<Color> lab;  // filtered, Hunt-adjusted Lab
};

Prepared prepare(const ImageView& image) {
  Plane y(image.width, image.height), cx = y, cz = y, luma = y;
  for (std::size_t i = 0; i < y.values.size(); ++i) {
    Color rgb;
    for (std::size_t c = 0; c < 3; ++c) {
      rgb[c] = std::clamp(double{image.rgba[4 * i + c]}, 0.0, 1.0);
    }
    const Color opponent = ycxcz_of(rgb);
    y.values[i] = opponent[0];
    cx.values[i] = opponent[1];
    cz.values[i] = opponent[2];
    luma.values[i] = (opponent[0] + 16) / 116;
  }
  y = sensitivity_filtered(y, {{1, 0.0047}});
  cx = sensitivity_filtered(cx, {{1, 0.0053}});
  cz = sensitivity_filtered(cz, {{34.1, 0.04}, {13.5, 0.025}});
  std::vector<Color> lab(y.values.size());
  for (std::size_t i = 0; i < lab.size(); ++i) {
    Color rgb = rgb_of_ycxcz({y.values[i], cx.values[i], cz.values[i]});
    for (double& value : rgb) value = std::clamp(value, 0.0, 1.0);
    lab[i] = hunt_lab_of(rgb);
  }
  return {std::move(luma), std::move(lab)};
}

/// Positive taps sum to 1 and negative ones to −1, so that a step or line gives at most 1.
void balance(Kernel& kernel) {
  double positive = 0, negative = 0;
  for (const double tap : kernel) (tap > 0 ? positive : negative) += std::fabs(tap);
  for (double& tap : kernel) tap /= tap > 0 ? positive : negative;
}

/// Magnitudes of edges (first derivative) and points (second derivative) in the luma.
struct Features {
  std::vector<double> edges, points;
};

Features features_of(const Plane& luma) {
  const double sigma = 0.5 * kFeatureWidthDegrees * kFlipPixelsPerDegree;
  const auto radius = static_cast<std::int32_t>(std::ceil(3 * sigma));
  Kernel smooth, first, second;
  double sum = 0;
  for (std::int32_t k = -radius; k <= radius; ++k) {
    const double g = std::exp(-k * k / (2 * sigma * sigma));
    smooth.push_back(g);
    first.push_back(-k * g);
    second.push_back((k * k / (sigma * sigma) - 1) * g);
    sum += g;
  }
  for (double& tap : smooth) tap /= sum;
  balance(first);
  balance(second);
  const auto magnitude = [&](const Kernel& derivative) {
    const Plane x = filtered(luma, derivative, smooth), y = filtered(luma, smooth, derivative);
    std::vector<double> values(x.values.size());
    for (std::size_t i = 0; i < values.size(); ++i) {
      values[i] = std::hypot(x.values[i], y.values[i]);
    }
    return values;
  };
  return {magnitude(first), magnitude(second)};
}

}  // namespace

double mean_flip(const ImageView& image, const ImageView& reference) {
  const Prepared a = prepare(image), b = prepare(reference);
  const Features fa = features_of(a.luma), fb = features_of(b.luma);
  const double largest = largest_color_distance();
  double sum = 0;
  for (std::size_t i = 0; i < a.lab.size(); ++i) {
    const double color = color_difference(a.lab[i], b.lab[i], largest);
    const double feature =
        std::max(std::fabs(fa.edges[i] - fb.edges[i]), std::fabs(fa.points[i] - fb.points[i])) /
        std::sqrt(2.0);
    const double exponent = 1 - std::pow(std::clamp(feature, 0.0, 1.0), kFeatureExponent);
    sum += color > 0 ? std::pow(color, exponent) : 0;
  }
  return sum / static_cast<double>(a.lab.size());
}

}  // namespace tessera::contract
