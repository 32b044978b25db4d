#pragma once

#include <vector>

#include "contract/hilbert.h"

namespace tessera::render::bench {

/// Returns the pixels of a square image row by row.
std::vector<contract::GridPoint> scanline_order(int side);

/// Returns the pixels of a square image in Z order: bits of x and y alternate in a pixel's index, x
/// in the lowest bit. Requires a power of two. Source: G. Morton, "A computer oriented geodetic
/// data base and a new technique in file sequencing", 1966.
std::vector<contract::GridPoint> morton_order(int side);

}  // namespace tessera::render::bench
