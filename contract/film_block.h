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

/// What a block's size depends on. Pass 0 also carries the sample-0 layers.
struct FilmBlockShape {
  std::int32_t width = 0, height = 0;  // pixels of the tile, [1, 256]
  std::uint32_t aovs = 0;              // Aov bits of the job
  bool first_pass = false;

  std::int64_t pixel_count() const { return std::int64_t{width} * height; }
  bool operator==(const FilmBlockShape&) const = default;
};

/// Samples of one pixel and replicate that were not finite and were left out of the sums.
struct DroppedSamples {
  std::uint32_t pixel = 0;  // row-major in the tile
  std::uint32_t replicate = 0;
  std::uint32_t count = 0;
  bool operator==(const DroppedSamples&) const = default;
};

/// One unit's result: sums over the samples of a pass (farm.md, section 1).
///
/// Arrays are row-major over the tile. Each value was summed in double, in sample order, and
/// rounded once. Arrays that the shape does not call for are empty.
struct FilmBlock {
  FilmBlockShape shape;
  std::vector<float> rgb;               // [pixel][replicate][channel]: 3 * kReplicates per pixel
  std::vector<float> alpha;             // [pixel]: sum over all samples
  std::vector<float> albedo;            // [pixel][channel], sums over camera hits
  std::vector<float> normal;            // [pixel][axis], sums over camera hits
  std::vector<float> hits;              // [pixel]: camera hits, if albedo or normal is asked for
  std::vector<float> depth;             // [pixel], pass 0
  std::vector<float> position;          // [pixel][axis], pass 0
  std::vector<std::uint32_t> ids;       // [pixel][node, material, primitive] + 1, pass 0
  std::vector<DroppedSamples> dropped;  // by pixel, then replicate; no zero counts
  double clamped_energy = 0;    // Σ over samples and channels of radiance removed by --clamp
  double truncated_energy = 0;  // the same of radiance cut at --max-depth, estimated
  std::uint64_t transparency_limit_count = 0;  // paths that met 1,024 transparent surfaces

  /// A block of zeros.
  static FilmBlock zeros(const FilmBlockShape& shape);
  bool operator==(const FilmBlock&) const = default;
};

/// Bytes of the fixed part of a block of this shape; dropped samples add 12 each.
std::int64_t film_block_bytes(const FilmBlockShape& shape);

/// The block as bytes: little endian, planes in the order of the members above. Equal blocks give
/// equal bytes; these bytes are what digests and duplicate checks are taken over.
std::string encode(const FilmBlock& block);

/// The block in `bytes`, which must have exactly the size its shape and dropped count imply.
///
/// Errors: InvalidArgument with the field and value, for a wrong size, a value that is not
/// finite, or a dropped entry out of range, out of order or larger than `sample_count`.
absl::StatusOr<FilmBlock> decode(std::string_view bytes, const FilmBlockShape& shape,
                                 std::int32_t sample_count);

}  // namespace tessera::contract
