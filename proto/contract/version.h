#pragma once

namespace tessera::contract {

/// Version of the render contract: everything that decides a pixel's bits. Raised by any change
/// of sampling, shading, geometry rules, pass schedule or film block meaning, and together with
/// the committed reference hashes only.
inline constexpr int kRenderContract = 2;

/// Replicates per pixel: sample i belongs to replicate i mod kReplicates (farm.md, section 1).
inline constexpr int kReplicates = 4;

}  // namespace tessera::contract
