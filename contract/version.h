#pragma once

namespace tessera::contract {

/// Version of the render contract: everything that determines the bits of a pixel. Raised by any
/// change of sampling, shading, geometry rules, pass schedule or the meaning of film blocks,
/// together with the committed reference hashes (docs/reference/compatibility.md).
inline constexpr int kRenderContract = 13;

/// SHA-256, in hexadecimal, of the reference tile that every renderer of this contract computes at
/// its start (worker/render/numerics/numerics_check.h). The server refuses a worker with another
/// one. Measured with GCC 12 -O2 and Clang 14 -O1 with sanitizers, on Debian 12's image libraries.
inline constexpr char kNumericsSha256[] =
    "116737cf30065eb0aac555a3232dcdff13abb8d4a13677b84c84823f241a88e5";

/// Replicates per pixel: sample i belongs to replicate i mod kReplicates
/// (docs/explanation/error-estimation.md).
inline constexpr int kReplicates = 4;

}  // namespace tessera::contract
