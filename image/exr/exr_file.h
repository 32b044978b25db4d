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

namespace tessera::image {

enum class ExrType : std::uint8_t { half, float32, uint32 };

/// One channel of a band of scanlines: `words` or `values`, row-major over the band.
struct ExrPlane {
  std::string name;
  ExrType type = ExrType::float32;
  std::vector<float> values;         // half and float32
  std::vector<std::uint32_t> words;  // uint32
};

/// Attributes of the file.
struct ExrHeader {
  contract::PixelRect data_window, display_window;
  std::vector<std::pair<std::string, std::string>> texts;  // attributes
  std::vector<std::pair<std::string, int>> numbers;
  std::vector<std::pair<std::string, double>> reals;
};

/// Writes an OpenEXR file: one part, scanlines from the top, ZIP. The file contains only what is
/// given (no date, no host), so equal input gives equal bytes. Uses OpenEXR directly because
/// OpenImageIO writes the time of day into every file.
class ExrWriter {
 public:
  /// Creates or truncates `path`. The planes' names and types are the file's channels.
  ///
  /// Errors: Unavailable, with the reason.
  static absl::StatusOr<std::unique_ptr<ExrWriter>> open(const std::string& path,
                                                         const ExrHeader& header,
                                                         const std::vector<ExrPlane>& planes);
  /// Writes to memory; take_bytes() returns the file.
  static absl::StatusOr<std::unique_ptr<ExrWriter>> in_memory(const ExrHeader& header,
                                                              const std::vector<ExrPlane>& planes);
  ~ExrWriter();
  ExrWriter(const ExrWriter&) = delete;
  ExrWriter& operator=(const ExrWriter&) = delete;

  /// Writes the next `rows` rows. Requires planes as given to open(), with at least that many.
  /// Values of half planes are clamped to ±65504. Errors: Unavailable.
  absl::Status write_rows(std::int32_t rows, const std::vector<ExrPlane>& planes);
  /// Number of values clamped to ±65504 so far.
  std::int64_t half_overflow_count() const { return half_overflow_count_; }
  /// Completes the file. Errors: Unavailable, not all bytes could be written.
  absl::Status close();
  /// Returns the file of in_memory(). Requires: closed.
  std::string take_bytes() { return std::move(bytes_); }

 private:
  class File;
  ExrWriter();
  absl::Status start(const std::string& path, const ExrHeader& header,
                     const std::vector<ExrPlane>& planes);
  /// Converts the first `count` values to half floats, clamped to ±65504, and counts clamped ones.
  void convert(const std::vector<float>& values, std::vector<std::uint16_t>& bits,
               std::size_t count);

  contract::PixelRect window_;
  std::int32_t rows_written_ = 0;
  std::int64_t half_overflow_count_ = 0;
  std::string bytes_;  // of in_memory(); written by file_
  std::unique_ptr<File> file_;
};

/// Has all ExrWriters of files share `count` threads to compress scanlines. The default is none:
/// each compresses on its own thread. The bytes of files do not depend on it.
void set_exr_threads(int count);

/// Reads an OpenEXR file of scanlines in bands.
class ExrReader {
 public:
  /// Opens a file whose channels all have full resolution.
  ///
  /// Errors: NotFound, no such file; InvalidArgument, it is not such a file, or a side exceeds
  /// 65,536 pixels (the messages say why).
  static absl::StatusOr<std::unique_ptr<ExrReader>> open(const std::string& path);
  ~ExrReader();
  ExrReader(const ExrReader&) = delete;
  ExrReader& operator=(const ExrReader&) = delete;

  /// Windows, and the attributes whose names begin with "tessera:".
  const ExrHeader& header() const { return header_; }
  /// The channels in alphabetical order, without pixels.
  const std::vector<ExrPlane>& planes() const { return planes_; }
  /// Reads the next `rows` rows into `planes`, which has the names and types of planes(), in any
  /// order and number; resizes their pixels. Errors: InvalidArgument, damaged.
  absl::Status read_rows(std::int32_t rows, std::vector<ExrPlane>& planes);

 private:
  class File;
  ExrReader();

  std::string path_;
  ExrHeader header_;
  std::vector<ExrPlane> planes_;
  std::int32_t rows_read_ = 0;
  std::unique_ptr<File> file_;
};

}  // namespace tessera::image
