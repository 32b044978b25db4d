#pragma once

#include "absl/status/statusor.h"
#include "contract/digest.h"
#include "worker/accel/layout/isa.h"

namespace tessera::render {

/// What this build, machine and its libraries make of a small reference tile: SHA-256 over the bits
/// of every elementary function at fixed arguments and over the film blocks of a built-in scene
/// with every kind of material, light and transform, textured from a PNG, a JPEG and an EXR file.
/// Workers whose digests differ would not render the same image ("The bits", rule 6). Takes a few
/// tens of milliseconds.
///
/// Errors: those of the image decoders, with "numerics check:" in front.
absl::StatusOr<contract::Digest> numerics_digest(Isa isa = best_isa());

}  // namespace tessera::render
