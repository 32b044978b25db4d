#pragma once

#include <array>
#include <optional>
#include <span>

#include "worker/guide/photon.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// The image of a light in a mirror or a lens: a small part of space that the light seems to come
/// from, or that it converges to. It moves with the place from which it is seen.
///
/// Directions are uniform ones, drawn together by a Möbius transformation: a narrow lobe with a
/// wide foot, so that no light from beside the image is much brighter than its density. Source:
/// Kato & McCullagh, "Some properties of a Cauchy family on the sphere derived from the Möbius
/// transformations", 2020.
struct LightImage {
  /// The light that arrives at a place comes along the vector origin + Σ along[k] place[k], whose
  /// length is 1 at the photons' centre. If the image does not move, the vector is proportional to
  /// the one from the place to the image, or to its opposite if the light converges to the image.
  Vec3f origin;
  std::array<Vec3f, 3> along{};
  /// Angular size: where the vector has the length 1, half of the light comes from directions at an
  /// angle of at most 2 atan(spread) to it. Elsewhere the spread is divided by the length, because
  /// an image looks smaller from further away.
  float spread = 1;
  float share = 0;  // probability of choosing it among what the guide of a cell proposes

  /// Unit direction at a place, for u in [0, 1)^2.
  Vec3f sample(const Vec3f& place, const Vec2f& u) const;
  /// Density of sample() over solid angle at a unit direction.
  float pdf(const Vec3f& place, const Vec3f& direction) const;
};

/// An image without its share, and how well it describes photons.
struct LightImageFit {
  LightImage image;
  /// Density of directions relative to that of sampling by cosine: geometric mean over photons to
  /// which the image was not fitted.
  float gain = 0;
};

/// Finds the image of a light from which photons come that took the same way (Photon::way); nullopt
/// if they are too few.
std::optional<LightImageFit> fit_light_image(std::span<const Photon> photons);

}  // namespace tessera::render
