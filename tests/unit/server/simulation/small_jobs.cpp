#include "tests/unit/server/simulation/small_jobs.h"

#include <array>
#include <bit>
#include <cstring>
#include <iterator>
#include <span>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "contract/film_block.h"
#include "contract/pass_schedule.h"
#include "contract/tile_grid.h"
#include "server/film/merge.h"

namespace tessera::server {

JobSpec small_job(int kind, int sample_count) {
  struct Shape {
    int width, height, last_frame;
  };
  constexpr Shape kShapes[] = {{16, 8, 1},   {20, 12, 2}, {8, 8, 3}, {24, 8, 1},
                               {128, 64, 3}, {96, 64, 1}, {24, 8, 4}};
  static_assert(std::size(kShapes) == kFirstSharedKind + kSharedKinds);
  const Shape& shape = kShapes[kind];
  JobSpec spec;
  spec.name = absl::StrCat("kind", kind);
  spec.owner = absl::StrCat("owner", kind < kFirstSharedKind ? kind % 2 : kind - kFirstSharedKind);
  spec.priority = kind == kFirstSharedKind + 2 ? -1 : 0;
  spec.settings.width = shape.width;
  spec.settings.height = shape.height;
  spec.settings.tile = 8;
  spec.settings.spp = sample_count;
  spec.settings.frames = {{1, shape.last_frame, 1}};
  spec.assets = {
      {"scene.glb", scene_of(kind), static_cast<std::int64_t>(scene_bytes(kind).size())}};
  spec.request = request_of(spec);
  return spec;
}

absl::StatusOr<JobSpec> small_job(const JobRecord& record) {
  const std::vector<std::string> parts = absl::StrSplit(record.request, ' ');
  int kind = 0, sample_count = 0;
  if (parts.size() != 2 || !absl::SimpleAtoi(parts[0], &kind) ||
      !absl::SimpleAtoi(parts[1], &sample_count)) {
    return absl::DataLossError(absl::StrCat("request \"", record.request, "\""));
  }
  JobSpec spec = small_job(kind, sample_count);
  spec.id = record.id;
  spec.request_id = record.request_id;
  return spec;
}

std::string request_of(const JobSpec& spec) {
  return absl::StrCat(kind_of(spec), " ", spec.settings.spp);
}

int kind_of(const JobSpec& spec) {
  return spec.name.back() - '0';
}

std::string scene_bytes(int kind) {
  return absl::StrCat("the bytes of scene ", kind);
}

contract::Digest scene_of(int kind) {
  return contract::sha256(scene_bytes(kind));
}

std::string block_of(const JobSpec& spec, const contract::Unit& unit, int sample_count) {
  const contract::PixelRect rect = contract::TileGrid(spec.settings).rect(unit.tile);
  contract::FilmBlock block =
      contract::FilmBlock::zeros({rect.width, rect.height, 0, unit.pass == 0});
  const int seed =
      31 * unit.frame + 7 * unit.tile + 3 * unit.pass + 5 * sample_count + 11 * kind_of(spec);
  for (std::size_t i = 0; i < block.rgb.size(); ++i) {
    block.rgb[i] = static_cast<float>((static_cast<int>(i) + seed) % 17) * 0.125f;
  }
  for (float& alpha : block.alpha) alpha = static_cast<float>(sample_count);
  return contract::encode(block);
}

std::vector<std::string> undisturbed_pixels(int kind, int sample_count) {
  const JobSpec spec = small_job(kind, sample_count);
  const contract::TileGrid grid(spec.settings);
  const auto width = static_cast<std::size_t>(spec.settings.width);
  std::vector<std::string> digests;
  for (const std::int32_t frame : contract::frame_list(spec.settings.frames)) {
    std::vector<std::array<float, 4>> pixels(width *
                                             static_cast<std::size_t>(spec.settings.height));
    for (std::int32_t tile = 0; tile < grid.tile_count(); ++tile) {
      const contract::PixelRect rect = grid.rect(tile);
      TileSum sum(rect.width, rect.height, 0);
      std::int32_t number = 0;
      for (const contract::Pass& pass : contract::schedule(spec.settings)) {
        const std::string bytes = block_of(spec, {frame, tile, number}, pass.sample_count);
        const auto block =
            contract::decode(bytes, {rect.width, rect.height, 0, number == 0}, pass.sample_count);
        if (!block.ok() || !sum.add(*block, pass).ok()) return {"no block"};
        ++number;
      }
      for (std::int64_t i = 0; i < sum.pixel_count(); ++i) {
        const auto x = static_cast<std::size_t>(rect.x + i % rect.width);
        const auto y = static_cast<std::size_t>(rect.y + i / rect.width);
        sum.rgba(i, pixels[y * width + x]);
      }
    }
    static_assert(std::endian::native == std::endian::little);
    digests.push_back(contract::sha256(std::as_bytes(std::span(pixels))).hex());
  }
  return digests;
}

}  // namespace tessera::server
