#include "image/exr/exr_file.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfDoubleAttribute.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfIntAttribute.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <OpenEXR/ImfThreading.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <system_error>

#include "absl/strings/str_cat.h"

namespace tessera::image {
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

class Sink : public Imf::OStream {
 public:
  explicit Sink(const std::string& name) : OStream(name.c_str()) {}
  /// Returns 0 if all bytes were written, else an errno value. No writes may follow.
  virtual int finish() = 0;
};

/// Writes to a string.
class MemorySink final : public Sink {
 public:
  explicit MemorySink(std::string& bytes) : Sink("image"), bytes_(bytes) {}

  void write(const char bytes[], int count) override {
    const auto size = static_cast<std::size_t>(count);
    if (bytes_.size() < position_ + size) bytes_.resize(position_ + size);
    std::memcpy(&bytes_[position_], bytes, size);
    position_ += size;
  }
  std::uint64_t tellp() override { return position_; }
  void seekp(std::uint64_t position) override { position_ = position; }
  int finish() override { return 0; }

 private:
  std::string& bytes_;
  std::size_t position_ = 0;
};

/// Writes with stdio and records failures: OpenEXR completes a file in a destructor, where its own
/// errors are lost.
class FileSink final : public Sink {
 public:
  explicit FileSink(const std::string& path) : Sink(path), file_(std::fopen(path.c_str(), "wb")) {
    if (file_ == nullptr) fail();
  }
  ~FileSink() override { close(); }
  FileSink(const FileSink&) = delete;
  FileSink& operator=(const FileSink&) = delete;

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
  int finish() override {
    close();
    return error_;
  }

 private:
  void close() {
    if (file_ != nullptr && std::fclose(file_) != 0) fail();
    file_ = nullptr;
  }
  void fail() {
    if (error_ == 0) error_ = errno != 0 ? errno : EIO;
  }

  std::FILE* file_;
  int error_ = 0;
};

}  // namespace

class ExrWriter::File {
 public:
  File(std::unique_ptr<Sink> sink, const Imf::Header& header, int threads)
      : sink_(std::move(sink)),
        output_(std::make_unique<Imf::OutputFile>(*sink_, header, threads)) {}

  void write(const Imf::FrameBuffer& frame_buffer, int rows) {
    output_->setFrameBuffer(frame_buffer);
    output_->writePixels(rows);
  }
  int finish() {
    output_.reset();
    return sink_->finish();
  }
  std::string path() const { return sink_->fileName(); }

 private:
  std::unique_ptr<Sink> sink_;
  std::unique_ptr<Imf::OutputFile> output_;
};

ExrWriter::ExrWriter() = default;
ExrWriter::~ExrWriter() = default;

absl::StatusOr<std::unique_ptr<ExrWriter>> ExrWriter::open(const std::string& path,
                                                           const ExrHeader& header,
                                                           const std::vector<ExrPlane>& planes) {
  std::unique_ptr<ExrWriter> writer(new ExrWriter);
  absl::Status started = writer->start(path, header, planes);
  if (!started.ok()) return started;
  return writer;
}

absl::StatusOr<std::unique_ptr<ExrWriter>> ExrWriter::in_memory(
    const ExrHeader& header, const std::vector<ExrPlane>& planes) {
  return open("", header, planes);
}

/// `path`: empty to write to memory.
absl::Status ExrWriter::start(const std::string& path, const ExrHeader& header,
                              const std::vector<ExrPlane>& planes) {
  try {
    Imf::Header exr(box(header.display_window), box(header.data_window));
    exr.compression() = Imf::ZIP_COMPRESSION;
    for (const ExrPlane& plane : planes) {
      exr.channels().insert(plane.name, Imf::Channel(pixel_type(plane.type)));
    }
    for (const auto& [name, text] : header.texts) exr.insert(name, Imf::StringAttribute(text));
    for (const auto& [name, number] : header.numbers) exr.insert(name, Imf::IntAttribute(number));
    for (const auto& [name, real] : header.reals) exr.insert(name, Imf::DoubleAttribute(real));
    window_ = header.data_window;
    std::unique_ptr<Sink> sink;
    int threads = 0;
    if (path.empty()) {
      sink = std::make_unique<MemorySink>(bytes_);
    } else {
      sink = std::make_unique<FileSink>(path);
      threads = Imf::globalThreadCount();
    }
    file_ = std::make_unique<File>(std::move(sink), exr, threads);
    return absl::OkStatus();
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

void set_exr_threads(int count) {
  Imf::setGlobalThreadCount(count);
}

class ExrReader::File {
 public:
  explicit File(const std::string& path) : input(path.c_str(), 0) {}
  Imf::InputFile input;
};

ExrReader::ExrReader() = default;
ExrReader::~ExrReader() = default;

namespace {

contract::PixelRect rect(const Imath::Box2i& window) {
  return {window.min.x, window.min.y, window.max.x - window.min.x + 1,
          window.max.y - window.min.y + 1};
}

/// Whether sides and coordinates are within what a frame may have, so that they can be subtracted.
bool is_sane(const Imath::Box2i& window) {
  constexpr int kLimit = 65'536;
  return window.min.x >= 0 && window.min.y >= 0 && window.max.x >= window.min.x &&
         window.max.y >= window.min.y && window.max.x < kLimit && window.max.y < kLimit;
}

void read_attributes(const Imf::Header& from, ExrHeader& header) {
  header.data_window = rect(from.dataWindow());
  header.display_window = rect(from.displayWindow());
  for (auto it = from.begin(); it != from.end(); ++it) {
    const std::string name = it.name();
    if (name.rfind("tessera:", 0) != 0) continue;
    if (const auto* text = dynamic_cast<const Imf::StringAttribute*>(&it.attribute())) {
      header.texts.emplace_back(name, text->value());
    } else if (const auto* number = dynamic_cast<const Imf::IntAttribute*>(&it.attribute())) {
      header.numbers.emplace_back(name, number->value());
    } else if (const auto* real = dynamic_cast<const Imf::DoubleAttribute*>(&it.attribute())) {
      header.reals.emplace_back(name, real->value());
    }
  }
}

}  // namespace

absl::StatusOr<std::unique_ptr<ExrReader>> ExrReader::open(const std::string& path) {
  if (::access(path.c_str(), R_OK) != 0) {
    return absl::NotFoundError(absl::StrCat(path, ": ", std::strerror(errno)));
  }
  try {
    std::unique_ptr<ExrReader> reader(new ExrReader);
    reader->path_ = path;
    reader->file_ = std::make_unique<File>(path);
    const Imf::Header& header = reader->file_->input.header();
    if (!is_sane(header.dataWindow()) || !is_sane(header.displayWindow())) {
      return absl::InvalidArgumentError(absl::StrCat(
          path, ": the data or display window is not within 0 to 65,535; render it with tessera"));
    }
    read_attributes(header, reader->header_);
    const Imf::ChannelList& channels = header.channels();
    for (auto it = channels.begin(); it != channels.end(); ++it) {
      const Imf::Channel& channel = it.channel();
      if (channel.xSampling != 1 || channel.ySampling != 1) {
        return absl::InvalidArgumentError(absl::StrCat(
            path, ": channel ", it.name(), " has fewer samples than the image has pixels"));
      }
      const ExrType type = channel.type == Imf::HALF   ? ExrType::half
                           : channel.type == Imf::UINT ? ExrType::uint32
                                                       : ExrType::float32;
      reader->planes_.push_back({it.name(), type, {}, {}});
    }
    return reader;
  } catch (const std::exception& error) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": ", error.what()));
  }
}

absl::Status ExrReader::read_rows(std::int32_t rows, std::vector<ExrPlane>& planes) {
  const contract::PixelRect& window = header_.data_window;
  const Imath::Box2i band = box({window.x, window.y + rows_read_, window.width, rows});
  const std::size_t pixels =
      static_cast<std::size_t>(rows) * static_cast<std::size_t>(window.width);
  Imf::FrameBuffer frame_buffer;
  for (ExrPlane& plane : planes) {
    const bool whole = plane.type == ExrType::uint32;
    if (whole) {
      plane.words.resize(pixels);
    } else {
      plane.values.resize(pixels);
    }
    void* data = whole ? static_cast<void*>(plane.words.data()) : plane.values.data();
    frame_buffer.insert(plane.name, Imf::Slice::Make(whole ? Imf::UINT : Imf::FLOAT, data, band, 4,
                                                     4 * static_cast<std::size_t>(window.width)));
  }
  try {
    file_->input.setFrameBuffer(frame_buffer);
    file_->input.readPixels(band.min.y, band.max.y);
  } catch (const std::exception& error) {
    return absl::InvalidArgumentError(absl::StrCat(path_, ": ", error.what()));
  }
  rows_read_ += rows;
  return absl::OkStatus();
}

}  // namespace tessera::image
