#include "server/film/exr_file.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfIntAttribute.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStringAttribute.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <system_error>

#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

constexpr float kMaxHalf = 65504;

absl::Status failure(const std::string& path, int error) {
  const std::string message = absl::StrCat(path, ": ", std::strerror(error));
  return error == ENOSPC || error == EDQUOT ? absl::ResourceExhaustedError(message)
                                            : absl::UnavailableError(message);
}

absl::Status failure(const std::string& path, const std::exception& error) {
  const auto* system = dynamic_cast<const std::system_error*>(&error);  // the Sink's
  return system != nullptr ? failure(path, system->code().value())
                           : absl::UnavailableError(absl::StrCat(path, ": ", error.what()));
}

Imath::Box2i box(const contract::PixelRect& rect) {
  return {{rect.x, rect.y}, {rect.x + rect.width - 1, rect.y + rect.height - 1}};
}

Imf::PixelType pixel_type(ExrType type) {
  switch (type) {
    case ExrType::half:
      return Imf::HALF;
    case ExrType::float32:
      return Imf::FLOAT;
    case ExrType::uint32:
      return Imf::UINT;
  }
  return Imf::FLOAT;
}

/// Writes with stdio and records failures: OpenEXR completes a file in a destructor, where its own
/// errors are lost.
class Sink : public Imf::OStream {
 public:
  explicit Sink(const std::string& path)
      : OStream(path.c_str()), file_(std::fopen(path.c_str(), "wb")) {
    if (file_ == nullptr) fail();
  }
  ~Sink() override { finish(); }
  Sink(const Sink&) = delete;
  Sink& operator=(const Sink&) = delete;

  void write(const char bytes[], int count) override {
    const auto size = static_cast<std::size_t>(count);
    if (file_ == nullptr || std::fwrite(bytes, 1, size, file_) != size) {
      fail();
      throw std::system_error(error_, std::generic_category());
    }
  }
  std::uint64_t tellp() override {
    return file_ == nullptr ? 0 : static_cast<std::uint64_t>(std::ftell(file_));
  }
  void seekp(std::uint64_t position) override {
    if (file_ == nullptr || std::fseek(file_, static_cast<long>(position), SEEK_SET) != 0) {
      fail();
      throw std::system_error(error_, std::generic_category());
    }
  }
  /// Returns 0 if all bytes were written, else an errno value. No writes may follow.
  int finish() {
    if (file_ != nullptr && std::fclose(file_) != 0) fail();
    file_ = nullptr;
    return error_;
  }

 private:
  void fail() {
    if (error_ == 0) error_ = errno != 0 ? errno : EIO;
  }

  std::FILE* file_;
  int error_ = 0;
};

}  // namespace

class ExrWriter::File {
 public:
  File(const std::string& path, const Imf::Header& header)
      : path_(path), sink_(path), output_(std::make_unique<Imf::OutputFile>(sink_, header, 0)) {}

  void write(const Imf::FrameBuffer& frame_buffer, int rows) {
    output_->setFrameBuffer(frame_buffer);
    output_->writePixels(rows);
  }
  int finish() {
    output_.reset();
    return sink_.finish();
  }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  Sink sink_;
  std::unique_ptr<Imf::OutputFile> output_;
};

ExrWriter::ExrWriter() = default;
ExrWriter::~ExrWriter() = default;

absl::StatusOr<std::unique_ptr<ExrWriter>> ExrWriter::open(const std::string& path,
                                                           const ExrHeader& header,
                                                           const std::vector<ExrPlane>& planes) {
  try {
    Imf::Header exr(box(header.display_window), box(header.data_window));
    exr.compression() = Imf::ZIP_COMPRESSION;
    for (const ExrPlane& plane : planes) {
      exr.channels().insert(plane.name, Imf::Channel(pixel_type(plane.type)));
    }
    for (const auto& [name, text] : header.texts) exr.insert(name, Imf::StringAttribute(text));
    for (const auto& [name, number] : header.numbers) exr.insert(name, Imf::IntAttribute(number));
    std::unique_ptr<ExrWriter> writer(new ExrWriter);
    writer->window_ = header.data_window;
    writer->file_ = std::make_unique<File>(path, exr);
    return writer;
  } catch (const std::exception& error) {
    return failure(path, error);
  }
}

void ExrWriter::convert(const std::vector<float>& values, std::vector<std::uint16_t>& bits,
                        std::size_t count) {
  bits.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    float value = values[i];
    if (value > kMaxHalf || value < -kMaxHalf) {
      value = value > 0 ? kMaxHalf : -kMaxHalf;
      ++half_overflow_count_;
    }
    bits[i] = Imath::half(value).bits();
  }
}

absl::Status ExrWriter::write_rows(std::int32_t rows, const std::vector<ExrPlane>& planes) {
  const Imath::Box2i band = box({window_.x, window_.y + rows_written_, window_.width, rows});
  const auto slice = [&band, this](Imf::PixelType type, const void* data, std::size_t size) {
    return Imf::Slice::Make(type, data, band, size, size * static_cast<std::size_t>(window_.width));
  };
  std::vector<std::vector<std::uint16_t>> halves(planes.size());
  Imf::FrameBuffer frame_buffer;
  for (std::size_t i = 0; i < planes.size(); ++i) {
    const ExrPlane& plane = planes[i];
    if (plane.type == ExrType::uint32) {
      frame_buffer.insert(plane.name, slice(Imf::UINT, plane.words.data(), 4));
    } else if (plane.type == ExrType::float32) {
      frame_buffer.insert(plane.name, slice(Imf::FLOAT, plane.values.data(), 4));
    } else {
      convert(plane.values, halves[i],
              static_cast<std::size_t>(rows) * static_cast<std::size_t>(window_.width));
      frame_buffer.insert(plane.name, slice(Imf::HALF, halves[i].data(), 2));
    }
  }
  try {
    file_->write(frame_buffer, rows);
  } catch (const std::exception& error) {
    return failure(file_->path(), error);
  }
  rows_written_ += rows;
  return absl::OkStatus();
}

absl::Status ExrWriter::close() {
  const int error = file_->finish();
  return error == 0 ? absl::OkStatus() : failure(file_->path(), error);
}

}  // namespace tessera::server
