#include "server/film/frame_writer.h"

#include <algorithm>
#include <cstdio>
#include <iterator>
#include <memory>
#include <span>
#include <thread>
#include <utility>

#include "absl/strings/str_cat.h"
#include "contract/index.h"
#include "contract/stopping/pass_rule.h"
#include "contract/tile_grid.h"
#include "contract/version.h"
#include "image/denoise/frame_denoiser.h"
#include "image/denoise/layers.h"
#include "image/exr/exr_file.h"
#include "server/film/largest_values.h"

namespace tessera::server {
namespace {

using contract::PixelRect;
using contract::RenderSettings;
using image::ExrHeader;
using image::ExrPlane;
using image::ExrType;
using image::ExrWriter;

/// Layers of one row of tiles, and the first plane of each.
class Band {
 public:
  Band(const RenderSettings& settings, std::int32_t rows)
      : aovs_(settings.aovs), width_(settings.window().width) {
    const ExrType colour = settings.half ? ExrType::half : ExrType::float32;
    add_layer({"R", "G", "B", "A"}, colour);
    if (aovs_ & contract::kAovAlbedo) add_layer({"albedo.R", "albedo.G", "albedo.B"}, colour);
    if (aovs_ & contract::kAovNormal) add_layer({"normal.X", "normal.Y", "normal.Z"}, colour);
    if (aovs_ & contract::kAovDepth) add_layer({"depth.Z"}, ExrType::float32);
    if (aovs_ & contract::kAovPosition) {
      add_layer({"position.X", "position.Y", "position.Z"}, ExrType::float32);
    }
    if (aovs_ & contract::kAovMotion) {
      add_layer({"backward.u", "backward.v", "forward.u", "forward.v"}, ExrType::float32);
    }
    if (aovs_ & contract::kAovIds) {
      add_layer({"ids.node", "ids.material", "ids.primitive"}, ExrType::uint32);
    }
    if (aovs_ & contract::kAovSamples) add_layer({"samples"}, ExrType::uint32);
    if (aovs_ & contract::kAovStdError) {
      add_layer({"stderr.R", "stderr.G", "stderr.B"}, ExrType::float32);
    }
    if (aovs_ & contract::kAovTraversalCost) {
      add_layer({"traversal-cost.rays", "traversal-cost.nodes", "traversal-cost.primitives"},
                ExrType::float32);
    }
    if (aovs_ & contract::kAovDenoising) add_denoising_layers();
    for (ExrPlane& plane : planes_) {
      const std::size_t size = contract::as_index(std::int64_t{rows} * width_);
      if (plane.type == ExrType::uint32) {
        plane.words.resize(size);
      } else {
        plane.values.resize(size);
      }
    }
  }

  const std::vector<ExrPlane>& planes() const { return planes_; }

  void clear() {
    for (ExrPlane& plane : planes_) {
      std::fill(plane.values.begin(), plane.values.end(), 0.0f);
      std::fill(plane.words.begin(), plane.words.end(), 0u);
    }
  }

  /// Copies a tile's pixels to column `x` of the band.
  void put(const TileSum& tile, std::int32_t x) {
    std::int64_t pixel = 0;
    const auto [width, height] = tile.size();
    for (std::int32_t row = 0; row < height; ++row) {
      for (std::int32_t column = 0; column < width; ++column, ++pixel) {
        put_pixel(tile, pixel, contract::as_index(std::int64_t{row} * width_ + x + column));
      }
    }
  }

 private:
  void add_layer(std::initializer_list<const char*> names, ExrType type) {
    for (const char* name : names) planes_.push_back({name, type, {}, {}});
  }

  void add_denoising_layers() {
    for (int r = 0; r < contract::kReplicates; ++r) {
      for (const char* name : image::kDenoisingChannels) {
        planes_.push_back(
            {absl::StrCat(image::kDenoisingPrefix, r, ".", name), ExrType::float32, {}, {}});
      }
    }
  }

  void put_pixel(const TileSum& tile, std::int64_t pixel, std::size_t to) {
    std::size_t plane = 0;
    const auto put_values = [&](std::span<const float> values) {
      for (const float value : values) planes_[plane++].values[to] = value;
    };
    float rgba[4];
    tile.rgba(pixel, rgba);
    put_values(rgba);
    float xyz[3];
    if (aovs_ & contract::kAovAlbedo) {
      tile.albedo(pixel, xyz);
      put_values(xyz);
    }
    if (aovs_ & contract::kAovNormal) {
      tile.normal(pixel, xyz);
      put_values(xyz);
    }
    if (aovs_ & contract::kAovDepth)
      put_values({&tile.first_sample().depth[contract::as_index(pixel)], 1});
    if (aovs_ & contract::kAovPosition)
      put_values({&tile.first_sample().position[3 * contract::as_index(pixel)], 3});
    if (aovs_ & contract::kAovMotion)
      put_values({&tile.first_sample().motion[4 * contract::as_index(pixel)], 4});
    if (aovs_ & contract::kAovIds) {
      for (std::size_t k = 0; k < 3; ++k) {
        planes_[plane++].words[to] = tile.first_sample().ids[3 * contract::as_index(pixel) + k];
      }
    }
    if (aovs_ & contract::kAovSamples) {
      planes_[plane++].words[to] = static_cast<std::uint32_t>(tile.kept(pixel));
    }
    if (aovs_ & contract::kAovStdError) {
      tile.standard_error(pixel, xyz);
      put_values(xyz);
    }
    if (aovs_ & contract::kAovTraversalCost) {
      tile.traversal_cost(pixel, xyz);
      put_values(xyz);
    }
    if (aovs_ & contract::kAovDenoising) {
      const TileSum::DenoisingValues values = tile.denoising_values(pixel);
      for (std::size_t r = 0; r < contract::kReplicates; ++r) {
        put_values(values.rgb[r]);
        put_values(values.features[r]);
      }
    }
  }

  std::uint32_t aovs_;
  std::int32_t width_;
  std::vector<ExrPlane> planes_;  // R, G, B, A first
};

/// Collects a frame's statistics from its tiles.
class Gatherer {
 public:
  Gatherer(const FrameSpec& spec, const contract::TileGrid& grid)
      : mean_luminance_(spec.mean_luminance.value_or(0)),
        looks_(spec.looks),
        error_(contract::as_index(grid.tile_count())),
        clamped_(error_.size()),
        truncated_(error_.size()),
        largest_(contract::as_index(std::max<std::int64_t>(
            1, std::int64_t{grid.window().width} * grid.window().height / 1000))) {
    statistics_.frame = spec.frame;
    statistics_.width = grid.window().width;
    statistics_.height = grid.window().height;
    statistics_.mean_luminance = spec.mean_luminance;
    statistics_.tiles.resize(error_.size());
  }

  void add(std::int32_t index, const TileSum& tile) {
    const std::int64_t samples = tile.pixel_count() * tile.sample_count();
    statistics_.samples += samples;
    statistics_.spp_max = std::max(statistics_.spp_max, tile.sample_count());
    fewest_samples_ = fewest_samples_ < 0 ? samples : std::min(fewest_samples_, samples);
    statistics_.dropped_samples += tile.losses().dropped_count;
    statistics_.transparency_limit_count += tile.losses().transparency_limit_count;
    clamped_[contract::as_index(index)] = tile.losses().clamped_energy;
    truncated_[contract::as_index(index)] = tile.losses().truncated_energy;
    error_[contract::as_index(index)] = measure(tile);
    statistics_.tiles[contract::as_index(index)] = {
        std::sqrt(contract::mean_scaled(error_[contract::as_index(index)])), tile.sample_count()};
  }

  /// Folds sums in tile order, whatever the order of the calls.
  FrameStatistics finish() {
    ErrorSums sums;
    for (const ErrorSums& tile : error_) sums.add(tile);
    for (const double energy : clamped_) statistics_.clamped_energy += energy;
    for (const double energy : truncated_) statistics_.truncated_energy += energy;
    statistics_.estimated = contract::estimate_error(sums, looks_);
    if (sums.scaled > 0) statistics_.heavy_tail_share = largest_.sum() / sums.scaled;
    const double pixels = static_cast<double>(statistics_.width) * statistics_.height;
    statistics_.spp_mean = static_cast<double>(statistics_.samples) / pixels;
    if (fewest_samples_ > 0) {
      statistics_.unseen_event_bound = 3.0 / static_cast<double>(fewest_samples_);
    }
    return statistics_;
  }

 private:
  /// Returns the tile's error, and adds its pixels to the largest ones. Measures the tile only if
  /// that has not been done, or if more of its pixels may be among the largest ones than the tile
  /// remembers.
  ErrorSums measure(const TileSum& tile) {
    const TileSum::Measured* const known = tile.measured(mean_luminance_);
    if (known != nullptr && (std::ssize(known->largest) == tile.pixel_count() ||
                             largest_.excludes(known->largest.front()))) {
      for (const double value : known->largest) largest_.add(value);
      return known->sums;
    }
    per_pixel_.clear();
    const ErrorSums sums = tile.error_sums(mean_luminance_, &per_pixel_);
    for (const double value : per_pixel_) largest_.add(value);
    return sums;
  }

  double mean_luminance_;
  int looks_;
  FrameStatistics statistics_;
  std::vector<ErrorSums> error_;             // by tile
  std::vector<double> clamped_, truncated_;  // by tile
  std::int64_t fewest_samples_ = -1;
  LargestValues largest_;
  std::vector<double> per_pixel_;
};

ExrHeader header_of(const FrameSpec& spec, const PixelRect& window) {
  const RenderSettings& settings = spec.settings;
  ExrHeader header;
  header.data_window = window;
  header.display_window = {0, 0, settings.width, settings.height};
  header.texts = {{"tessera:job", spec.job_id}, {"tessera:name", spec.name}};
  if (!settings.camera.empty()) header.texts.emplace_back("tessera:camera", settings.camera);
  header.numbers = {{"tessera:contract", contract::kRenderContract},
                    {"tessera:frame", spec.frame},
                    {"tessera:samples", spec.max_samples}};
  if ((settings.aovs & contract::kAovDenoising) != 0 && !settings.denoise) {
    header.reals = {{image::kMeanLuminanceAttribute, spec.mean_luminance.value_or(0)}};
  }
  return header;
}

/// Returns SHA-256 and size of a file.
absl::Status hash_file(const std::string& path, FrameResult& result) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"),
                                                             &std::fclose);
  if (file == nullptr) return absl::UnavailableError(absl::StrCat(path, ": cannot be read back"));
  contract::Hasher hasher;
  std::vector<std::byte> bytes(64 << 10);
  std::size_t size = 0;
  while ((size = std::fread(bytes.data(), 1, bytes.size(), file.get())) > 0) {
    hasher.update(std::span(bytes).first(size));
    result.file_bytes += static_cast<std::int64_t>(size);
  }
  if (std::ferror(file.get()) != 0) {
    return absl::UnavailableError(absl::StrCat(path, ": cannot be read back"));
  }
  result.file_sha256 = hasher.finish();
  return absl::OkStatus();
}

/// Input and output of write_frame().
struct Assembly {
  const FrameSpec& spec;
  const contract::TileGrid& grid;
  const TileReader& read_tile;
  Band band;
  Gatherer gatherer;
  std::vector<PixelRect> missing_tiles;

  Assembly(const FrameSpec& frame, const contract::TileGrid& tiles, const TileReader& reader)
      : spec(frame),
        grid(tiles),
        read_tile(reader),
        band(frame.settings, std::min(frame.settings.tile, tiles.window().height)),
        gatherer(frame, tiles) {}
};

/// Reads one row of tiles into the band.
absl::Status fill_band(Assembly& assembly, std::int32_t row) {
  const contract::TileGrid& grid = assembly.grid;
  if (assembly.spec.allow_missing) assembly.band.clear();
  for (std::int32_t column = 0; column < grid.columns(); ++column) {
    const std::int32_t index = grid.index_at(column, row);
    const absl::StatusOr<TileSum> tile = assembly.read_tile(index);
    if (!tile.ok()) return tile.status();
    if (tile->pass_count() > 0) {
      assembly.band.put(*tile, grid.rect(index).x - grid.window().x);
      assembly.gatherer.add(index, *tile);
    } else if (assembly.spec.allow_missing) {
      assembly.missing_tiles.push_back(grid.rect(index));
    } else {
      return absl::FailedPreconditionError(
          absl::StrCat("frame ", assembly.spec.frame, ": tile ", index, " has no committed pass"));
    }
  }
  return absl::OkStatus();
}

/// Hashes R, G, B, A of the first `rows` rows, pixel by pixel.
void hash_pixels(const std::vector<ExrPlane>& planes, std::int32_t width, std::int32_t rows,
                 contract::Hasher& hasher) {
  std::vector<float> row(4 * contract::as_index(width));
  for (std::int32_t y = 0; y < rows; ++y) {
    for (std::int32_t x = 0; x < width; ++x) {
      for (std::size_t c = 0; c < 4; ++c) {
        row[4 * contract::as_index(x) + c] =
            planes[c].values[contract::as_index(std::int64_t{y} * width + x)];
      }
    }
    hasher.update(std::as_bytes(std::span(row)));
  }
}

image::FrameDenoiser denoiser_of(const FrameSpec& spec, const PixelRect& window,
                                 const std::vector<ExrPlane>& planes) {
  const int threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  return {window.width, window.height, spec.mean_luminance.value_or(0), planes, threads};
}

DenoisedStatistics denoised_statistics(const image::FrameDenoiser& denoiser, int looks,
                                       const ErrorEstimate& raw) {
  const image::DenoisedError error = denoiser.error(contract::look_quantile(looks));
  DenoisedStatistics statistics = {
      error.error, error.error_upper95, error.n_eff, error.raw_share, {}};
  statistics.widen_bound(raw);
  return statistics;
}

/// Writes the bands of a frame, denoised if the job asks for it.
class Output {
 public:
  Output(const FrameSpec& spec, const PixelRect& window, const std::vector<ExrPlane>& planes)
      : width_(window.width), looks_(spec.looks) {
    if (spec.settings.denoise) denoiser_.emplace(denoiser_of(spec, window, planes));
  }

  /// `path`: empty to write to memory.
  absl::Status open(const std::string& path, const ExrHeader& header,
                    const std::vector<ExrPlane>& planes) {
    const std::vector<ExrPlane>& written = denoiser_ ? denoiser_->planes() : planes;
    auto writer = path.empty() ? ExrWriter::in_memory(header, written)
                               : ExrWriter::open(path, header, written);
    if (!writer.ok()) return writer.status();
    writer_ = *std::move(writer);
    return absl::OkStatus();
  }

  absl::Status write(std::int32_t rows, const std::vector<ExrPlane>& planes) {
    hash_pixels(planes, width_, rows, raw_pixels_);
    if (!denoiser_) return writer_->write_rows(rows, planes);
    return denoiser_->push(rows, planes,
                           [this](std::int32_t count, const std::vector<ExrPlane>& denoised) {
                             hash_pixels(denoised, width_, count, denoised_pixels_);
                             return writer_->write_rows(count, denoised);
                           });
  }

  /// Completes the file and enters the digests and, after denoising, the error.
  absl::Status close(FrameResult& result) {
    if (absl::Status status = writer_->close(); !status.ok()) return status;
    result.image = writer_->take_bytes();
    result.statistics.half_overflow_count = writer_->half_overflow_count();
    result.pixels_sha256 = raw_pixels_.finish();
    if (!denoiser_) return absl::OkStatus();
    result.statistics.denoised =
        denoised_statistics(*denoiser_, looks_, result.statistics.estimated);
    result.statistics.denoised->raw_pixels_sha256 = result.pixels_sha256;
    result.pixels_sha256 = denoised_pixels_.finish();
    return absl::OkStatus();
  }

 private:
  std::int32_t width_;
  int looks_;
  std::optional<image::FrameDenoiser> denoiser_;
  std::unique_ptr<ExrWriter> writer_;
  contract::Hasher raw_pixels_, denoised_pixels_;
};

/// Writes a frame, except for the digest of the file. `path`: empty to write to memory.
absl::StatusOr<FrameResult> write_bands(const FrameSpec& spec, const TileReader& read_tile,
                                        const std::string& path) {
  const contract::TileGrid grid(spec.settings);
  const PixelRect& window = grid.window();
  Assembly assembly(spec, grid, read_tile);
  Output output(spec, window, assembly.band.planes());
  absl::Status opened = output.open(path, header_of(spec, window), assembly.band.planes());
  if (!opened.ok()) return opened;
  for (std::int32_t row = 0; row < grid.rows(); ++row) {
    if (absl::Status status = fill_band(assembly, row); !status.ok()) return status;
    const std::int32_t rows = grid.rect(grid.index_at(0, row)).height;
    absl::Status status = output.write(rows, assembly.band.planes());
    if (!status.ok()) return status;
  }
  FrameResult result;
  result.statistics = assembly.gatherer.finish();
  if (absl::Status status = output.close(result); !status.ok()) return status;
  result.missing_tiles = std::move(assembly.missing_tiles);
  return result;
}

}  // namespace

void DenoisedStatistics::widen_bound(const ErrorEstimate& raw) {
  const double least = std::min(n_eff, raw.n_eff);
  if (least > 0 && least < contract::PassRule::kMinEffectivePixels)
    error_upper95 = std::max(error_upper95, raw.error_upper95);
}

absl::StatusOr<FrameResult> write_frame(const FrameSpec& spec, const TileReader& read_tile,
                                        const std::string& path) {
  auto result = write_bands(spec, read_tile, path);
  if (!result.ok()) return result;
  if (absl::Status status = hash_file(path, *result); !status.ok()) return status;
  return result;
}

absl::StatusOr<FrameResult> encode_frame(const FrameSpec& spec, const TileReader& read_tile) {
  auto result = write_bands(spec, read_tile, "");
  if (!result.ok()) return result;
  result->file_bytes = static_cast<std::int64_t>(result->image.size());
  result->file_sha256 = contract::sha256(result->image);
  return result;
}

std::int64_t raw_frame_bytes(const RenderSettings& settings) {
  std::int64_t pixel_bytes = 0;
  const Band band(settings, 0);
  for (const ExrPlane& plane : band.planes()) pixel_bytes += plane.type == ExrType::half ? 2 : 4;
  const PixelRect window = settings.window();
  return std::int64_t{window.width} * window.height * pixel_bytes;
}

std::int64_t write_memory_bytes(const RenderSettings& settings) {
  constexpr std::int64_t kDenoiserRows = 200;  // FrameDenoiser
  const PixelRect window = settings.window();
  const std::int64_t rows =
      std::min(settings.tile, window.height) + (settings.denoise ? kDenoiserRows : 0);
  const std::size_t plane_count = Band(settings, 0).planes().size();
  return rows * window.width * static_cast<std::int64_t>(plane_count * sizeof(float));
}

absl::StatusOr<FrameStatistics> measure_denoised(const FrameSpec& spec,
                                                 const TileReader& read_tile) {
  const contract::TileGrid grid(spec.settings);
  Assembly assembly(spec, grid, read_tile);
  image::FrameDenoiser denoiser = denoiser_of(spec, grid.window(), assembly.band.planes());
  const auto ignore = [](std::int32_t, const std::vector<ExrPlane>&) { return absl::OkStatus(); };
  for (std::int32_t row = 0; row < grid.rows(); ++row) {
    if (absl::Status status = fill_band(assembly, row); !status.ok()) return status;
    const std::int32_t rows = grid.rect(grid.index_at(0, row)).height;
    absl::Status status = denoiser.push(rows, assembly.band.planes(), ignore);
    if (!status.ok()) return status;
  }
  FrameStatistics statistics = assembly.gatherer.finish();
  statistics.denoised = denoised_statistics(denoiser, spec.looks, statistics.estimated);
  return statistics;
}

}  // namespace tessera::server
