#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "contract/render_settings.h"

namespace tessera::server {

enum class ExrType : std::uint8_t { half, float32, uint32 };

/// One channel of a band of scanlines: `words` or `values`, row-major over the band.
struct ExrPlane {
  std::string name;
  ExrType type = ExrType::float32;
  std::vector<float> values;         // half and float32
  std::vector<std::uint32_t> words;  // uint32
};

/// What the file says besides its pixels.
struct ExrHeader {
  contract::PixelRect data_window, display_window;
  std::vector<std::pair<std::string, std::string>> texts;  // attributes
  std::vector<std::pair<std::string, int>> numbers;
};

/// An OpenEXR file being written: one part, scanlines from the top, ZIP. Only what is given goes
/// into it (no date, no host), so equal input gives equal bytes. OpenEXR is used here directly,
/// as OpenImageIO puts the time of day into every file.
class ExrWriter {
 public:
  /// Creates or truncates `path`. The planes' names and types are the file's channels.
  ///
  /// Errors: Unavailable, with the reason.
  static absl::StatusOr<std::unique_ptr<ExrWriter>> open(const std::string& path,
                                                         const ExrHeader& header,
                                                         const std::vector<ExrPlane>& planes);
  ~ExrWriter();
  ExrWriter(const ExrWriter&) = delete;
  ExrWriter& operator=(const ExrWriter&) = delete;

  /// Writes the next `rows` rows. Requires planes as given to open(), with at least that many.
  /// Values of half planes beyond ±65504 are held there. Errors: Unavailable.
  absl::Status write_rows(std::int32_t rows, const std::vector<ExrPlane>& planes);
  /// Values held at ±65504 so far.
  std::int64_t half_overflow_count() const { return half_overflow_count_; }
  /// Completes the file. Errors: Unavailable, some byte could not be written.
  absl::Status close();

 private:
  class File;
  ExrWriter();
  /// The first `count` values as half floats, those beyond ±65504 held there and counted.
  void convert(const std::vector<float>& values, std::vector<std::uint16_t>& bits,
               std::size_t count);

  contract::PixelRect window_;
  std::int32_t rows_written_ = 0;
  std::int64_t half_overflow_count_ = 0;
  std::unique_ptr<File> file_;
};

}  // namespace tessera::server
