#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "contract/film_block.h"

// Decodes film blocks, which come from the network. The first four bytes choose the shape that a
// unit implies, the rest is what a worker sent for it. An accepted block must encode to the same
// bytes and be harmless to accumulate: its sums are finite, and it drops no more samples than were
// drawn.

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using tessera::contract::decode;
  if (size < 4) return 0;
  tessera::contract::FilmBlockShape shape;
  shape.width = 1 + data[0] % 8;
  shape.height = 1 + data[0] / 8 % 8;
  shape.aovs = data[1] & 0x7Fu;
  shape.first_pass = (data[1] & 0x80u) != 0;
  const std::int32_t sample_count = 1 + data[2] + 256 * (data[3] % 8);
  const std::string_view bytes(reinterpret_cast<const char*>(data) + 4, size - 4);
  const auto block = decode(bytes, shape, sample_count);
  if (!block.ok()) return 0;
  if (encode(*block) != bytes) std::abort();
  std::int64_t dropped = 0;
  for (const auto& entry : block->dropped) dropped += entry.count;
  if (dropped > shape.pixel_count() * (sample_count + tessera::contract::kReplicates)) std::abort();
  return 0;
}
