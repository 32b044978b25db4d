#include "worker/guide/light_image.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <span>
#include <vector>

#include "worker/geometry/frame.h"
#include "worker/math/elementary.h"
#include "worker/sampling/warp.h"

namespace tessera::render {
namespace {

/// With fewer photons in one half, nothing is fitted.
constexpr std::size_t kMinInHalf = 4;
/// Steps of a fit, each of which counts photons that miss the image less than the step before.
constexpr int kSteps = 4;
/// Unknowns of an image that does not move, and of one that does (Fields).
constexpr int kFixed = 3, kMoving = 11;
/// Weight of the assumption that light is parallel, relative to that of all photons.
constexpr double kRidge = 1e-6;
/// Limits of View::spread; below, float directions are too coarse.
constexpr float kMinSpread = 1e-5f, kMaxSpread = 1;
/// Photons at grazing angles count as if they had this cosine.
constexpr float kMinCosine = 0.02f;

using Halves = std::array<std::vector<Photon>, 2>;

/// An image as it is seen from a place.
struct View {
  Vec3f direction{0, 0, 1};
  float length = 0;           // of the vector of LightImage
  float spread = kMaxSpread;  // half of the light is within 2 atan(spread) of the direction
};

View view_of(const LightImage& image, const Vec3f& place) {
  const Vec3f way =
      image.origin + image.along[0] * place.x + image.along[1] * place.y + image.along[2] * place.z;
  const float size = length(way);
  if (!(size > 0 && size < INFINITY)) return {};
  return {way / size, size, clamp(image.spread / size, kMinSpread, kMaxSpread)};
}

/// Square of the tangent of half the angle between unit directions, exact for small angles too.
float squared_half_tangent(const Vec3f& a, const Vec3f& b) {
  const Vec3f difference = a - b, sum = a + b;
  return dot(difference, difference) / std::max(dot(sum, sum), 1e-12f);
}

struct Weighted {
  double value, weight;
};

/// The least value up to which half of the weight is. Requires values.
double median_of(std::vector<Weighted> values) {
  std::sort(values.begin(), values.end(), [](const Weighted& a, const Weighted& b) {
    return a.value != b.value ? a.value < b.value : a.weight < b.weight;
  });
  double all = 0, below = 0;
  for (const Weighted& each : values) all += each.weight;
  for (const Weighted& each : values) {
    below += each.weight;
    if (below >= all / 2) return each.value;
  }
  return values.back().value;
}

/// Linear equations with a symmetric, positive definite matrix, of which `a` has the lower half.
template <int kSize>
struct Equations {
  double a[kSize][kSize] = {}, b[kSize] = {};

  /// Replaces `b` by the solution, by Cholesky's decomposition. False if the matrix is singular.
  bool solve() {
    double trace = 0;
    for (int i = 0; i < kSize; ++i) trace += a[i][i];
    for (int j = 0; j < kSize; ++j) {
      for (int k = 0; k < j; ++k) a[j][j] -= a[j][k] * a[j][k];
      constexpr double kSingular = 1e-13;
      if (!(a[j][j] > kSingular * trace)) return false;
      a[j][j] = std::sqrt(a[j][j]);
      for (int i = j + 1; i < kSize; ++i) {
        for (int k = 0; k < j; ++k) a[i][j] -= a[i][k] * a[j][k];
        a[i][j] /= a[j][j];
      }
    }
    for (int i = 0; i < kSize; ++i) {
      for (int k = 0; k < i; ++k) b[i] -= a[i][k] * b[k];
      b[i] /= a[i][i];
    }
    for (int i = kSize - 1; i >= 0; --i) {
      for (int k = i + 1; k < kSize; ++k) b[i] -= a[k][i] * b[k];
      b[i] /= a[i][i];
    }
    return true;
  }
};

/// The vector of LightImage as a sum, of which the first term is fixed and the others have unknown
/// factors: a shift across the mean direction, and either a movement as with the place itself or
/// any linear one.
class Fields {
 public:
  Fields(const Vec3d& direction, const Vec3d& centre, double extent)
      : centre_(centre), extent_(extent), frame_(Frame::from_normal(Vec3f(direction))) {}

  Vec3d fixed() const { return Vec3d(frame_.n); }
  /// Term `k` at a place.
  template <int kUnknowns>
  Vec3d term(int k, const Vec3d& place) const {
    if (k < 2) return Vec3d(k == 0 ? frame_.s : frame_.t);
    const Vec3d from_centre = (place - centre_) / extent_;
    if (kUnknowns == kFixed) return from_centre;
    Vec3d moved{0, 0, 0};
    moved[(k - 2) % 3] = from_centre[(k - 2) / 3];
    return moved;
  }

 private:
  Vec3d centre_;
  double extent_;
  Frame frame_;
};

/// Fits an image with a number of unknowns to photons. Requires photons.
template <int kUnknowns>
class ImageFit {
 public:
  explicit ImageFit(std::span<const Photon> photons)
      : photons_(photons), weights_(photons.size()), fields_(fields_of(photons)) {
    for (std::size_t i = 0; i < photons.size(); ++i) weights_[i] = double{photons[i].flux};
  }

  LightImage fit() {
    LightImage image;
    for (int step = 0; step < kSteps; ++step) {
      image = placed();
      std::vector<Weighted> misses;
      for (const Photon& photon : photons_) {
        const View view = view_of(image, photon.position);
        const float tangent = std::sqrt(squared_half_tangent(photon.direction, view.direction));
        misses.push_back({double{tangent * view.length}, double{photon.flux}});
      }
      constexpr double kLeast = 1e-30;
      const double spread = std::max(median_of(misses), kLeast);
      image.spread = static_cast<float>(spread);
      for (std::size_t i = 0; i < misses.size(); ++i) {
        const double ratio = misses[i].value / spread;
        weights_[i] = misses[i].weight / (1 + ratio * ratio);
      }
    }
    return image;
  }

 private:
  static Fields fields_of(std::span<const Photon> photons) {
    Vec3d centre{0, 0, 0}, direction{0, 0, 0};
    for (const Photon& photon : photons) {
      centre = centre + Vec3d(photon.position);
      direction = direction + Vec3d(photon.direction);
    }
    centre = centre / static_cast<double>(photons.size());
    double extent = 1e-30;
    for (const Photon& photon : photons)
      extent = std::max(extent, length(Vec3d(photon.position) - centre));
    const double size = length(direction);
    return {size > 0 ? direction / size : Vec3d{0, 0, 1}, centre, extent};
  }

  /// The image whose vectors across the photons' directions have the least weighted sum of squares,
  /// Σ w |(1 − ω ωᵀ) v|².
  LightImage placed() const {
    Equations<kUnknowns> equations;
    double all = 0;
    for (std::size_t i = 0; i < photons_.size(); ++i) {
      add(photons_[i], weights_[i], &equations);
      all += weights_[i];
    }
    for (int k = 2; k < kUnknowns; ++k) equations.a[k][k] += kRidge * all;
    const bool is_solved = equations.solve();
    const auto vector_at = [&](const Vec3d& place) {
      Vec3d sum = fields_.fixed();
      for (int k = 0; is_solved && k < kUnknowns; ++k)
        sum = sum + fields_.template term<kUnknowns>(k, place) * equations.b[k];
      return sum;
    };
    const Vec3d origin = vector_at({0, 0, 0});
    LightImage image;
    image.origin = Vec3f(origin);
    for (std::size_t k = 0; k < 3; ++k) {
      Vec3d axis{0, 0, 0};
      axis[static_cast<int>(k)] = 1;
      image.along[k] = Vec3f(vector_at(axis) - origin);
    }
    return image;
  }

  void add(const Photon& photon, double weight, Equations<kUnknowns>* equations) const {
    const auto direction = Vec3d(photon.direction);
    const auto across = [&](const Vec3d& v) { return v - direction * dot(direction, v); };
    const Vec3d fixed = across(fields_.fixed());
    std::array<Vec3d, kUnknowns> terms;
    for (int k = 0; k < kUnknowns; ++k) {
      const Vec3d term = across(fields_.template term<kUnknowns>(k, Vec3d(photon.position)));
      terms[static_cast<std::size_t>(k)] = term;
      equations->b[k] -= weight * dot(term, fixed);
      for (int j = 0; j <= k; ++j)
        equations->a[k][j] += weight * dot(term, terms[static_cast<std::size_t>(j)]);
    }
  }

  std::span<const Photon> photons_;
  std::vector<double> weights_;
  Fields fields_;
};

/// Fits to all photons; the gain is that with which each half predicts the other half.
template <int kUnknowns>
LightImageFit fit_with(std::span<const Photon> photons, const Halves& halves) {
  double log_gain = 0, flux = 0;
  for (const std::size_t half : {0u, 1u}) {
    const LightImage image = ImageFit<kUnknowns>(halves[half]).fit();
    for (const Photon& photon : halves[1 - half]) {
      const float cosine = std::max(dot(photon.direction, photon.normal), kMinCosine);
      const float density = image.pdf(photon.position, photon.direction);
      log_gain += double{photon.flux} * double{elementary::log(density / (cosine * warp::kInvPi))};
      flux += double{photon.flux};
    }
  }
  return {ImageFit<kUnknowns>(photons).fit(), elementary::exp(static_cast<float>(log_gain / flux))};
}

}  // namespace

Vec3f LightImage::sample(const Vec3f& place, const Vec2f& u) const {
  const View view = view_of(*this, place);
  // A point of the unit disk at radius r becomes an angle θ with tan²(θ/2) = spread² r² / (1 − r²).
  const Vec2f d = warp::disk(u);
  const float r2 = std::min(d.x * d.x + d.y * d.y, 1 - 0x1p-24f);
  const float rest = 1 - r2, drawn = view.spread * view.spread * r2;
  const float scale = 1 / (rest + drawn);
  const float sine = 2 * view.spread * std::sqrt(rest) * scale;  // divided by r
  return normalize(Frame::from_normal(view.direction)
                       .to_world({d.x * sine, d.y * sine, (rest - drawn) * scale}));
}

float LightImage::pdf(const Vec3f& place, const Vec3f& direction) const {
  const View view = view_of(*this, place);
  const float t = squared_half_tangent(direction, view.direction);
  const float narrow = view.spread * view.spread;
  const float ratio = (1 + t) / (narrow + t);
  return warp::kUniformSpherePdf * narrow * (ratio * ratio);
}

std::optional<LightImageFit> fit_light_image(std::span<const Photon> photons) {
  Halves halves;
  for (const Photon& photon : photons) halves[photon.in_second_half() ? 1 : 0].push_back(photon);
  if (std::min(halves[0].size(), halves[1].size()) < kMinInHalf) return std::nullopt;
  const LightImageFit fixed = fit_with<kFixed>(photons, halves);
  const LightImageFit moving = fit_with<kMoving>(photons, halves);
  return fixed.gain > moving.gain ? fixed : moving;
}

}  // namespace tessera::render
