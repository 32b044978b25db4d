#pragma once

namespace tessera::contract {

/// Version of the render contract: everything that decides a pixel's bits. Raised by any change
/// of sampling, shading, geometry rules, pass schedule or film block meaning, and together with
/// the committed reference hashes only.
inline constexpr int kRenderContract = 11;

/// SHA-256, in hex, of the reference tile every renderer of this contract makes of itself when it
/// starts (worker/render/numerics/numerics_check.h). A worker that gets another one is refused.
/// Measured with GCC 12 -O2 and Clang 14 -O1 with sanitizers, on Debian 12's image libraries.
inline constexpr char kNumericsSha256[] =
    "56d9d70e61a2b242d5172ddaffe26f0234fe609bbb77674efb37143a8316203b";

/// Replicates per pixel: sample i belongs to replicate i mod kReplicates (farm.md, section 1).
inline constexpr int kReplicates = 4;

}  // namespace tessera::contract
