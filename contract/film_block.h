#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/render_settings.h"
#include "contract/version.h"

namespace tessera::contract {

/// Values per pixel and replicate of FilmBlock::features.
constexpr int kFeatures = 8;

/// Determines a block's size. Only pass 0 has the layers of sample 0.
struct FilmBlockShape {
  std::int32_t width = 0, height = 0;  // pixels of the tile, [1, 256]
  std::uint32_t aovs = 0;              // Aov bits of the job
  bool first_pass = false;

  std::int64_t pixel_count() const { return std::int64_t{width} * height; }
  bool operator==(const FilmBlockShape&) const = default;
};

/// Number of samples of a pixel and replicate that were not finite and are excluded from the sums.
struct DroppedSamples {
  std::uint32_t pixel = 0;  // row-major in the tile
  std::uint32_t replicate = 0;
  std::uint32_t count = 0;
  bool operator==(const DroppedSamples&) const = default;
};

/// The result of one unit: sums over the samples of a pass.
///
/// Arrays are row-major over the tile. Each value was summed in double, in sample order, and
/// rounded once. Arrays that the shape does not require are empty. See
/// docs/explanation/determinism.md.
struct FilmBlock {
  FilmBlockShape shape;
  std::vector<float> rgb;     // [pixel][replicate][channel]: 3 * kReplicates per pixel
  std::vector<float> alpha;   // [pixel]: sum over all samples
  std::vector<float> albedo;  // [pixel][channel], sums over camera hits
  std::vector<float> normal;  // [pixel][axis], sums over camera hits
  std::vector<float> hits;    // [pixel]: camera hits, with the albedo or normal layer
  /// [pixel][replicate][albedo 3, normal 3, depth, hits]: sums over camera hits, with the denoising
  /// layer. By replicate, so that a half of the samples can be denoised without the other half.
  std::vector<float> features;
  std::vector<float> traversal_cost;  // [pixel][rays, nodes, primitives], sums over all samples
  std::vector<float> depth;           // [pixel], pass 0
  std::vector<float> position;        // [pixel][axis], pass 0
  /// [pixel][to previous x, y, to next x, y]: pixels to the right and up, pass 0.
  std::vector<float> motion;
  std::vector<std::uint32_t> ids;       // [pixel][node, material, primitive] + 1, pass 0
  std::vector<DroppedSamples> dropped;  // by pixel, then replicate; no zero counts
  double clamped_energy = 0;    // Σ over samples and channels of radiance removed by --clamp
  double truncated_energy = 0;  // the same for radiance cut at --max-depth, estimated
  std::uint64_t transparency_limit_count = 0;  // paths that met 1,024 transparent surfaces

  /// A block of zeros.
  static FilmBlock zeros(const FilmBlockShape& shape);
  bool operator==(const FilmBlock&) const = default;
};

/// Bytes of the fixed part of a block of this shape; dropped samples add 12 each.
std::int64_t film_block_bytes(const FilmBlockShape& shape);

/// Returns the block as bytes: little endian, planes in the order of the members above. Equal
/// blocks give equal bytes; digests and comparisons use them.
std::string encode(const FilmBlock& block);

/// Decodes a block. `bytes` must have exactly the size that shape and dropped count imply.
///
/// Errors: InvalidArgument with field and value: wrong size, a value that is not finite, or a
/// dropped entry that is out of range, out of order or larger than `sample_count`.
absl::StatusOr<FilmBlock> decode(std::string_view bytes, const FilmBlockShape& shape,
                                 std::int32_t sample_count);

}  // namespace tessera::contract
