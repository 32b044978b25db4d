#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>
#include <webp/encode.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>
#include <string>

#include "image/codecs/image_codec.h"
#include "worker/gltf/decode/image_decoder.h"

namespace tessera::render {
namespace {

/// `pixels` written by OpenImageIO as `format` ("png", "jpeg", ...), in memory.
template <typename T>
std::vector<std::byte> encode(const char* format, int width, int height, int channels,
                              const std::vector<T>& pixels,
                              const OIIO::ParamValueList& extra = {}) {
  OIIO::attribute("threads", 1);  // ThreadSanitizer cannot see into the library's pool
  const OIIO::TypeDesc type = OIIO::BaseTypeFromC<T>::value;
  OIIO::ImageSpec spec(width, height, channels, type);
  if (channels == 2) {
    spec.channelnames = {"Y", "A"};
    spec.alpha_channel = 1;
  }
  for (const auto& p : extra) spec.extra_attribs.add_or_replace(p);
  spec["oiio:UnassociatedAlpha"] = 1;
  std::vector<unsigned char> bytes;
  OIIO::Filesystem::IOVecOutput file(bytes);
  const auto out = OIIO::ImageOutput::create(format);
  EXPECT_TRUE(out != nullptr && out->set_ioproxy(&file) && out->open("memory", spec) &&
              out->write_image(type, pixels.data()) && out->close())
      << format << ": " << (out ? out->geterror() : "no writer");
  std::vector<std::byte> copy(bytes.size());
  std::memcpy(copy.data(), bytes.data(), bytes.size());
  return copy;
}

Image decoded(const std::vector<std::byte>& file) {
  auto image = decode_image(file, "test");
  EXPECT_TRUE(image.ok()) << image.status();
  return image.ok() ? *std::move(image) : Image();
}

using Codes = std::vector<std::uint8_t>;

TEST(Images, PngKeepsCodesAndAlpha) {
  // Colour under alpha 0 and 1 must be kept; premultiplying would lose it.
  const Codes rgba = {200, 100, 50, 0, 255, 1, 2, 1, 10, 20, 30, 128, 255, 255, 255, 255};
  const Image image = decoded(encode("png", 2, 2, 4, rgba));
  EXPECT_EQ(image.storage, Image::Storage::u8);
  EXPECT_EQ(image.width, 2);
  EXPECT_EQ(image.height, 2);
  EXPECT_EQ(image.channels, 4);
  EXPECT_EQ(image.u8, rgba);
}

TEST(Images, GreyPngBecomesRgb) {
  const Image grey = decoded(encode("png", 2, 1, 1, Codes{7, 200}));
  EXPECT_EQ(grey.channels, 3);
  EXPECT_EQ(grey.u8, (Codes{7, 7, 7, 200, 200, 200}));
  const Image alpha = decoded(encode("png", 2, 1, 2, Codes{7, 9, 200, 0}));
  EXPECT_EQ(alpha.channels, 4);
  EXPECT_EQ(alpha.u8, (Codes{7, 7, 7, 9, 200, 200, 200, 0}));
}

TEST(Images, SixteenBitPngKeepsPrecision) {
  const std::vector<std::uint16_t> codes = {0, 1, 65535, 256, 32768, 12345};
  const Image image = decoded(encode("png", 2, 1, 3, codes));
  EXPECT_EQ(image.storage, Image::Storage::u16);
  EXPECT_EQ(image.u16, codes);
}

void append_big_endian(std::vector<std::byte>& out, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8)
    out.push_back(static_cast<std::byte>(value >> shift));
}

/// A PNG chunk; its check sum is CRC-32.
void append_chunk(std::vector<std::byte>& out, const std::string& type, const Codes& data) {
  append_big_endian(out, static_cast<std::uint32_t>(data.size()));
  std::uint32_t crc = 0xffffffff;
  const auto put = [&](std::uint8_t code) {
    out.push_back(static_cast<std::byte>(code));
    crc ^= code;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1) != 0 ? 0xedb88320u : 0u);
  };
  for (const char c : type) put(static_cast<std::uint8_t>(c));
  for (const std::uint8_t code : data) put(code);
  append_big_endian(out, ~crc);
}

struct Chunk {
  std::string type;
  Codes data;
};

/// A one-row PNG of a kind that OpenImageIO does not write: `row` as stored, after `chunks`.
std::vector<std::byte> png_row(std::uint8_t width, std::uint8_t depth, std::uint8_t color_type,
                               const std::vector<Chunk>& chunks, const Codes& row) {
  std::vector<std::byte> out;
  append_big_endian(out, 0x89504e47);
  append_big_endian(out, 0x0d0a1a0a);
  append_chunk(out, "IHDR", {0, 0, 0, width, 0, 0, 0, 1, depth, color_type, 0, 0, 0});
  for (const Chunk& chunk : chunks) append_chunk(out, chunk.type, chunk.data);
  // zlib: one stored block of the filter type and the row, then Adler-32.
  Codes data = {0};
  data.insert(data.end(), row.begin(), row.end());
  const auto length = static_cast<std::uint8_t>(data.size());
  Codes stream = {0x78, 0x01, 1, length, 0, static_cast<std::uint8_t>(~length), 0xff};
  std::uint32_t a = 1, b = 0;
  for (const std::uint8_t code : data) {
    stream.push_back(code);
    a += code;
    b += a;
  }
  for (const std::uint32_t sum : {b >> 8, b, a >> 8, a}) {
    stream.push_back(static_cast<std::uint8_t>(sum));
  }
  append_chunk(out, "IDAT", stream);
  append_chunk(out, "IEND", {});
  return out;
}

TEST(Images, PaletteAlphaComesFromTrns) {
  const Chunk palette{"PLTE", {10, 20, 30, 200, 100, 50, 1, 2, 3}};
  const Image image = decoded(png_row(4, 8, 3, {palette, {"tRNS", {0, 128}}}, {1, 0, 2, 1}));
  EXPECT_EQ(image.channels, 4);
  EXPECT_EQ(image.u8, (Codes{200, 100, 50, 128, 10, 20, 30, 0, 1, 2, 3, 255, 200, 100, 50, 128}));
  const Image opaque = decoded(png_row(2, 8, 3, {palette}, {2, 1}));
  EXPECT_EQ(opaque.channels, 3);
  EXPECT_EQ(opaque.u8, (Codes{1, 2, 3, 200, 100, 50}));
}

TEST(Images, LowBitDepthsExpandToEight) {
  EXPECT_EQ(decoded(png_row(4, 1, 0, {}, {0b10100000})).u8,
            (Codes{255, 255, 255, 0, 0, 0, 255, 255, 255, 0, 0, 0}));
  EXPECT_EQ(decoded(png_row(2, 4, 0, {}, {0x3f})).u8, (Codes{51, 51, 51, 255, 255, 255}));
}

TEST(Images, SixteenBitGreyAlphaKeepsBoth) {
  const Image image = decoded(png_row(2, 16, 4, {}, {0x12, 0x34, 0xff, 0xff, 0, 1, 0x80, 0}));
  EXPECT_EQ(image.channels, 4);
  const std::vector<std::uint16_t> want = {0x1234, 0x1234, 0x1234, 0xffff, 1, 1, 1, 0x8000};
  EXPECT_EQ(image.u16, want);
}

TEST(Images, ColourProfilesAreIgnored) {
  // glTF: colour spaces, gamma and ICC profiles inside images are ignored.
  const Codes codes = {3, 99, 180, 255, 128, 7};
  const std::vector<Chunk> metadata = {{"gAMA", {0, 1, 0x86, 0xa0}},  // 1.0
                                       {"gAMA", {0, 0, 0x27, 0x10}},  // 0.1
                                       {"sRGB", {0}}};
  for (const Chunk& chunk : metadata) {
    EXPECT_EQ(decoded(png_row(2, 8, 2, {chunk}, codes)).u8, codes) << chunk.type;
  }
}

TEST(Images, JpegOrientationIsIgnored) {
  // Left black, right white: rotated by the orientation, the image would be taller than wide.
  Codes halves;
  for (int y = 0; y < 8; ++y) {
    for (int x = 0; x < 16; ++x) halves.insert(halves.end(), 3, x < 8 ? 0 : 255);
  }
  const Image plain = decoded(encode("jpeg", 16, 8, 3, halves));
  OIIO::ParamValueList metadata;
  metadata.attribute("Orientation", 6);
  metadata.attribute("jpeg:progressive", 1);
  const auto file = encode("jpeg", 16, 8, 3, halves, metadata);
  const auto contains = [&](std::uint8_t marker) {
    const std::array<std::byte, 2> sought = {std::byte{0xff}, static_cast<std::byte>(marker)};
    return std::search(file.begin(), file.end(), sought.begin(), sought.end()) != file.end();
  };
  EXPECT_TRUE(contains(0xc2)) << "progressive";
  EXPECT_TRUE(contains(0xe1)) << "Exif";
  const Image image = decoded(file);
  EXPECT_EQ(image.width, 16);
  EXPECT_EQ(image.height, 8);
  EXPECT_EQ(image.u8, plain.u8);
}

TEST(Images, JpegIsCloseAndLosslessWebpExact) {
  const Codes flat(16 * 16 * 3, 120);
  const Image jpeg = decoded(encode("jpeg", 16, 16, 3, flat));
  ASSERT_EQ(jpeg.u8.size(), flat.size());
  for (const std::uint8_t code : jpeg.u8) EXPECT_NEAR(code, 120, 2);
  const Image webp = decoded(encode("webp", 16, 16, 3, flat));
  ASSERT_EQ(webp.u8.size() / static_cast<std::size_t>(webp.channels), 256u);
  EXPECT_NEAR(webp.u8[0], 120, 3);
}

/// Bits of a JPEG scan; after each 0xff comes a zero.
class ScanBits {
 public:
  void put(unsigned value, int count) {
    for (int bit = count - 1; bit >= 0; --bit) {
      byte_ = byte_ << 1 | (value >> bit & 1);
      if (++filled_ == 8) flush();
    }
  }
  /// The rest of the last byte is ones.
  Codes finish() {
    while (filled_ != 0) put(1, 1);
    return bytes_;
  }

 private:
  void flush() {
    bytes_.push_back(static_cast<std::uint8_t>(byte_));
    if (byte_ == 0xff) bytes_.push_back(0);
    byte_ = 0;
    filled_ = 0;
  }

  Codes bytes_;
  unsigned byte_ = 0;
  int filled_ = 0;
};

void append_segment(std::vector<std::byte>& out, std::uint8_t marker, const Codes& content) {
  const auto length = static_cast<std::uint8_t>(content.size() + 2);
  for (const std::uint8_t code : {std::uint8_t{0xff}, marker, std::uint8_t{0}, length}) {
    out.push_back(static_cast<std::byte>(code));
  }
  for (const std::uint8_t code : content) out.push_back(static_cast<std::byte>(code));
}

/// A baseline CMYK or YCCK JPEG, which OpenImageIO does not write: 8 x 8 pixels, four components,
/// each constant. `adobe`: transform of the Adobe marker (0: CMYK, 2: YCCK); -1: no marker.
std::vector<std::byte> four_component_jpeg(const std::array<int, 4>& values, int adobe) {
  std::vector<std::byte> out = {std::byte{0xff}, std::byte{0xd8}};
  if (adobe >= 0) {
    append_segment(out, 0xee,
                   {'A', 'd', 'o', 'b', 'e', 0, 100, 0, 0, 0, 0, static_cast<std::uint8_t>(adobe)});
  }
  Codes quantisation(65, 8);  // 8 times a coefficient of order 0 adds that to every pixel
  quantisation[0] = 0;
  append_segment(out, 0xdb, quantisation);
  Codes frame = {8, 0, 8, 0, 8, 4}, scan = {4};
  for (std::uint8_t component = 1; component <= 4; ++component) {
    frame.insert(frame.end(), {component, 0x11, 0});
    scan.insert(scan.end(), {component, 0});
  }
  scan.insert(scan.end(), {0, 63, 0});
  append_segment(out, 0xc0, frame);
  // Sizes 0 to 8 of order 0 are their own codes of four bits; for the others: end of block is 0.
  append_segment(out, 0xc4,
                 {0x00, 0, 0, 0, 9, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8});
  append_segment(out, 0xc4, {0x10, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0});
  append_segment(out, 0xda, scan);
  ScanBits bits;
  for (const int value : values) {
    const int coefficient = value - 128;
    int size = 0;
    while (std::abs(coefficient) >> size != 0) ++size;
    bits.put(static_cast<unsigned>(size), 4);
    bits.put(static_cast<unsigned>(coefficient < 0 ? coefficient + (1 << size) - 1 : coefficient),
             size);
    bits.put(0, 1);
  }
  for (const std::uint8_t code : bits.finish()) out.push_back(static_cast<std::byte>(code));
  out.insert(out.end(), {std::byte{0xff}, std::byte{0xd9}});
  return out;
}

TEST(Images, CmykJpegIsConvertedToRgb) {
  // Files store the fraction of light that each ink transmits, 255 for no ink (Adobe's convention,
  // which readers assume without the marker, too): a colour is its own ink's fraction times
  // black's.
  for (const int adobe : {0, -1}) {
    for (const std::array<int, 4>& stored : {std::array<int, 4>{255, 255, 255, 255},
                                             {200, 100, 50, 255},
                                             {200, 100, 50, 128},
                                             {255, 0, 17, 254},
                                             {255, 255, 255, 0},
                                             {1, 127, 129, 64}}) {
      const Image image = decoded(four_component_jpeg(stored, adobe));
      ASSERT_EQ(image.channels, 3);
      ASSERT_EQ(image.u8.size(), 3u * 64);
      for (std::size_t i = 0; i < image.u8.size(); ++i) {
        ASSERT_NEAR(image.u8[i], stored[i % 3] * stored[3] / 255.0, 0.5) << adobe << ", " << i % 3;
      }
    }
  }
}

TEST(Images, YcckJpegIsConvertedToRgb) {
  // Y, Cb, Cr give the inverted fractions of the inks by JFIF's formulas; black is stored as it is.
  const int y = 90, cb = 140, cr = 110, black = 200;
  const double r = y + 1.402 * (cr - 128), b = y + 1.772 * (cb - 128);
  const double g = y - 0.344136 * (cb - 128) - 0.714136 * (cr - 128);
  const Image image = decoded(four_component_jpeg({y, cb, cr, black}, 2));
  ASSERT_EQ(image.u8.size(), 3u * 64);
  const double want[] = {255 - r, 255 - g, 255 - b};
  for (std::size_t k = 0; k < 3; ++k) {
    // Rounded once to a code, then once more after black.
    EXPECT_NEAR(image.u8[k], want[k] * black / 255, 0.5 + 0.5 * black / 255) << k;
  }
}

TEST(Images, LosslessWebpKeepsColourUnderAlpha) {
  const Codes rgba = {200, 100, 50, 1, 255, 1, 2, 64, 10, 20, 30, 128, 255, 255, 255, 255};
  std::uint8_t* written = nullptr;
  const std::size_t size = WebPEncodeLosslessRGBA(rgba.data(), 2, 2, 8, &written);
  const auto bytes = std::as_bytes(std::span(written, size));
  const Image image = decoded({bytes.begin(), bytes.end()});
  WebPFree(written);
  EXPECT_EQ(image.channels, 4);
  EXPECT_EQ(image.u8, rgba);
}

TEST(Images, ExrKeepsFloatsAboveOne) {
  const std::vector<float> pixels = {0, 0.5f, 1000, 1e-3f, 2, 3};
  const auto file = encode("openexr", 2, 1, 3, pixels);
  EXPECT_EQ(image::image_format(file), image::ImageFormat::exr);
  EXPECT_EQ(decoded(file).f32, pixels);
  const auto sky = decode_environment(file, "sky");
  ASSERT_TRUE(sky.ok()) << sky.status();
  EXPECT_EQ(sky->f32, pixels);
  EXPECT_EQ(sky->channels, 3);
}

TEST(Images, GreyExrBecomesRgb) {
  const Image image = decoded(encode("openexr", 2, 1, 1, std::vector<float>{0.25f, 3}));
  EXPECT_EQ(image.channels, 3);
  EXPECT_EQ(image.f32, (std::vector<float>{0.25f, 0.25f, 0.25f, 3, 3, 3}));
}

TEST(Images, RadianceHdrIsDecodedExactly) {
  const std::vector<float> pixels = {1, 0.5f, 0.25f, 100, 50, 25, 0, 0, 0, 1024, 512, 256};
  const auto file = encode("hdr", 4, 1, 3, pixels);
  EXPECT_EQ(image::image_format(file), image::ImageFormat::hdr);
  const auto sky = decode_environment(file, "sky");
  ASSERT_TRUE(sky.ok()) << sky.status();
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    EXPECT_NEAR(sky->f32[i], pixels[i], pixels[i] / 128) << i;  // 8-bit mantissa
  }
}

/// A Radiance file: signature, `header` lines, resolution and pixels as stored.
absl::StatusOr<Image> radiance(const std::string& header, const std::string& resolution,
                               const std::string& pixels) {
  const std::string file = "#?RADIANCE\n" + header + "\n" + resolution + "\n" + pixels;
  return decode_environment(std::as_bytes(std::span(file)), "sky");
}

/// A grey pixel of the given value, which must be below 128.
std::string grey(int value) {
  const char v = static_cast<char>(value);
  return {v, v, v, static_cast<char>(136)};
}

TEST(Radiance, AllEightOrientationsAreUpright) {
  // The picture 3 x 2 of greys 10 11 12 / 20 21 22, as each orientation stores it.
  struct Order {
    const char* resolution;
    std::vector<int> stored;
  };
  for (const Order& order :
       {Order{"-Y 2 +X 3", {10, 11, 12, 20, 21, 22}}, Order{"-Y 2 -X 3", {12, 11, 10, 22, 21, 20}},
        Order{"+Y 2 +X 3", {20, 21, 22, 10, 11, 12}}, Order{"+Y 2 -X 3", {22, 21, 20, 12, 11, 10}},
        Order{"+X 3 -Y 2", {10, 20, 11, 21, 12, 22}}, Order{"+X 3 +Y 2", {20, 10, 21, 11, 22, 12}},
        Order{"-X 3 -Y 2", {12, 22, 11, 21, 10, 20}},
        Order{"-X 3 +Y 2", {22, 12, 21, 11, 20, 10}}}) {
    std::string pixels;
    for (const int value : order.stored) pixels += grey(value);
    const auto sky = radiance("FORMAT=32-bit_rle_rgbe\n", order.resolution, pixels);
    ASSERT_TRUE(sky.ok()) << order.resolution << ": " << sky.status();
    EXPECT_EQ(sky->width, 3);
    std::vector<float> reds;
    for (std::size_t i = 0; i < 6; ++i) reds.push_back(sky->f32[3 * i]);
    EXPECT_EQ(reds, (std::vector<float>{10, 11, 12, 20, 21, 22})) << order.resolution;
  }
}

TEST(Radiance, ExposureAndColorCorrectionDivide) {
  const auto sky = radiance("EXPOSURE=4\nEXPOSURE= 2\nCOLORCORR=1 0.5 0.25\n\tEXPOSURE=100\n",
                            "-Y 1 +X 1", grey(64));
  ASSERT_TRUE(sky.ok()) << sky.status();
  EXPECT_EQ(sky->f32, (std::vector<float>{8, 16, 32}));
  for (const char* line : {"EXPOSURE=0\n", "EXPOSURE=-1\n", "EXPOSURE=x\n", "COLORCORR=1 1\n",
                           "EXPOSURE=1e-200\nEXPOSURE=1e-200\n", "FORMAT=ascii\n"}) {
    EXPECT_EQ(radiance(line, "-Y 1 +X 1", grey(64)).status().code(),
              absl::StatusCode::kInvalidArgument)
        << line;
  }
}

TEST(Radiance, OldRunLengthsAreRead) {
  // 1 pixel, 2 repeats, another pixel, and 1 + 256 repeats of it in two digits.
  const std::string pixels = grey(7) + std::string("\1\1\1\2", 4) + grey(9) +
                             std::string("\1\1\1\1", 4) + std::string("\1\1\1\1", 4);
  const auto sky = radiance("", "-Y 1 +X 261", pixels);
  ASSERT_TRUE(sky.ok()) << sky.status();
  for (std::size_t x = 0; x < 261; ++x) EXPECT_EQ(sky->f32[3 * x], x < 3 ? 7 : 9) << x;
  EXPECT_FALSE(radiance("", "-Y 1 +X 260", pixels).ok());
  EXPECT_FALSE(radiance("", "-Y 1 +X 4", std::string("\1\1\1\4", 4)).ok()) << "nothing to repeat";
}

TEST(Radiance, XyzIsConvertedToRec709) {
  // 0.9505, 1, 1.0890: the white point D65, with mantissas of eight bits.
  const std::string white = {static_cast<char>(122), static_cast<char>(128), static_cast<char>(139),
                             static_cast<char>(129)};
  const auto sky = radiance("FORMAT=32-bit_rle_xyze\n", "-Y 1 +X 1", white);
  ASSERT_TRUE(sky.ok()) << sky.status();
  // Half a unit of the mantissa, 1 / 256, times the largest sum of coefficients of a row, 5.3.
  for (const float v : sky->f32) EXPECT_NEAR(v, 1, 5.3 / 256);
}

TEST(Radiance, OtherSignatureAndNoFormatAreRead) {
  const std::string file = "#?SOFTWARE\r\n\r\n-Y 1 +X 1\r\n" + grey(5);
  const auto sky = decode_environment(std::as_bytes(std::span(file)), "sky");
  ASSERT_TRUE(sky.ok()) << sky.status();
  EXPECT_EQ(sky->f32, (std::vector<float>{5, 5, 5}));
}

TEST(Radiance, MalformedResolutionIsRejected) {
  for (const char* line : {"", "-Y 1", "-Y 1 +X", "-Y 1 -Y 1", "Y 1 +X 1", "-Y 0 +X 1",
                           "-Y -1 +X 1", "-Y 99999999999999999999 +X 1", "-Y 30000 +X 30000"}) {
    EXPECT_EQ(radiance("", line, grey(1)).status().code(), absl::StatusCode::kInvalidArgument)
        << line;
  }
}

TEST(Images, OtherFormatsAreRejected) {
  const auto refused = [](const std::string& magic) {
    std::vector<std::byte> file(256);
    std::memcpy(file.data(), magic.data(), magic.size());
    return decode_image(file, "t.png").status();
  };
  for (const char* magic : {"BM", "GIF89a", "II*\0", "8BPS", "%PDF", "DICM", "DDS ", ""}) {
    EXPECT_EQ(refused(magic).code(), absl::StatusCode::kInvalidArgument) << magic;
  }
  EXPECT_EQ(refused("\xABKTX 20\xBB\r\n").code(), absl::StatusCode::kUnimplemented);
  EXPECT_FALSE(decode_image({}, "empty").ok());
  EXPECT_FALSE(decode_environment(encode("png", 1, 1, 3, Codes{1, 2, 3}), "sky").ok());
}

TEST(Images, TruncatedFilesNeverCrash) {
  const Codes noise = [] {
    Codes c(24 * 24 * 3);
    for (std::size_t i = 0; i < c.size(); ++i) c[i] = static_cast<std::uint8_t>(i * i * 31 >> 3);
    return c;
  }();
  std::vector<float> floats(noise.begin(), noise.end());
  for (const auto& file : {encode("png", 24, 24, 3, noise), encode("jpeg", 24, 24, 3, noise),
                           encode("webp", 24, 24, 3, noise), encode("openexr", 24, 24, 3, floats),
                           encode("hdr", 24, 24, 3, floats)}) {
    for (std::size_t size = 0; size < file.size(); size += 1 + file.size() / 60) {
      const auto image = decode_image(std::span(file).first(size), "cut");
      EXPECT_TRUE(image.ok() || image.status().code() == absl::StatusCode::kInvalidArgument);
    }
  }
}

TEST(Images, MissingRowsAreRejected) {
  Codes noise(64 * 64 * 3);
  for (std::size_t i = 0; i < noise.size(); ++i) noise[i] = static_cast<std::uint8_t>(i * 37 >> 2);
  const std::vector<float> floats(noise.begin(), noise.end());
  for (const auto& file : {encode("png", 64, 64, 3, noise), encode("jpeg", 64, 64, 3, noise),
                           encode("webp", 64, 64, 3, noise), encode("openexr", 64, 64, 3, floats),
                           encode("hdr", 64, 64, 3, floats)}) {
    const auto image = decode_image(std::span(file).first(file.size() / 2), "cut");
    EXPECT_NE(std::string(image.status().message()).find("damaged or truncated"), std::string::npos)
        << image.status();
  }
}

/// A PNG header that claims `width` x `height` of 8-bit RGBA, with a correct CRC and without data.
std::vector<std::byte> png_claiming(std::uint32_t width, std::uint32_t height) {
  std::string chunk = "IHDR";
  for (const std::uint32_t v : {width, height}) {
    for (int shift = 24; shift >= 0; shift -= 8) chunk.push_back(static_cast<char>(v >> shift));
  }
  chunk += std::string("\x08\x06\0\0\0", 5);
  std::uint32_t crc = 0xFFFFFFFF;
  for (const char c : chunk) {
    crc ^= static_cast<unsigned char>(c);
    for (int k = 0; k < 8; ++k) crc = crc >> 1 ^ ((crc & 1) != 0 ? 0xEDB88320u : 0u);
  }
  crc = ~crc;
  std::string file = std::string("\x89PNG\r\n\x1A\n\0\0\0\x0D", 12) + chunk;
  for (int shift = 24; shift >= 0; shift -= 8) file.push_back(static_cast<char>(crc >> shift));
  file += std::string("\0\0\0\0IDAT", 8);
  std::vector<std::byte> out(file.size());
  std::memcpy(out.data(), file.data(), file.size());
  return out;
}

TEST(Images, SizeLimitsAreCheckedInHeader) {
  const auto message = [](std::uint32_t width, std::uint32_t height) {
    return std::string(decode_image(png_claiming(width, height), "bomb").status().message());
  };
  EXPECT_NE(message(40000, 10).find("more than the limit of 32768"), std::string::npos)
      << message(40000, 10);
  EXPECT_NE(message(10, 40000).find("more than the limit of 32768"), std::string::npos);
  EXPECT_NE(message(30000, 30000).find("bytes decoded, more than the limit"), std::string::npos)
      << message(30000, 30000);
}

TEST(Images, MemoryLimitIsCheckedInHeader) {
  const auto refused = decode_image(png_claiming(1000, 1000), "large", 3'999'999).status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_NE(refused.message().find("more than the 3999999 bytes of memory that are left"),
            std::string::npos)
      << refused;
  EXPECT_EQ(decode_image(png_claiming(1000, 1000), "cut", 4'000'000).status().code(),
            absl::StatusCode::kInvalidArgument);  // no pixels follow
}

TEST(Images, PixelLimitIsEnforced) {
  const auto refused = image::decode(png_claiming(100, 100), {1000, 1 << 20, 9999});
  EXPECT_NE(std::string(refused.status().message()).find("limit of 9999 pixels"), std::string::npos)
      << refused.status();
}

}  // namespace
}  // namespace tessera::render
