#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/digest.h"
#include "contract/render_settings.h"
#include "server/film/merge.h"

namespace tessera::server {

/// Attributes of a frame's file. Contains neither times nor host names: the file depends on the job
/// only.
struct FrameSpec {
  contract::RenderSettings settings;
  std::int32_t frame = 0;
  std::string job_id;  // attribute only
  std::string name;    // attribute only
  /// m of FilmCache::mean_luminance(); nullopt for a partial frame without it.
  std::optional<double> mean_luminance;
  /// Number of looks among which the bound's confidence is divided; 1 for a fixed sample count.
  int looks = 1;
  /// Maximum number of samples per pixel; attribute only.
  std::int32_t max_samples = 0;
  /// Write tiles without a pass as transparent black and list them, instead of failing.
  bool allow_missing = false;
};

/// Returns the sums of a tile by index. Called once per tile, tile row by tile row from the top.
using TileReader = std::function<absl::StatusOr<TileSum>(std::int32_t tile)>;

/// Statistics of a tile.
struct TileStats {
  double error = 0;  // √mean of the scaled terms; 0 without m
  std::int32_t sample_count = 0;
};

/// Error of a denoised frame (docs/explanation/error-estimation.md).
struct DenoisedStatistics {
  double error = 0, error_upper95 = 0;  // undefined unless mean_luminance > 0
  double n_eff = 0;                     // effective number of pixels that carry the estimate
  double raw_tile_share = 0;            // share of the denoiser's tiles that are left raw
  contract::Digest raw_pixels_sha256;   // as FrameResult::pixels_sha256, before denoising

  /// If few pixels carry the error of either image, makes the bound at least the raw image's, which
  /// takes their number into account.
  void widen_bound(const ErrorEstimate& raw);
};

/// Statistics of a frame for the report's frames[] element.
struct FrameStatistics {
  std::int32_t frame = 0, width = 0, height = 0;  // of the window
  double spp_mean = 0;
  std::int32_t spp_max = 0;
  std::int64_t samples = 0;  // over all pixels, dropped ones included
  std::optional<double> mean_luminance;
  ErrorEstimate estimated;      // error and error_upper95 are undefined unless mean_luminance > 0
  double heavy_tail_share = 0;  // share of Σ scaled error in the top 0.1 % of pixels (at least one)
  double unseen_event_bound = 0;  // 3 / N, where N is the minimum of the tiles' samples
  std::int64_t dropped_samples = 0;
  double clamped_energy = 0;
  double truncated_energy = 0;  // Σ over samples and channels of radiance cut at --max-depth
  std::uint64_t transparency_limit_count = 0;
  std::int64_t half_overflow_count = 0;        // values clamped to 65504 in a half file
  std::vector<TileStats> tiles;                // in tile order; zeros for missing tiles
  std::optional<DenoisedStatistics> denoised;  // with RenderSettings::denoise
};

struct FrameResult {
  contract::Digest pixels_sha256;  // float32 RGBA, little endian, row by row from the top
  contract::Digest file_sha256;
  std::int64_t file_bytes = 0;
  FrameStatistics statistics;
  std::vector<contract::PixelRect> missing_tiles;  // frame coordinates; only with allow_missing
  std::string image;                               // the file, of encode_frame()
};

/// Writes a frame's window as OpenEXR (one part, scanlines, ZIP) to `path`, which the caller
/// publishes under its final name. Works in bands of one row of tiles: memory is one band of all
/// layers, whatever the frame's height.
///
/// Layers: R, G, B, A; albedo.{R,G,B}; normal.{X,Y,Z}; depth.Z; position.{X,Y,Z};
/// ids.{node,material,primitive} and samples as UINT; stderr.{R,G,B}. With `half`, R, G, B, A,
/// albedo and normal are half floats, clamped to ±65504 and counted; the others stay 32 bit.
/// displayWindow is the full frame, dataWindow the crop. Equal arguments give equal bytes.
///
/// Errors: FailedPrecondition, a tile has no pass and allow_missing is not set; the TileReader's;
/// Unavailable, the file cannot be written (the message says why). A partly written file is left.
absl::StatusOr<FrameResult> write_frame(const FrameSpec& spec, const TileReader& read_tile,
                                        const std::string& path);

/// Writes a frame as write_frame() does, but to memory: FrameResult::image.
absl::StatusOr<FrameResult> encode_frame(const FrameSpec& spec, const TileReader& read_tile);

/// Returns the size of the frame's pixels in a file without compression.
std::int64_t raw_frame_bytes(const contract::RenderSettings& settings);

/// Returns about how much memory write_frame() takes.
std::int64_t write_memory_bytes(const contract::RenderSettings& settings);

/// Denoises a frame and returns the statistics that write_frame() would, except for digests and
/// what concerns the file. Requires settings.denoise. Errors: as write_frame(), except for files.
absl::StatusOr<FrameStatistics> measure_denoised(const FrameSpec& spec,
                                                 const TileReader& read_tile);

/// A point of the curve in a frames[] element of the report.
struct CurvePoint {
  double cpu_seconds = 0, wall_seconds = 0;
  std::int64_t samples = 0;
  double relmse = 0;
  std::optional<double> error;
  std::optional<TrueErrorStats> truth;  // against the job's reference
};

/// Returns the report's frames[] element as a JSON object (docs/reference/schema/report.json).
/// `file` is the name of the output, `status` is DONE for a fixed sample count, else a certainty's
/// name. Its member `true` is the true error at the curve's last point, without FLIP, which needs
/// the whole image. Its member `tiles` is null for more than 16,384 tiles.
std::string frame_entry_json(const FrameResult& result, const std::string& file,
                             const std::string& status, const std::vector<CurvePoint>& curve);

/// Returns the report's warnings about a frame, without its number: dropped samples, clamped
/// radiance, light removed by --max-depth, values clamped by --half, paths cut at the transparency
/// limit.
std::vector<std::string> frame_warnings(const FrameStatistics& statistics);

}  // namespace tessera::server
