#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <span>
#include <string_view>

#include "worker/gltf/validate/validate.h"

// Validates files from strangers. Any file has a result: a finding for each fault, of which the
// first are kept, with a pointer into the document.

namespace {

using tessera::render::FindingSeverity;
using tessera::render::ValidationFinding;
using tessera::render::ValidationFindings;

constexpr std::size_t kLimit = 20;

/// Has one other file: the first bytes of a PNG.
class OneFile final : public tessera::render::ResourceReader {
 public:
  absl::StatusOr<std::span<const std::byte>> read(std::string_view uri) override {
    if (uri != "picture.bin") return absl::NotFoundError("no such file");
    return std::as_bytes(std::span<const char>(kPng));
  }

 private:
  static constexpr std::string_view kPng{"\x89PNG\r\n\x1a\n\0\0\0\x0DIHDR", 16};
};

void check_findings(const ValidationFindings& findings) {
  std::size_t sum = 0;
  for (const auto severity : {FindingSeverity::error, FindingSeverity::warning,
                              FindingSeverity::information, FindingSeverity::hint}) {
    sum += findings.count(severity);
  }
  if (findings.kept().size() > kLimit || findings.kept().size() + findings.omitted() != sum)
    std::abort();
  for (const ValidationFinding& each : findings.kept()) {
    const bool is_pointer =
        each.pointer.empty() || each.pointer[0] == '/' || each.pointer[0] == '@';
    if (each.rule == nullptr || each.rule->code.empty() || !is_pointer) std::abort();
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  OneFile reader;
  const std::span bytes(data, size);
  check_findings(tessera::render::validate_gltf(std::as_bytes(bytes), reader, kLimit).findings);
  return 0;
}
