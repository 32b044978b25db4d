/// Decoder of OpenEXR files in memory.

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfInputFile.h>

#include <array>
#include <cstring>
#include <exception>
#include <stdexcept>

#include "absl/strings/str_cat.h"
#include "image/codecs/formats.h"

namespace tessera::image {
namespace {

class MemoryStream final : public Imf::IStream {
 public:
  explicit MemoryStream(std::span<const std::byte> file) : IStream("memory"), file_(file) {}

  bool isMemoryMapped() const override { return true; }
  char* readMemoryMapped(int count) override {
    const std::span<const std::byte> bytes = take(count);
    return const_cast<char*>(reinterpret_cast<const char*>(bytes.data()));
  }
  bool read(char to[], int count) override {
    const std::span<const std::byte> bytes = take(count);
    std::memcpy(to, bytes.data(), bytes.size());
    return position_ < file_.size();
  }
  std::uint64_t tellg() override { return position_; }
  void seekg(std::uint64_t position) override { position_ = position; }

 private:
  std::span<const std::byte> take(int count) {
    const auto size = static_cast<std::uint64_t>(count);
    if (count < 0 || position_ > file_.size() || size > file_.size() - position_) {
      throw std::runtime_error("unexpected end of file");
    }
    const auto bytes = file_.subspan(position_, size);
    position_ += size;
    return bytes;
  }

  std::span<const std::byte> file_;
  std::uint64_t position_ = 0;
};

/// Names of the channels for R, G, B and, if present, A. Errors: InvalidArgument.
absl::StatusOr<std::vector<const char*>> channels_of(const Imf::ChannelList& list) {
  std::vector<const char*> names = {"R", "G", "B"};
  if (list.findChannel("R") == nullptr && list.findChannel("Y") != nullptr &&
      list.findChannel("RY") == nullptr) {
    names = {"Y", "Y", "Y"};
  }
  if (list.findChannel("A") != nullptr) names.push_back("A");
  for (const char* name : names) {
    const Imf::Channel* channel = list.findChannel(name);
    if (channel == nullptr) {
      return absl::InvalidArgumentError(absl::StrCat("the image has no channel ", name));
    }
    if (channel->xSampling != 1 || channel->ySampling != 1) {
      return absl::InvalidArgumentError(
          absl::StrCat("channel ", name, " has fewer samples than the image has pixels"));
    }
  }
  return names;
}

absl::StatusOr<Pixels> decode_file(std::span<const std::byte> bytes, const PixelLimits& limits) {
  MemoryStream stream(bytes);
  Imf::InputFile file(stream, 0);  // 0 threads: the caller has its own
  const Imath::Box2i& window = file.header().dataWindow();
  const auto names = channels_of(file.header().channels());
  if (!names.ok()) return names.status();
  Pixels image;
  image.width = std::int64_t{window.max.x} - window.min.x + 1;
  image.height = std::int64_t{window.max.y} - window.min.y + 1;
  image.channels = static_cast<int>(names->size());
  absl::Status fits = check_size(image.width, image.height, image.channels, sizeof(float), limits);
  if (!fits.ok()) return fits;
  const std::size_t channels = names->size(), stride = channels * sizeof(float);
  image.f32.resize(static_cast<std::size_t>(image.width * image.height) * channels);
  Imf::FrameBuffer frame;
  for (std::size_t c = 0; c < channels; ++c) {
    // One slice per name: grey is read once and copied.
    if (c > 0 && (*names)[c] == (*names)[c - 1]) continue;
    frame.insert((*names)[c], Imf::Slice::Make(Imf::FLOAT, image.f32.data() + c, window, stride,
                                               stride * static_cast<std::size_t>(image.width)));
  }
  file.setFrameBuffer(frame);
  file.readPixels(window.min.y, window.max.y);
  if ((*names)[0] == (*names)[1]) {
    for (std::size_t i = 0; i < image.f32.size(); i += channels) {
      image.f32[i + 1] = image.f32[i + 2] = image.f32[i];
    }
  }
  return image;
}

}  // namespace

absl::StatusOr<Pixels> decode_exr(std::span<const std::byte> file, const PixelLimits& limits) {
  try {
    return decode_file(file, limits);
  } catch (const std::exception& e) {
    return damaged(e.what());
  }
}

}  // namespace tessera::image
