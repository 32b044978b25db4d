#pragma once

#include "worker/guide/guide.h"
#include "worker/math/vector.h"
#include "worker/shading/bsdf/bsdf.h"

namespace tessera::render {

/// Samples the BSDF, or the lobe with its probability. The sample's density is that of both
/// together (Veach's one-sample model with the balance heuristic). `u`: x and y choose the
/// direction, z the lobe. Multiplies `unguided` by the weight that the BSDF alone would give the
/// sample, relative to that of the sample. False if the sample is lost. Requires lobe.probability >
/// 0.
bool sample_guided(const Bsdf& bsdf, const GuideLobe& lobe, const Vec4f& u, BsdfSample* next,
                   float* unguided);

}  // namespace tessera::render
