#pragma once

namespace tessera::contract {

/// Version of the render contract: everything that determines the bits of a pixel. Raised by any
/// change of sampling, shading, geometry rules, pass schedule or the meaning of film blocks,
/// together with the committed reference hashes (docs/reference/compatibility.md).
inline constexpr int kRenderContract = 28;

/// SHA-256, in hexadecimal, of the reference tile that every renderer of this contract computes at
/// its start (worker/render/numerics/numerics_check.h). The server refuses a worker with another
/// one. The same with GCC 12 -O2 and with Clang 14 -O1 and sanitizers, on Debian 12's image
/// libraries.
inline constexpr char kNumericsSha256[] =
    "fe1109fdbc6c1d14b01d544afdc482105cc530234f5ac71f7eb60160a1128f25";

/// Replicates per pixel: sample i belongs to replicate i mod kReplicates
/// (docs/explanation/error-estimation.md).
inline constexpr int kReplicates = 4;

}  // namespace tessera::contract
