#include "worker/gltf/validate/formats/glb_check.h"

#include <algorithm>
#include <cstdint>
#include <string>

#include "worker/gltf/file/glb_layout.h"
#include "worker/gltf/validate/findings/rules.h"

namespace tessera::render {

namespace {

class GlbCheck {
 public:
  GlbCheck(std::span<const std::byte> file, ValidationFindings& findings)
      : file_(file), findings_(findings) {}

  GlbChunks run() {
    if (!check_header()) return chunks_;
    std::size_t at = glb::kHeaderBytes;
    for (int index = 0; at < file_.size(); ++index) {
      if (at == length_) {
        add(rules::kGlbExtraData, at);
        chunks_.is_complete = true;
        return chunks_;
      }
      if (file_.size() - at < glb::kChunkHeaderBytes) {
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

  [[nodiscard]] std::uint32_t word(std::size_t at) const { return glb::read_u32(file_, at); }

  bool check_header() {
    const ValidationRule* fault = nullptr;
    std::size_t at = 0;
    if (file_.size() < glb::kHeaderBytes) {
      fault = &rules::kGlbUnexpectedEndOfHeader;
      at = file_.size();
    } else if (word(0) != glb::kMagic) {
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
    if (length_ <= glb::kHeaderBytes) add(rules::kGlbLengthTooSmall, 8);
    return true;
  }

  /// Checks the chunk at `at` and moves behind it. Returns false if the file ends within it.
  bool check_chunk(std::size_t& at, int index) {
    const std::size_t size = word(at), header = at;
    const std::uint32_t type = word(at + 4);
    at += glb::kChunkHeaderBytes;
    if (size % 4 != 0) add(rules::kGlbChunkLengthUnaligned, header);
    if (at + size > length_) add(rules::kGlbChunkTooBig, header);
    if (index == 0 && type != glb::kJsonChunk) add(rules::kGlbUnexpectedFirstChunk, header);
    if (type == glb::kBinChunk && index > 1 && !chunks_.binary)
      add(rules::kGlbUnexpectedBinChunk, header);
    if (type != glb::kJsonChunk && type != glb::kBinChunk) add(rules::kGlbUnknownChunkType, header);
    if (type == glb::kJsonChunk && size == 0) add(rules::kGlbEmptyChunk, header);
    if (type == glb::kBinChunk && size == 0) add(rules::kGlbEmptyBinChunk, header);
    const bool repeated =
        (type == glb::kJsonChunk && chunks_.json) || (type == glb::kBinChunk && chunks_.binary);
    if (repeated) add(rules::kGlbDuplicateChunk, header);
    const auto body = file_.subspan(at, std::min(size, file_.size() - at));
    at += body.size();
    // An empty chunk at the end of the file is one fault, not also invalid JSON.
    const bool has_text = size > 0 || at < file_.size();
    if (type == glb::kJsonChunk && !repeated && has_text) {
      chunks_.json = std::string_view(reinterpret_cast<const char*>(body.data()), body.size());
    }
    if (type == glb::kBinChunk && !repeated) chunks_.binary = body;
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
