#include "server/film/frame_writer.h"

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "absl/base/config.h"
#include "image/exr/exr_file.h"
#include "server/film/image_export.h"
#include "tests/support/json_schema.h"
#include "tests/unit/server/film/made_blocks.h"

namespace tessera::server {
namespace {

constexpr std::uint32_t kAllAovs = contract::kAovAlbedo | contract::kAovNormal |
                                   contract::kAovDepth | contract::kAovPosition |
                                   contract::kAovIds | contract::kAovSamples |
                                   contract::kAovStdError | contract::kAovTraversalCost;

/// An image read from a file: every channel as stored, float or bits of UINT.
struct ReadBack {
  OIIO::ImageSpec spec;
  std::vector<float> floats;  // half and float channels, all channels interleaved; UINT rounded
  std::vector<std::uint32_t> ids;  // ids.node

  std::size_t channel(const std::string& name) const {
    const int index = spec.channelindex(name);
    EXPECT_GE(index, 0) << name;
    return static_cast<std::size_t>(index);
  }
  float at(std::size_t pixel, const std::string& name) const {
    return floats[pixel * static_cast<std::size_t>(spec.nchannels) + channel(name)];
  }
};

ReadBack read_back(const std::string& path) {
  ReadBack image;
  const auto input = OIIO::ImageInput::open(path);
  EXPECT_NE(input, nullptr) << OIIO::geterror();
  if (input == nullptr) return image;
  image.spec = input->spec();
  const auto pixels = static_cast<std::size_t>(image.spec.image_pixels());
  image.floats.resize(pixels * static_cast<std::size_t>(image.spec.nchannels));
  EXPECT_TRUE(input->read_image(0, 0, 0, -1, OIIO::TypeDesc::FLOAT, image.floats.data()));
  if (const int node = image.spec.channelindex("ids.node"); node >= 0) {
    image.ids.resize(pixels);
    EXPECT_TRUE(input->read_image(0, 0, node, node + 1, OIIO::TypeDesc::UINT32, image.ids.data()));
  }
  return image;
}

class FrameWriterTest : public ::testing::Test {
 protected:
  FrameWriterTest()
      : folder_(std::filesystem::temp_directory_path() /
                ("tessera_film_" + std::to_string(::getpid()))) {
    std::filesystem::create_directories(folder_);
    spec_.settings.width = 70;
    spec_.settings.height = 50;
    spec_.settings.tile = 32;
    spec_.settings.spp = 8;
    spec_.job_id = "abc123";
    spec_.name = "a scene";
    spec_.frame = 7;
    spec_.mean_luminance = 0.75;
  }
  ~FrameWriterTest() override { std::filesystem::remove_all(folder_); }

  std::string path(const std::string& name) const { return folder_ / name; }
  TileReader made_tiles() const {
    return [this](std::int32_t index) -> absl::StatusOr<TileSum> {
      const contract::PixelRect rect = contract::TileGrid(spec_.settings).rect(index);
      TileSum tile(rect.width, rect.height, spec_.settings.aovs);
      const contract::Pass pass{0, 8};
      if (absl::Status status = tile.add(made_block(rect, spec_.settings.aovs, 0, pass), pass);
          !status.ok()) {
        return status;
      }
      return tile;
    };
  }
  /// Tiles whose pixels depend only on their position in the full frame, for any tiling.
  TileReader gradient_tiles() const {
    return [this](std::int32_t index) -> absl::StatusOr<TileSum> {
      const contract::PixelRect rect = contract::TileGrid(spec_.settings).rect(index);
      TileSum tile(rect.width, rect.height, 0);
      contract::FilmBlock block = contract::FilmBlock::zeros({rect.width, rect.height, 0, true});
      std::size_t pixel = 0;
      for (int y = rect.y; y < rect.y + rect.height; ++y) {
        for (int x = rect.x; x < rect.x + rect.width; ++x, ++pixel) {
          for (std::size_t r = 0; r < contract::kReplicates; ++r) {
            block.rgb[12 * pixel + 3 * r] = static_cast<float>(x);
            block.rgb[12 * pixel + 3 * r + 1] = static_cast<float>(y);
          }
          block.alpha[pixel] = 4;
        }
      }
      if (absl::Status status = tile.add(block, {0, 4}); !status.ok()) return status;
      return tile;
    };
  }
  /// Tiles that are `value` everywhere.
  TileReader grey_tiles(float value) const {
    return [this, value](std::int32_t index) -> absl::StatusOr<TileSum> {
      const contract::PixelRect rect = contract::TileGrid(spec_.settings).rect(index);
      TileSum tile(rect.width, rect.height, 0);
      contract::FilmBlock block = contract::FilmBlock::zeros({rect.width, rect.height, 0, true});
      std::fill(block.rgb.begin(), block.rgb.end(), value);
      std::fill(block.alpha.begin(), block.alpha.end(), 4.0f);
      if (absl::Status status = tile.add(block, {0, 4}); !status.ok()) return status;
      return tile;
    };
  }
  FrameResult written(const TileReader& tiles, const std::string& name) const {
    const absl::StatusOr<FrameResult> result = write_frame(spec_, tiles, path(name));
    EXPECT_TRUE(result.ok()) << result.status();
    return result.ok() ? *result : FrameResult{};
  }

  std::filesystem::path folder_;
  FrameSpec spec_;
};

std::string bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

TEST_F(FrameWriterTest, FrameInMemoryIsThatOfTheFile) {
  for (const bool half : {false, true}) {
    spec_.settings.aovs = kAllAovs;
    spec_.settings.half = half;
    const FrameResult file = written(made_tiles(), "file.exr");
    const absl::StatusOr<FrameResult> memory = encode_frame(spec_, made_tiles());
    ASSERT_TRUE(memory.ok()) << memory.status();
    EXPECT_EQ(memory->image, bytes_of(path("file.exr")));
    EXPECT_EQ(memory->file_sha256, file.file_sha256);
    EXPECT_EQ(memory->pixels_sha256, file.pixels_sha256);
    EXPECT_EQ(memory->file_bytes, file.file_bytes);
    EXPECT_TRUE(file.image.empty());
  }
  const contract::PixelRect window = spec_.settings.window();
  const std::int64_t pixels = std::int64_t{window.width} * window.height;
  spec_.settings.aovs = contract::kAovDepth | contract::kAovAlbedo;
  EXPECT_EQ(raw_frame_bytes(spec_.settings), pixels * (4 * 2 + 3 * 2 + 4));
}

TEST_F(FrameWriterTest, EveryLayerRoundTripsExactly) {
  spec_.settings.aovs = kAllAovs;
  const FrameResult result = written(made_tiles(), "all.exr");
  const ReadBack image = read_back(path("all.exr"));
  ASSERT_EQ(image.spec.nchannels, 4 + 3 + 3 + 1 + 3 + 3 + 1 + 3 + 3);
  const contract::TileGrid grid(spec_.settings);
  for (std::int32_t index = 0; index < grid.tile_count(); ++index) {
    const contract::PixelRect rect = grid.rect(index);
    const TileSum tile = *made_tiles()(index);
    for (std::int64_t pixel = 0; pixel < tile.pixel_count(); pixel += 5) {
      const std::int64_t x = rect.x + pixel % rect.width, y = rect.y + pixel / rect.width;
      const auto i = static_cast<std::size_t>(y * 70 + x), p = static_cast<std::size_t>(pixel);
      float rgba[4], xyz[3];
      tile.rgba(pixel, rgba);
      ASSERT_EQ(image.at(i, "R"), rgba[0]);
      ASSERT_EQ(image.at(i, "A"), rgba[3]);
      tile.albedo(pixel, xyz);
      ASSERT_EQ(image.at(i, "albedo.G"), xyz[1]);
      tile.normal(pixel, xyz);
      ASSERT_EQ(image.at(i, "normal.Z"), xyz[2]);
      tile.standard_error(pixel, xyz);
      ASSERT_EQ(image.at(i, "stderr.B"), xyz[2]);
      tile.traversal_cost(pixel, xyz);
      ASSERT_EQ(image.at(i, "traversal-cost.rays"), xyz[0]);
      ASSERT_EQ(image.at(i, "traversal-cost.primitives"), xyz[2]);
      ASSERT_EQ(image.at(i, "depth.Z"), tile.first_sample().depth[p]);
      ASSERT_EQ(image.at(i, "position.Y"), tile.first_sample().position[3 * p + 1]);
      ASSERT_EQ(image.ids[i], tile.first_sample().ids[3 * p]);
    }
  }
  EXPECT_EQ(image.spec.channelformat(image.spec.channelindex("samples")), OIIO::TypeDesc::UINT32);
  EXPECT_EQ(result.statistics.samples, 70 * 50 * 8);
}

TEST_F(FrameWriterTest, DenoisedFileHasRawImageAndLessNoise) {
  spec_.settings.aovs = contract::kAovDenoising;
  const FrameResult raw = written(made_tiles(), "layers.exr");
  spec_.settings.denoise = true;
  const FrameResult denoised = written(made_tiles(), "denoised.exr");
  const ReadBack before = read_back(path("layers.exr")), after = read_back(path("denoised.exr"));
  ASSERT_EQ(before.spec.nchannels, 4 + 44);
  ASSERT_EQ(after.spec.nchannels, 4 + 3 + 3 + 3 + 3);
  double raw_spread = 0, spread = 0;  // about the mean of made blocks, 0.75
  for (std::size_t i = 0; i < 70 * 50; ++i) {
    ASSERT_EQ(after.at(i, "raw.G"), before.at(i, "G"));
    ASSERT_EQ(after.at(i, "A"), before.at(i, "A"));
    raw_spread += std::pow(after.at(i, "raw.G") - 0.75, 2);
    spread += std::pow(after.at(i, "G") - 0.75, 2);
  }
  EXPECT_LT(spread, 0.3 * raw_spread);
  ASSERT_TRUE(denoised.statistics.denoised.has_value());
  EXPECT_FALSE(raw.statistics.denoised.has_value());
  EXPECT_EQ(denoised.statistics.denoised->raw_pixels_sha256, raw.pixels_sha256);
  EXPECT_NE(denoised.pixels_sha256, raw.pixels_sha256);
  EXPECT_LT(denoised.statistics.denoised->error, raw.statistics.estimated.error);
}

TEST_F(FrameWriterTest, DenoisedFileHasTheSameBytesForAnyTiles) {
  spec_.settings.aovs = contract::kAovDenoising;
  spec_.settings.denoise = true;
  const auto gradient = [this](std::int32_t index) -> absl::StatusOr<TileSum> {
    const contract::PixelRect rect = contract::TileGrid(spec_.settings).rect(index);
    const std::uint32_t aovs = spec_.settings.aovs;
    TileSum tile(rect.width, rect.height, aovs);
    contract::FilmBlock block = contract::FilmBlock::zeros({rect.width, rect.height, aovs, true});
    std::size_t value = 0;
    for (int y = rect.y; y < rect.y + rect.height; ++y) {
      for (int x = rect.x; x < rect.x + rect.width; ++x) {
        for (int k = 0; k < 12; ++k) {
          block.rgb[value++] = static_cast<float>((x * 7 + y * 13 + k * 29) % 31 + x);
        }
      }
    }
    if (absl::Status status = tile.add(block, {0, 4}); !status.ok()) return status;
    return tile;
  };
  spec_.settings.tile = 8;
  written(gradient, "small.exr");
  spec_.settings.tile = 64;
  written(gradient, "large.exr");
  EXPECT_EQ(bytes_of(path("small.exr")), bytes_of(path("large.exr")));
}

TEST_F(FrameWriterTest, HashCoversFloatsInRowOrder) {
  const FrameResult result = written(made_tiles(), "hash.exr");
  const ReadBack image = read_back(path("hash.exr"));
  ASSERT_EQ(image.spec.nchannels, 4);
  EXPECT_EQ(result.pixels_sha256, contract::sha256(std::as_bytes(std::span(image.floats))));
  const std::string bytes = bytes_of(path("hash.exr"));
  EXPECT_EQ(result.file_sha256, contract::sha256(bytes));
  EXPECT_EQ(result.file_bytes, static_cast<std::int64_t>(bytes.size()));
}

TEST_F(FrameWriterTest, SameInputGivesSameBytes) {
  written(made_tiles(), "a.exr");
  written(made_tiles(), "b.exr");
  EXPECT_EQ(bytes_of(path("a.exr")), bytes_of(path("b.exr")));
  EXPECT_EQ(bytes_of(path("a.exr")).find("capDate"), std::string::npos);
  for (const auto& attribute : read_back(path("a.exr")).spec.extra_attribs) {
    EXPECT_NE(attribute.name(), "DateTime");
    EXPECT_NE(attribute.name(), "HostComputer");
  }
}

TEST_F(FrameWriterTest, ThreadsThatCompressKeepBytesAndErrors) {
#if defined(ABSL_HAVE_THREAD_SANITIZER)
  GTEST_SKIP() << "ThreadSanitizer cannot see into OpenEXR's threads";
#endif
  spec_.settings.aovs = kAllAovs;
  spec_.settings.height = 200;  // 13 groups of scanlines
  const FrameResult one = written(made_tiles(), "one.exr");
  image::set_exr_threads(4);
  const FrameResult four = written(made_tiles(), "four.exr");
  const absl::Status full = write_frame(spec_, made_tiles(), "/dev/full").status();
  image::set_exr_threads(0);
  EXPECT_EQ(bytes_of(path("four.exr")), bytes_of(path("one.exr")));
  EXPECT_EQ(four.file_sha256, one.file_sha256);
  EXPECT_EQ(full.code(), absl::StatusCode::kResourceExhausted);
}

TEST_F(FrameWriterTest, TileSizeKeepsPixels) {
  // Hard case 72.
  std::vector<contract::Digest> hashes;
  for (const std::int32_t tile : {8, 16, 64, 256}) {
    spec_.settings.tile = tile;
    hashes.push_back(written(gradient_tiles(), "tiles.exr").pixels_sha256);
  }
  for (const contract::Digest& hash : hashes) EXPECT_EQ(hash, hashes[0]);
}

TEST_F(FrameWriterTest, CropKeepsItsOffset) {
  spec_.settings.crop = contract::PixelRect{11, 5, 40, 33};
  written(gradient_tiles(), "crop.exr");
  const ReadBack image = read_back(path("crop.exr"));
  EXPECT_EQ(image.spec.x, 11);
  EXPECT_EQ(image.spec.y, 5);
  EXPECT_EQ(image.spec.width, 40);
  EXPECT_EQ(image.spec.height, 33);
  EXPECT_EQ(image.spec.full_width, 70);
  EXPECT_EQ(image.spec.full_height, 50);
  EXPECT_EQ(image.at(0, "R"), 11.0f);
  EXPECT_EQ(image.at(40 * 33 - 1, "R"), 50.0f);
  EXPECT_EQ(image.at(40 * 33 - 1, "G"), 37.0f);
}

TEST_F(FrameWriterTest, AttributesNameJobContractAndSamples) {
  spec_.settings.camera = "front";
  spec_.max_samples = 24;
  written(made_tiles(), "attributes.exr");
  const OIIO::ImageSpec spec = read_back(path("attributes.exr")).spec;
  EXPECT_EQ(spec.get_string_attribute("tessera:job"), "abc123");
  EXPECT_EQ(spec.get_string_attribute("tessera:name"), "a scene");
  EXPECT_EQ(spec.get_string_attribute("tessera:camera"), "front");
  EXPECT_EQ(spec.get_int_attribute("tessera:contract"), contract::kRenderContract);
  EXPECT_EQ(spec.get_int_attribute("tessera:samples"), 24);
  EXPECT_EQ(spec.get_int_attribute("tessera:frame"), 7);
}

TEST_F(FrameWriterTest, HalfOverflowIsClampedAndCounted) {
  // Hard case 71.
  const auto value_of = [&](float value, bool half) {
    spec_.settings.half = half;
    const FrameResult result = written(grey_tiles(value), "half.exr");
    EXPECT_EQ(result.statistics.half_overflow_count, half && value > 65504 ? 3 * 70 * 50 : 0);
    return read_back(path("half.exr")).at(0, "R");
  };
  EXPECT_EQ(value_of(1e6f, false), 1e6f);
  EXPECT_EQ(value_of(1e6f, true), 65504.0f);
  EXPECT_EQ(value_of(65504.0f, true), 65504.0f);
  EXPECT_EQ(value_of(6e-8f, true), 0x1p-24f) << "the smallest half, not zero";
  EXPECT_EQ(value_of(2e-8f, true), 0.0f);
}

TEST_F(FrameWriterTest, HalfKeepsPixelHash) {
  const FrameResult full = written(made_tiles(), "full.exr");
  spec_.settings.half = true;
  const FrameResult half = written(made_tiles(), "half.exr");
  EXPECT_EQ(full.pixels_sha256, half.pixels_sha256);
  EXPECT_NE(full.file_sha256, half.file_sha256);
  EXPECT_EQ(read_back(path("half.exr")).spec.format, OIIO::TypeDesc::HALF);
}

TEST_F(FrameWriterTest, MissingTilesAreRefusedOrListed) {
  const TileReader tiles = [this](std::int32_t index) -> absl::StatusOr<TileSum> {
    if (index != 2) return made_tiles()(index);
    const contract::PixelRect rect = contract::TileGrid(spec_.settings).rect(index);
    return TileSum(rect.width, rect.height, 0);
  };
  EXPECT_EQ(write_frame(spec_, tiles, path("partial.exr")).status().code(),
            absl::StatusCode::kFailedPrecondition);
  spec_.allow_missing = true;
  const FrameResult result = written(tiles, "partial.exr");
  const contract::PixelRect hole = contract::TileGrid(spec_.settings).rect(2);
  ASSERT_EQ(result.missing_tiles, std::vector<contract::PixelRect>{hole});
  const ReadBack image = read_back(path("partial.exr"));
  const auto inside = static_cast<std::size_t>(hole.y * 70 + hole.x);
  EXPECT_EQ(image.at(inside, "R"), 0.0f);
  EXPECT_EQ(image.at(inside, "A"), 0.0f);
  EXPECT_NE(image.at(hole.x > 0 ? 0 : 69, "R"), 0.0f);
}

TEST_F(FrameWriterTest, StatisticsCoverWholeFrame) {
  const FrameResult result = written(made_tiles(), "statistics.exr");
  ErrorSums sums;
  std::vector<double> per_pixel;
  const contract::TileGrid grid(spec_.settings);
  std::int64_t fewest = 1 << 30;
  for (std::int32_t index = 0; index < grid.tile_count(); ++index) {
    const TileSum tile = *made_tiles()(index);
    sums.add(tile.error_sums(0.75, &per_pixel));
    fewest = std::min(fewest, tile.pixel_count() * 8);
  }
  std::sort(per_pixel.rbegin(), per_pixel.rend());
  double top = 0;
  for (std::size_t i = 0; i < 3; ++i) top += per_pixel[i];  // 0.1 % of 3,500 pixels
  const FrameStatistics& statistics = result.statistics;
  EXPECT_EQ(statistics.estimated.error, estimate_error(sums).error);
  EXPECT_NEAR(statistics.heavy_tail_share, top / sums.scaled, 1e-15);
  EXPECT_DOUBLE_EQ(statistics.unseen_event_bound, 3.0 / static_cast<double>(fewest));
  EXPECT_EQ(statistics.spp_mean, 8);
  EXPECT_EQ(statistics.spp_max, 8);
  EXPECT_EQ(statistics.dropped_samples, 0);
}

TEST_F(FrameWriterTest, KeptErrorsGiveTheSameStatistics) {
  spec_.settings.width = 320;
  spec_.settings.height = 240;  // 0.1 % are 76 pixels, more than a tile keeps
  const contract::TileGrid grid(spec_.settings);
  // The largest errors are in the first tile, in the last one, or everywhere.
  for (const std::int32_t noisy : {0, grid.tile_count() - 1, -1}) {
    const auto tile_of = [&](std::int32_t index) {
      const contract::PixelRect rect = grid.rect(index);
      contract::FilmBlock block = made_block(rect, 0, 0, {0, 8});
      for (std::size_t i = 0; index == noisy && i < block.rgb.size(); i += 12) block.rgb[i] *= 9;
      TileSum tile(rect.width, rect.height, 0);
      EXPECT_TRUE(tile.add(block, {0, 8}).ok());
      return tile;
    };
    const auto measured_tile = [&](std::int32_t index) {
      TileSum tile = tile_of(index);
      tile.measure(0.75);
      return tile;
    };
    for (const double m : {0.75, 0.5}) {  // the kept errors are not those of 0.5
      spec_.mean_luminance = m;
      const FrameStatistics expected = written(tile_of, "expected.exr").statistics;
      const FrameStatistics actual = written(measured_tile, "actual.exr").statistics;
      EXPECT_EQ(actual.estimated.error, expected.estimated.error) << noisy << ", m " << m;
      EXPECT_EQ(actual.estimated.error_upper95, expected.estimated.error_upper95) << noisy;
      EXPECT_EQ(actual.estimated.rmse, expected.estimated.rmse) << noisy;
      EXPECT_EQ(actual.heavy_tail_share, expected.heavy_tail_share) << noisy << ", m " << m;
      for (std::size_t i = 0; i < expected.tiles.size(); ++i) {
        ASSERT_EQ(actual.tiles[i].error, expected.tiles[i].error) << noisy << ", tile " << i;
      }
    }
  }
}

TEST_F(FrameWriterTest, ReportEntryHasEveryKey) {
  const FrameResult result = written(made_tiles(), "entry.exr");
  const CurvePoint point{1.5, 0.5, 28000, 0.25, 0.125, TrueErrorStats{0.3, 0.2, 0.1}};
  const auto entry = nlohmann::json::parse(frame_entry_json(result, "a.exr", "DONE", {point}));
  for (const char* key :
       {"frame", "file", "width", "height", "pixels_sha256", "spp_mean", "spp_max", "samples",
        "status", "mean_luminance", "estimated", "true", "heavy_tail_share", "unseen_event_bound",
        "dropped_samples", "clamped_energy", "truncated_energy", "curve"}) {
    EXPECT_TRUE(entry.contains(key)) << key;
  }
  for (const char* key : {"rmse", "relmse", "error", "error_upper95"}) {
    EXPECT_TRUE(entry["estimated"][key].is_number()) << key;
  }
  const auto schema = support::read_schema("report")["properties"]["frames"]["items"];
  EXPECT_EQ(support::schema_faults(schema, entry), std::vector<std::string>{});
  EXPECT_EQ(entry["pixels_sha256"], result.pixels_sha256.hex());
  EXPECT_EQ(entry["curve"][0]["error"], 0.125);
  EXPECT_EQ(entry["curve"][0]["error_true"], 0.1);
  EXPECT_EQ(entry["true"],
            nlohmann::json::parse(R"({"rmse": 0.3, "relmse": 0.2, "error": 0.1, "flip": null})"));
  EXPECT_EQ(entry["estimated"]["error"], result.statistics.estimated.error);
}

TEST_F(FrameWriterTest, ReportEntryListsTileErrors) {
  const FrameResult result = written(made_tiles(), "tiles.exr");
  const auto entry = nlohmann::json::parse(frame_entry_json(result, "a.exr", "DONE", {}));
  const contract::TileGrid grid(spec_.settings);
  ASSERT_EQ(entry["tiles"]["error"].size(), static_cast<std::size_t>(grid.tile_count()));
  for (std::int32_t index = 0; index < grid.tile_count(); ++index) {
    const TileSum tile = *made_tiles()(index);
    const double error = std::sqrt(contract::mean_scaled(tile.error_sums(0.75)));
    EXPECT_NEAR(entry["tiles"]["error"][index], error, 5e-4 * error);  // printed with four digits
    EXPECT_EQ(entry["tiles"]["spp"][index], tile.sample_count());
  }
}

TEST_F(FrameWriterTest, BlackFrameHasNoRelativeError) {
  spec_.mean_luminance = 0;
  const FrameResult result = written(grey_tiles(0), "black.exr");
  const auto entry = nlohmann::json::parse(frame_entry_json(result, "black.exr", "DONE", {}));
  EXPECT_TRUE(entry["estimated"]["error"].is_null());
  EXPECT_TRUE(entry["tiles"].is_null());
  EXPECT_EQ(entry["estimated"]["rmse"], 0.0);
}

TEST_F(FrameWriterTest, WarningsCountDroppedAndClamped) {
  FrameStatistics statistics;
  EXPECT_TRUE(frame_warnings(statistics).empty());
  statistics.dropped_samples = 12;
  statistics.half_overflow_count = 34;
  statistics.clamped_energy = 5;
  const std::vector<std::string> warnings = frame_warnings(statistics);
  ASSERT_EQ(warnings.size(), 3u);
  EXPECT_NE(warnings[0].find("12 samples"), std::string::npos);
  EXPECT_NE(warnings[1].find("--clamp removed a total radiance of 5"), std::string::npos);
  EXPECT_NE(warnings[2].find("34 values"), std::string::npos);
  FrameStatistics cut;
  cut.samples = 1000;
  cut.mean_luminance = 2;
  cut.truncated_energy = 3 * 1000 * 0.01;
  EXPECT_TRUE(frame_warnings(cut).empty()) << "half a per cent";
  cut.truncated_energy = 3 * 1000 * 0.5;
  ASSERT_EQ(frame_warnings(cut).size(), 1u);
  EXPECT_NE(frame_warnings(cut)[0].find("about 20 %"), std::string::npos);
}

TEST_F(FrameWriterTest, FullDiskOrMissingFolderIsAnError) {
  EXPECT_EQ(write_frame(spec_, made_tiles(), path("no/such/folder.exr")).status().code(),
            absl::StatusCode::kUnavailable);
  EXPECT_EQ(write_frame(spec_, made_tiles(), "/dev/full").status().code(),
            absl::StatusCode::kResourceExhausted);
}

TEST_F(FrameWriterTest, WideFrameIsWrittenInBands) {
#if defined(ABSL_HAVE_ADDRESS_SANITIZER) || defined(ABSL_HAVE_THREAD_SANITIZER)
  GTEST_SKIP() << "a sanitizer keeps freed memory and shadows of the rest";
#endif
  spec_.settings.width = 1024;
  spec_.settings.height = 4096;
  spec_.settings.tile = 64;
  rusage before{}, after{};
  getrusage(RUSAGE_SELF, &before);
  written(grey_tiles(1), "large.exr");  // 64 MiB of pixels
  getrusage(RUSAGE_SELF, &after);
  EXPECT_LT(after.ru_maxrss - before.ru_maxrss, 16 * 1024) << "KiB";
}

/// Decodes an exported image.
OIIO::ImageSpec decode(const std::string& bytes, const std::string& name,
                       std::vector<unsigned char>& pixels) {
  std::ofstream(name, std::ios::binary) << bytes;
  OIIO::ImageSpec hints;
  hints.attribute("oiio:UnassociatedAlpha", 1);
  const auto input = OIIO::ImageInput::open(name, &hints);
  EXPECT_NE(input, nullptr) << OIIO::geterror();
  if (input == nullptr) return {};
  OIIO::ImageSpec spec = input->spec();
  pixels.resize(static_cast<std::size_t>(spec.image_bytes()));
  EXPECT_TRUE(input->read_image(0, 0, 0, -1, OIIO::TypeDesc::UINT8, pixels.data()));
  return spec;
}

TEST_F(FrameWriterTest, PngIsExposedSrgb) {
  written(grey_tiles(0.25f), "grey.exr");
  std::vector<unsigned char> pixels;
  const auto plain = export_image(path("grey.exr"), ExportFormat::png, 0);
  ASSERT_TRUE(plain.ok()) << plain.status();
  const OIIO::ImageSpec spec = decode(*plain, path("grey.png"), pixels);
  EXPECT_EQ(spec.width, 70);
  EXPECT_EQ(spec.height, 50);
  EXPECT_EQ(spec.nchannels, 4);
  EXPECT_EQ(pixels[0], 137);  // 255 (1.055 · 0.25^(1/2.4) − 0.055) = 136.96
  EXPECT_EQ(pixels[3], 255);
  const auto brighter = export_image(path("grey.exr"), ExportFormat::png, 1);
  decode(*brighter, path("grey.png"), pixels);
  EXPECT_EQ(pixels[0], 188);  // 0.5
}

TEST_F(FrameWriterTest, PngIsUnpremultipliedJpegIsOverBlack) {
  const TileReader half_covered = [this](std::int32_t index) -> absl::StatusOr<TileSum> {
    const contract::PixelRect rect = contract::TileGrid(spec_.settings).rect(index);
    TileSum tile(rect.width, rect.height, 0);
    contract::FilmBlock block = contract::FilmBlock::zeros({rect.width, rect.height, 0, true});
    std::fill(block.rgb.begin(), block.rgb.end(), 0.125f);
    std::fill(block.alpha.begin(), block.alpha.end(), 2.0f);
    if (absl::Status status = tile.add(block, {0, 4}); !status.ok()) return status;
    return tile;
  };
  written(half_covered, "alpha.exr");
  std::vector<unsigned char> pixels;
  decode(*export_image(path("alpha.exr"), ExportFormat::png, 0), path("alpha.png"), pixels);
  EXPECT_EQ(pixels[0], 137) << "0.125 over alpha 0.5 is 0.25";
  EXPECT_EQ(pixels[3], 128);
  const OIIO::ImageSpec spec =
      decode(*export_image(path("alpha.exr"), ExportFormat::jpeg, 0), path("alpha.jpg"), pixels);
  EXPECT_EQ(spec.nchannels, 3);
  EXPECT_NEAR(pixels[0], 99, 1);  // 0.125
}

TEST_F(FrameWriterTest, ExportErrorsNameFault) {
  EXPECT_EQ(export_image(path("none.exr"), ExportFormat::png, 0).status().code(),
            absl::StatusCode::kNotFound);
  std::ofstream(path("junk.exr")) << "not an image";
  EXPECT_EQ(export_image(path("junk.exr"), ExportFormat::png, 0).status().code(),
            absl::StatusCode::kDataLoss);
}

}  // namespace
}  // namespace tessera::server
