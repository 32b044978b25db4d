#pragma once

#include "absl/status/statusor.h"
#include "contract/digest.h"
#include "worker/accel/layout/isa.h"

namespace tessera::render {

/// Fingerprint of the arithmetic of this build, machine and libraries: SHA-256 over the results of
/// every elementary function at fixed arguments and over the film blocks of a small built-in scene
/// with every kind of material, light and transform, textured from a PNG, a JPEG and an EXR file.
/// Workers with different digests would not render the same image
/// (docs/explanation/determinism.md#numerics-check). Takes a few tens of milliseconds.
///
/// Errors: those of the image decoders, prefixed with "numerics check:".
absl::StatusOr<contract::Digest> numerics_digest(Isa isa = best_isa());

}  // namespace tessera::render
