#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "worker/geometry/bounds.h"
#include "worker/guide/direction_tree.h"
#include "worker/guide/light_image.h"
#include "worker/guide/photon.h"

namespace tessera::render {

/// An image that was fitted to the photons of one way in a cell and, if these are few, around it.
struct WayImage {
  float share = 0;  // of the flux of all photons there
  LightImageFit fit;
};

/// Where the light of a cell's photons comes from.
struct CellFit {
  Box3f box;              // within which it is used
  Vec3f centre;           // of the box; directions are recentred to it (recentred.h)
  float radius = 0;       // of the sphere that directions lead to; 0: infinite
  float probability = 0;  // with which paths follow the images or the tree, 0 to kMaxProbability
  float saving = 0;       // relative variance of a sample that following it removes
  float tree_share = 0;   // probability of the tree once it is followed; the rest are the images'
  std::vector<LightImage> images;
  std::vector<DirectionNode> tree;  // of all photons; empty if its share is 0
};

/// Fits the photons of a cell, which all lie on surfaces that face about the same way. The radius
/// is the one with which each half of the photons predicts the other half best, and what paths gain
/// by following the tree or an image is that of such a prediction, so that neither comes from
/// chance.
CellFit fit_cell(std::span<const Photon> photons, std::span<const WayImage> images);

}  // namespace tessera::render
