#include "worker/guide/cell_fit.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "worker/guide/octahedral.h"
#include "worker/guide/recentred.h"
#include "worker/math/elementary.h"
#include "worker/sampling/warp.h"

namespace tessera::render {
namespace {

/// Cells with fewer photons are not guided, nor those with fewer than a quarter of it in one half.
constexpr std::ptrdiff_t kMinPhotons = 32;
/// Part of the box's longest side by which it is larger than the photons' own.
constexpr float kMargin = 1.0f / 16;
/// Radii that are tried, as multiples of half the box's diagonal.
constexpr float kFirstRadius = 1.25f, kNextRadius = 1.5f;
constexpr int kRadii = 11;
/// Photons of a cell with which radii are compared.
constexpr std::size_t kRadiusPhotons = 256;
/// Photons at grazing angles count as if they had this cosine.
constexpr float kMinCosine = 0.02f;
/// Cells where light causes less relative variance than this are not guided.
constexpr float kMinVariance = 0.1f;
/// Probability of following the guide: 0 below kMinGain, kMaxProbability for an infinite gain.
/// Measured: docs/notes/guiding.md.
constexpr float kMinGain = 1.5f, kMaxProbability = 0.75f;
/// Images with a smaller gain are left to the tree.
constexpr float kMinImageGain = 16;

Box3f padded_box(std::span<const Photon> photons) {
  Box3f box;
  for (const Photon& photon : photons) box.extend(photon.position);
  const float pad = max_component(box.hi - box.lo) * kMargin;
  box.lo = box.lo - Vec3f{pad, pad, pad};
  box.hi = box.hi + Vec3f{pad, pad, pad};
  return box;
}

/// A photon seen from the centre.
struct Seen {
  Vec2f point;      // of the square
  float scale = 1;  // density over solid angle at the photon per density in the square
};

/// The photons of a cell, recentred for one radius.
class Projection {
 public:
  Projection(std::span<const Photon> photons, const Vec3f& centre, float radius)
      : photons_(photons) {
    seen_.reserve(photons.size());
    for (const Photon& photon : photons) {
      const Recentred r = recentred(photon.position - centre, photon.direction, radius);
      seen_.push_back(
          {octahedral::square_of(r.direction), r.scale * octahedral::density(r.direction)});
    }
  }

  std::vector<DirectionNode> tree() const {
    return tree_of([](const Photon&) { return true; });
  }

  struct Prediction {
    double log_density = 0;  // means over the photons that are predicted, weighted by flux
    double gain = 0;
  };
  /// How well each half of the photons predicts the other half.
  Prediction predict() const {
    Prediction sum;
    double weight = 0;
    for (const bool second : {false, true}) {
      const std::vector<DirectionNode> other =
          tree_of([second](const Photon& photon) { return photon.in_second_half() != second; });
      for (std::size_t i = 0; i < seen_.size(); ++i) {
        const Photon& photon = photons_[i];
        if (photon.in_second_half() != second) continue;
        const float density = seen_[i].scale * direction_tree_density(other.data(), seen_[i].point);
        const float cosine = std::max(dot(photon.direction, photon.normal), kMinCosine);
        const double flux{photon.flux};
        weight += flux;
        sum.log_density += flux * double{elementary::log(density)};
        sum.gain += flux * double{density / (cosine * warp::kInvPi)};
      }
    }
    return {sum.log_density / weight, sum.gain / weight};
  }

 private:
  template <typename Included>
  std::vector<DirectionNode> tree_of(Included included) const {
    std::vector<DirectionPoint> points;
    points.reserve(seen_.size());
    for (std::size_t i = 0; i < seen_.size(); ++i) {
      if (included(photons_[i]))
        points.push_back({direction_code(seen_[i].point), photons_[i].flux});
    }
    return build_direction_tree(points);
  }

  std::span<const Photon> photons_;
  std::vector<Seen> seen_;
};

/// If they are many, every n-th photon of each half, about kRadiusPhotons in all.
std::vector<Photon> some_of(std::span<const Photon> photons) {
  const std::size_t step = (photons.size() + kRadiusPhotons - 1) / kRadiusPhotons;
  std::vector<Photon> some;
  std::array<std::size_t, 2> count{};  // of the halves
  for (const Photon& photon : photons) {
    if (count[photon.in_second_half() ? 1 : 0]++ % step == 0) some.push_back(photon);
  }
  return some;
}

/// The radius with which each half of the photons predicts the other half best.
float best_radius(std::span<const Photon> photons, const CellFit& cell) {
  float best_density = 0, best = 0;
  float radius = length(cell.box.hi - cell.centre) * kFirstRadius;
  for (int i = 0; i <= kRadii; ++i, radius *= kNextRadius) {
    const float tried = i == kRadii ? 0 : radius;
    const auto density =
        static_cast<float>(Projection(photons, cell.centre, tried).predict().log_density);
    if (i > 0 && !(density > best_density)) continue;
    best_density = density;
    best = tried;
  }
  return best;
}

float mean_share(std::span<const Photon> photons) {
  double sum = 0, flux = 0;
  for (const Photon& photon : photons) {
    sum += double{photon.share} * double{photon.flux};
    flux += double{photon.flux};
  }
  return static_cast<float>(sum / flux);
}

/// `share`: of the light of the cell that only paths find. The relative variance that it causes in
/// a sample by cosine is (gain - 1) share^2.
float probability_of(float gain, float share) {
  if (!((gain - 1) * share * share > kMinVariance)) return 0;
  return gain > kMinGain ? kMaxProbability * (1 - kMinGain / gain) : 0;
}

/// Sampled by cosine, a contribution has the mean square `gain`, in units of that sampled by the
/// guide; sampled by both, it has gain / (1 + probability (gain - 1)).
float saving_of(float gain, float share, float probability) {
  return share * share * (gain - gain / (1 + probability * (gain - 1)));
}

/// Adds the images whose light causes much variance. `whole`: share of the cell's light that only
/// paths find.
void add_images(std::span<const WayImage> images, float whole, CellFit* fit) {
  for (const WayImage& of_way : images) {
    const float share = whole * of_way.share, gain = of_way.fit.gain;
    if (!(gain > kMinImageGain && (gain - 1) * share * share > kMinVariance)) continue;
    fit->images.push_back(of_way.fit.image);
    // Sampled with a probability p, such light has the mean square share²/p, and the rest of the
    // light, if it has little variance, 1/(1 − p). The sum is least here.
    const float probability = share / (1 + share);
    fit->images.back().share = probability;
    fit->saving += saving_of(gain, share, probability);
    fit->probability += probability;
  }
}

void add_tree(std::span<const Photon> photons, float share, CellFit* fit) {
  const auto second = std::count_if(photons.begin(), photons.end(),
                                    [](const Photon& photon) { return photon.in_second_half(); });
  const auto first = std::ssize(photons) - second;
  if (first + second < kMinPhotons || std::min(first, second) < kMinPhotons / 4) return;
  fit->radius = best_radius(some_of(photons), *fit);
  const Projection projection(photons, fit->centre, fit->radius);
  const auto gain = static_cast<float>(projection.predict().gain);
  fit->tree_share = probability_of(gain, share);
  if (!(fit->tree_share > 0)) return;
  fit->tree = projection.tree();
  fit->saving += saving_of(gain, share, fit->tree_share);
  fit->probability += fit->tree_share;
}

}  // namespace

CellFit fit_cell(std::span<const Photon> photons, std::span<const WayImage> images) {
  CellFit fit;
  if (photons.empty()) return fit;
  fit.box = padded_box(photons);
  fit.centre = (fit.box.lo + fit.box.hi) * 0.5f;
  const float share = mean_share(photons);
  add_images(images, share, &fit);
  add_tree(photons, share, &fit);
  if (!(fit.probability > 0)) return fit;
  fit.tree_share /= fit.probability;
  for (LightImage& image : fit.images) image.share /= fit.probability;
  fit.probability = std::min(fit.probability, kMaxProbability);
  return fit;
}

}  // namespace tessera::render
