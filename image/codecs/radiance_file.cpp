/// Decoder of Radiance files (.hdr, .pic) in memory.
///
/// Source: G. Ward, "Real Pixels", Graphics Gems II, 1991; "Radiance File Formats", section
/// "Picture File Format (.pic)". Mantissas are read without the half that Radiance adds to them, as
/// other readers of environment maps do.

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <string_view>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "image/codecs/formats.h"

namespace tessera::image {
namespace {

/// Red, green and blue (or X, Y and Z) mantissas and the common exponent.
using Rgbe = std::array<std::uint8_t, 4>;

/// An axis of the stored order: pixels run along x or y, upwards or downwards in coordinates.
struct Axis {
  bool is_x = false;
  bool reversed = false;  // against the direction of our rows, right and down
  std::int64_t count = 0;
};

struct Header {
  bool is_xyz = false;
  std::array<double, 3> divisor = {1, 1, 1};  // product of all EXPOSURE and COLORCORR lines
  Axis scanlines, pixels;
};

/// Linear Rec. 709 from CIE XYZ; white is D65. Source: IEC 61966-2-1, with more digits from
/// W3C, "CSS Color Module Level 4", section 18.
constexpr double kRgbFromXyz[3][3] = {
    {3.2409699419045226, -1.537383177570094, -0.4986107602930034},
    {-0.9692436362808796, 1.8759675015077202, 0.04155505740717559},
    {0.05563007969699366, -0.20397695888897652, 1.0569715142428786}};

std::vector<std::string> words_of(std::string_view text) {
  return absl::StrSplit(std::string(text), ' ', absl::SkipWhitespace());
}

/// Parses "-Y 512" or "+X 1024".
absl::StatusOr<Axis> parse_axis(const std::string& direction, const std::string& count) {
  Axis axis;
  if (direction.size() != 2 || (direction[0] != '-' && direction[0] != '+') ||
      (direction[1] != 'X' && direction[1] != 'Y') || !absl::SimpleAtoi(count, &axis.count)) {
    return damaged("its resolution line is malformed");
  }
  axis.is_x = direction[1] == 'X';
  axis.reversed = (direction[0] == '-') == axis.is_x;  // Y points up in the file
  return axis;
}

absl::Status read_resolution(std::string_view line, Header& header) {
  const std::vector<std::string> words = words_of(line);
  if (words.size() != 4) return damaged("its resolution line is malformed");
  const auto scanlines = parse_axis(words[0], words[1]), pixels = parse_axis(words[2], words[3]);
  if (!scanlines.ok()) return scanlines.status();
  if (!pixels.ok()) return pixels.status();
  if (scanlines->is_x == pixels->is_x) return damaged("its resolution line names an axis twice");
  header.scanlines = *scanlines;
  header.pixels = *pixels;
  return absl::OkStatus();
}

/// Multiplies the divisor by the one or three numbers of an EXPOSURE or COLORCORR line.
absl::Status read_factors(std::string_view line, const std::vector<std::string>& words,
                          std::size_t count, Header& header) {
  for (std::size_t k = 0; k < 3; ++k) {
    double factor = 0;
    if (words.size() != count || !absl::SimpleAtod(words[count == 1 ? 0 : k], &factor)) factor = 0;
    header.divisor[k] *= factor;
    if (!(factor > 0 && header.divisor[k] > 0 && std::isfinite(header.divisor[k]))) {
      return damaged(absl::StrCat(std::string(line), " has no positive finite value"));
    }
  }
  return absl::OkStatus();
}

/// Reads a line of the header. Indented lines are the history of other pictures, without meaning.
absl::Status read_property(std::string_view line, Header& header) {
  const std::size_t equals = line.find('=');
  if (equals == std::string_view::npos) return absl::OkStatus();
  const std::string_view name = line.substr(0, equals);
  const std::vector<std::string> words = words_of(line.substr(equals + 1));
  if (name == "EXPOSURE") return read_factors(line, words, 1, header);
  if (name == "COLORCORR") return read_factors(line, words, 3, header);
  if (name != "FORMAT") return absl::OkStatus();
  const std::string value = words.empty() ? "" : words[0];
  header.is_xyz = value == "32-bit_rle_xyze";
  if (header.is_xyz || value == "32-bit_rle_rgbe") return absl::OkStatus();
  return absl::InvalidArgumentError("the image's FORMAT is neither 32-bit_rle_rgbe nor _xyze");
}

/// Reads the file from front to back.
class Reader {
 public:
  explicit Reader(std::span<const std::byte> file) : rest_(file) {}

  absl::StatusOr<Header> read_header() {
    Header header;
    std::string_view line;
    if (!next_line(line)) return damaged("its header has no end");
    do {
      if (!next_line(line)) return damaged("its header has no end");
      absl::Status status = read_property(line, header);
      if (!status.ok()) return status;
    } while (!line.empty());
    if (!next_line(line)) return damaged("its resolution line is malformed");
    absl::Status status = read_resolution(line, header);
    if (!status.ok()) return status;
    return header;
  }

  [[nodiscard]] std::size_t bytes_left() const { return rest_.size(); }

  /// Reads a scanline in either encoding. Returns false if it is damaged or truncated.
  bool read_scanline(std::vector<Rgbe>& out) {
    // Scanlines of other lengths are never stored by component.
    constexpr std::size_t kMinLength = 8, kMaxLength = 0x7FFF;
    if (rest_.size() < 4) return false;
    const Rgbe first = pixel_at(0);
    const bool by_component = out.size() >= kMinLength && out.size() <= kMaxLength &&
                              first[0] == 2 && first[1] == 2 && first[2] < 128;
    if (!by_component) return read_pixels(out);
    if (static_cast<std::size_t>(first[2] * 256 + first[3]) != out.size()) return false;
    rest_ = rest_.subspan(4);
    for (std::size_t component = 0; component < 4; ++component) {
      if (!read_component(component, out)) return false;
    }
    return true;
  }

 private:
  bool next_line(std::string_view& line) {
    const std::string_view text(reinterpret_cast<const char*>(rest_.data()), rest_.size());
    const std::size_t end = text.find('\n');
    if (end == std::string_view::npos) return false;
    line = text.substr(0, end);
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    rest_ = rest_.subspan(end + 1);
    return true;
  }

  [[nodiscard]] std::uint8_t byte_at(std::size_t i) const {
    return static_cast<std::uint8_t>(rest_[i]);
  }
  [[nodiscard]] Rgbe pixel_at(std::size_t i) const {
    return {byte_at(i), byte_at(i + 1), byte_at(i + 2), byte_at(i + 3)};
  }

  /// Whole pixels; (1, 1, 1, n) repeats the previous pixel n times, and the n of consecutive
  /// repeats are the digits of a number to base 256, lowest first.
  bool read_pixels(std::vector<Rgbe>& out) {
    int shift = 0;
    for (std::size_t i = 0; i < out.size();) {
      if (rest_.size() < 4) return false;
      const Rgbe pixel = pixel_at(0);
      rest_ = rest_.subspan(4);
      if (pixel[0] != 1 || pixel[1] != 1 || pixel[2] != 1) {
        out[i++] = pixel;
        shift = 0;
        continue;
      }
      const std::size_t run = std::size_t{pixel[3]} << shift;
      if (i == 0 || shift > 24 || run > out.size() - i) return false;
      std::fill_n(out.begin() + static_cast<std::ptrdiff_t>(i), run, out[i - 1]);
      i += run;
      shift += 8;
    }
    return true;
  }

  /// One component of a scanline: above 128, a run of one value; otherwise that many values.
  bool read_component(std::size_t component, std::vector<Rgbe>& out) {
    for (std::size_t i = 0; i < out.size();) {
      if (rest_.empty()) return false;
      const std::uint8_t code = byte_at(0);
      const bool run = code > 128;
      const std::size_t count = run ? code - 128u : code;
      const std::size_t stored = 1 + (run ? 1 : count);
      if (count == 0 || count > out.size() - i || stored > rest_.size()) return false;
      for (std::size_t k = 0; k < count; ++k) out[i + k][component] = byte_at(run ? 1 : 1 + k);
      rest_ = rest_.subspan(stored);
      i += count;
    }
    return true;
  }

  std::span<const std::byte> rest_;
};

/// 2^(exponent - 136): an exponent of 128 stands for mantissas below 1.
const std::array<float, 256>& scales() {
  static const std::array<float, 256> table = [] {
    std::array<float, 256> out{};
    for (int e = 1; e < 256; ++e) out[static_cast<std::size_t>(e)] = std::ldexp(1.0f, e - 136);
    return out;  // an exponent of 0 is black
  }();
  return table;
}

/// Linear Rec. 709 of a pixel; colours outside its gamut are clamped to 0.
void decode_pixel(const Rgbe& pixel, const Header& header, float* out) {
  std::array<double, 3> value;
  for (std::size_t k = 0; k < 3; ++k) {
    value[k] = static_cast<double>(static_cast<float>(pixel[k]) * scales()[pixel[3]]);
    value[k] /= header.divisor[k];
  }
  for (std::size_t k = 0; k < 3; ++k) {
    const double* row = kRgbFromXyz[k];
    const double v =
        header.is_xyz ? row[0] * value[0] + row[1] * value[1] + row[2] * value[2] : value[k];
    out[k] = v > 0 ? static_cast<float>(v) : 0;
  }
}

}  // namespace

absl::StatusOr<Pixels> decode_radiance(std::span<const std::byte> file, const PixelLimits& limits) {
  Reader reader(file);
  const auto header = reader.read_header();
  if (!header.ok()) return header.status();
  const Axis &outer = header->scanlines, &inner = header->pixels;
  Pixels image;
  image.width = outer.is_x ? outer.count : inner.count;
  image.height = outer.is_x ? inner.count : outer.count;
  absl::Status fits = check_size(image.width, image.height, image.channels, sizeof(float), limits);
  if (!fits.ok()) return fits;
  // A scanline takes at least one pixel.
  if (reader.bytes_left() / 4 < static_cast<std::size_t>(outer.count)) return damaged("");
  image.f32.resize(static_cast<std::size_t>(3 * image.width * image.height));
  std::vector<Rgbe> scanline(static_cast<std::size_t>(inner.count));
  for (std::int64_t i = 0; i < outer.count; ++i) {
    if (!reader.read_scanline(scanline)) return damaged(absl::StrCat("scanline ", i));
    const std::int64_t across = outer.reversed ? outer.count - 1 - i : i;
    for (std::int64_t j = 0; j < inner.count; ++j) {
      const std::int64_t along = inner.reversed ? inner.count - 1 - j : j;
      const std::int64_t x = outer.is_x ? across : along, y = outer.is_x ? along : across;
      decode_pixel(scanline[static_cast<std::size_t>(j)], *header,
                   image.f32.data() + 3 * (y * image.width + x));
    }
  }
  return image;
}

}  // namespace tessera::image
