#include "worker/gltf/validate/formats/glb_check.h"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <string>

#include "worker/gltf/validate/findings/rules.h"

namespace tessera::render {

namespace {

constexpr std::uint32_t kMagic = 0x46546C67;  // "glTF"
constexpr std::uint32_t kJson = 0x4E4F534A;   // "JSON"
constexpr std::uint32_t kBin = 0x004E4942;    // "BIN\0"
constexpr std::size_t kHeaderBytes = 12, kChunkHeaderBytes = 8;

class GlbCheck {
 public:
  GlbCheck(std::span<const std::byte> file, ValidationFindings& findings)
      : file_(file), findings_(findings) {}

  GlbChunks run() {
    if (!check_header()) return chunks_;
    std::size_t at = kHeaderBytes;
    for (int index = 0; at < file_.size(); ++index) {
      if (at == length_) {
        add(rules::kGlbExtraData, at);
        chunks_.is_complete = true;
        return chunks_;
      }
      if (file_.size() - at < kChunkHeaderBytes) {
        add(rules::kGlbUnexpectedEndOfChunkHeader, file_.size());
        return chunks_;
      }
      if (!check_chunk(at, index)) return chunks_;
    }
    if (at != length_) add(rules::kGlbLengthMismatch, at);
    chunks_.is_complete = true;
    return chunks_;
  }

 private:
  void add(const ValidationRule& rule, std::size_t offset) {
    findings_.add(rule, "@" + std::to_string(offset));
  }

  [[nodiscard]] std::uint32_t word(std::size_t at) const {
    std::uint32_t value = 0;
    std::memcpy(&value, file_.data() + at, sizeof value);
    return value;
  }

  bool check_header() {
    const ValidationRule* fault = nullptr;
    std::size_t at = 0;
    if (file_.size() < kHeaderBytes) {
      fault = &rules::kGlbUnexpectedEndOfHeader;
      at = file_.size();
    } else if (word(0) != kMagic) {
      fault = &rules::kGlbInvalidMagic;
    } else if (word(4) != 2) {
      fault = &rules::kGlbInvalidVersion;
      at = 4;
    }
    if (fault != nullptr) {
      add(*fault, at);
      return false;
    }
    length_ = word(8);
    if (length_ <= kHeaderBytes) add(rules::kGlbLengthTooSmall, 8);
    return true;
  }

  /// Checks the chunk at `at` and moves behind it. Returns false if the file ends within it.
  bool check_chunk(std::size_t& at, int index) {
    const std::size_t size = word(at), header = at;
    const std::uint32_t type = word(at + 4);
    at += kChunkHeaderBytes;
    if (size % 4 != 0) add(rules::kGlbChunkLengthUnaligned, header);
    if (at + size > length_) add(rules::kGlbChunkTooBig, header);
    if (index == 0 && type != kJson) add(rules::kGlbUnexpectedFirstChunk, header);
    if (type == kBin && index > 1 && !chunks_.binary) add(rules::kGlbUnexpectedBinChunk, header);
    if (type != kJson && type != kBin) add(rules::kGlbUnknownChunkType, header);
    if (type == kJson && size == 0) add(rules::kGlbEmptyChunk, header);
    if (type == kBin && size == 0) add(rules::kGlbEmptyBinChunk, header);
    const bool repeated = (type == kJson && chunks_.json) || (type == kBin && chunks_.binary);
    if (repeated) add(rules::kGlbDuplicateChunk, header);
    const auto body = file_.subspan(at, std::min(size, file_.size() - at));
    at += body.size();
    if (type == kJson && !repeated) {
      chunks_.json = std::string_view(reinterpret_cast<const char*>(body.data()), body.size());
    }
    if (type == kBin && !repeated) chunks_.binary = body;
    if (body.size() == size) return true;
    add(rules::kGlbUnexpectedEndOfChunkData, file_.size());
    return false;
  }

  std::span<const std::byte> file_;
  ValidationFindings& findings_;
  std::size_t length_ = 0;
  GlbChunks chunks_;
};

}  // namespace

GlbChunks check_glb(std::span<const std::byte> file, ValidationFindings& findings) {
  return GlbCheck(file, findings).run();
}

}  // namespace tessera::render
