#include "contract/film_block.h"

#include <bit>
#include <cmath>
#include <cstring>

#include "absl/strings/str_cat.h"

namespace tessera::contract {
namespace {

static_assert(std::endian::native == std::endian::little, "blocks are memory images");

constexpr std::int64_t kTrailerBytes = 8 + 8 + 8 + 4;  // energies, transparency limit, dropped
constexpr std::int64_t kDroppedBytes = 12;

/// Calls visit(member, values per pixel) for each plane of the shape, in encoding order. Only this
/// function knows the layout.
template <typename Block, typename Visit>
void for_each_plane(Block& block, const Visit& visit) {
  const FilmBlockShape& shape = block.shape;
  visit(block.rgb, 3 * kReplicates);
  visit(block.alpha, 1);
  if (shape.aovs & kAovAlbedo) visit(block.albedo, 3);
  if (shape.aovs & kAovNormal) visit(block.normal, 3);
  if (shape.aovs & (kAovAlbedo | kAovNormal)) visit(block.hits, 1);
  if (shape.aovs & kAovDenoising) visit(block.features, kFeatures * kReplicates);
  if (shape.aovs & kAovTraversalCost) visit(block.traversal_cost, 3);
  if (!shape.first_pass) return;
  if (shape.aovs & kAovDepth) visit(block.depth, 1);
  if (shape.aovs & kAovPosition) visit(block.position, 3);
  if (shape.aovs & kAovMotion) visit(block.motion, 4);
  if (shape.aovs & kAovIds) visit(block.ids, 3);
}

template <typename T>
void append(std::string& bytes, const T& value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

template <typename T>
T take(std::string_view& bytes) {
  T value;
  std::memcpy(&value, bytes.data(), sizeof value);
  bytes.remove_prefix(sizeof value);
  return value;
}

absl::Status check_finite(const std::vector<float>& values) {
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i])) {
      return absl::InvalidArgumentError(absl::StrCat("film block: value ", i, " is not finite"));
    }
  }
  return absl::OkStatus();
}
absl::Status check_finite(const std::vector<std::uint32_t>&) {
  return absl::OkStatus();
}

absl::Status check_dropped(const FilmBlock& block, std::int32_t sample_count) {
  const auto largest = static_cast<std::uint32_t>((sample_count + kReplicates - 1) / kReplicates);
  std::uint64_t previous = 0;
  for (std::size_t i = 0; i < block.dropped.size(); ++i) {
    const DroppedSamples& entry = block.dropped[i];
    const std::uint64_t key = std::uint64_t{entry.pixel} * kReplicates + entry.replicate + 1;
    if (entry.pixel >= static_cast<std::uint64_t>(block.shape.pixel_count()) ||
        entry.replicate >= kReplicates || entry.count == 0 || entry.count > largest ||
        key <= previous) {
      return absl::InvalidArgumentError(
          absl::StrCat("film block: dropped entry ", i, " (pixel ", entry.pixel, ", replicate ",
                       entry.replicate, ", count ", entry.count, ") is out of range or order"));
    }
    previous = key;
  }
  return absl::OkStatus();
}

}  // namespace

FilmBlock FilmBlock::zeros(const FilmBlockShape& shape) {
  FilmBlock block;
  block.shape = shape;
  for_each_plane(block, [&](auto& plane, int per_pixel) {
    plane.resize(static_cast<std::size_t>(shape.pixel_count() * per_pixel));
  });
  return block;
}

std::int64_t film_block_bytes(const FilmBlockShape& shape) {
  FilmBlock block;
  block.shape = shape;
  std::int64_t values = 0;
  for_each_plane(block, [&](auto&, int per_pixel) { values += per_pixel; });
  return 4 * values * shape.pixel_count() + kTrailerBytes;
}

std::string encode(const FilmBlock& block) {
  std::string bytes;
  bytes.reserve(
      static_cast<std::size_t>(film_block_bytes(block.shape) +
                               kDroppedBytes * static_cast<std::int64_t>(block.dropped.size())));
  for_each_plane(block, [&](const auto& plane, int) {
    bytes.append(reinterpret_cast<const char*>(plane.data()), 4 * plane.size());
  });
  append(bytes, block.clamped_energy);
  append(bytes, block.truncated_energy);
  append(bytes, block.transparency_limit_count);
  append(bytes, static_cast<std::uint32_t>(block.dropped.size()));
  for (const DroppedSamples& entry : block.dropped) {
    append(bytes, entry.pixel);
    append(bytes, entry.replicate);
    append(bytes, entry.count);
  }
  return bytes;
}

absl::StatusOr<FilmBlock> decode(std::string_view bytes, const FilmBlockShape& shape,
                                 std::int32_t sample_count) {
  const std::int64_t fixed = film_block_bytes(shape);
  const auto size = static_cast<std::int64_t>(bytes.size());
  if (size < fixed) {
    return absl::InvalidArgumentError(
        absl::StrCat("film block: ", size, " bytes, its unit implies at least ", fixed));
  }
  FilmBlock block = FilmBlock::zeros(shape);
  absl::Status finite;
  for_each_plane(block, [&](auto& plane, int) {
    std::memcpy(plane.data(), bytes.data(), 4 * plane.size());
    bytes.remove_prefix(4 * plane.size());
    finite.Update(check_finite(plane));
  });
  if (!finite.ok()) return finite;
  block.clamped_energy = take<double>(bytes);
  block.truncated_energy = take<double>(bytes);
  block.transparency_limit_count = take<std::uint64_t>(bytes);
  for (const double energy : {block.clamped_energy, block.truncated_energy}) {
    if (!(energy >= 0) || !std::isfinite(energy)) {
      return absl::InvalidArgumentError(
          absl::StrCat("film block: an energy of ", energy, " is negative or not finite"));
    }
  }
  const auto dropped_count = take<std::uint32_t>(bytes);
  if (size != fixed + kDroppedBytes * std::int64_t{dropped_count}) {
    return absl::InvalidArgumentError(absl::StrCat("film block: ", size, " bytes do not hold ",
                                                   dropped_count, " dropped entries"));
  }
  block.dropped.resize(dropped_count);
  for (DroppedSamples& entry : block.dropped) {
    entry.pixel = take<std::uint32_t>(bytes);
    entry.replicate = take<std::uint32_t>(bytes);
    entry.count = take<std::uint32_t>(bytes);
  }
  if (absl::Status status = check_dropped(block, sample_count); !status.ok()) return status;
  return block;
}

}  // namespace tessera::contract
