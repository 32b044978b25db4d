#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "worker/geometry/bounds.h"
#include "worker/guide/direction_tree.h"
#include "worker/guide/photon.h"

namespace tessera::render {

/// Where the light of a cell's photons comes from.
struct CellFit {
  Box3f box;         // within which it is used
  Vec3f centre;      // of the box; directions are recentred to it (recentred.h)
  float radius = 0;  // of the sphere that directions lead to; 0: infinite
  float gain = 1;    // mean square of contributions sampled by cosine, relative to sampling this
  float probability = 0;            // with which paths follow it, 0 to kMaxProbability
  float saving = 0;                 // relative variance of a sample that following it removes
  std::vector<DirectionNode> tree;  // empty if the probability is 0
};

/// Fits the photons of a cell, which all lie on surfaces that face about the same way. The radius
/// is the one with which each half of the photons predicts the other half best, and the gain is
/// that of such a prediction, so that neither comes from chance.
CellFit fit_cell(std::span<const Photon> photons);

}  // namespace tessera::render
