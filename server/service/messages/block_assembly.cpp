#include "server/service/messages/block_assembly.h"

#include <zstd.h>

#include <utility>

#include "absl/strings/str_cat.h"
#include "server/service/messages/messages.h"

namespace tessera::server {
namespace {

constexpr std::size_t kMaxChunkBytes = 64 << 10;
constexpr std::int64_t kMaxWireBytes = std::int64_t{1} << 28;

/// Decompresses zstd over byte planes; returns an empty string unless `wire` decodes to `size`
/// bytes.
std::string expand(const std::string& wire, std::int64_t size_bytes) {
  const auto size = static_cast<std::size_t>(size_bytes);
  std::string planes(size, '\0');
  const std::size_t got = ZSTD_decompress(planes.data(), size, wire.data(), wire.size());
  if (ZSTD_isError(got) || got != size || size % 4 != 0) return {};
  std::string bytes(size, '\0');
  const std::size_t words = size / 4;
  for (std::size_t plane = 0; plane < 4; ++plane) {
    const char* from = planes.data() + plane * words;
    for (std::size_t word = 0; word < words; ++word) bytes[4 * word + plane] = from[word];
  }
  return bytes;
}

}  // namespace

absl::Status BlockAssembly::take(v1::DeliverRequest& request) {
  if (worker_id_.empty()) {
    if (request.worker_id().empty()) {
      return absl::InvalidArgumentError("worker_id: missing in the first message");
    }
    worker_id_ = request.worker_id();
  }
  absl::Status status = coordinator_.intake().check_delivery(worker_id_, certificate_);
  for (int i = 0; status.ok() && i < request.parts_size(); ++i) {
    v1::BlockPart& part = *request.mutable_parts(i);
    if (part.has_header()) status = begin(part.header());
    if (status.ok()) status = append(*part.mutable_chunk());
  }
  return status;
}

absl::Status BlockAssembly::begin(const v1::BlockHeader& message) {
  if (is_open_) return absl::InvalidArgumentError("header: the previous block is incomplete");
  auto header = from_message(message);
  if (!header.ok()) return header.status();
  is_compressed_ = message.compression() == v1::BlockHeader::COMPRESSION_ZSTD_PLANES;
  missing_bytes_ = message.wire_size_bytes();
  if (missing_bytes_ < 1 || missing_bytes_ > kMaxWireBytes ||
      (!is_compressed_ && missing_bytes_ != header->size_bytes)) {
    return absl::InvalidArgumentError(absl::StrCat("header.wire_size_bytes: ", missing_bytes_,
                                                   " does not match size_bytes ",
                                                   header->size_bytes));
  }
  header_ = *std::move(header);
  is_open_ = true;
  admission_ = coordinator_.intake().admit(worker_id_, header_);
  if (admission_ && is_compressed_ &&
      missing_bytes_ > static_cast<std::int64_t>(
                           ZSTD_compressBound(static_cast<std::size_t>(header_.size_bytes)))) {
    return absl::InvalidArgumentError("header.wire_size_bytes: above zstd's maximum");
  }
  bytes_.clear();
  return absl::OkStatus();
}

absl::Status BlockAssembly::append(std::string& chunk) {
  if (!is_open_) return absl::InvalidArgumentError("chunk: bytes without a header");
  if (chunk.empty() || chunk.size() > kMaxChunkBytes) {
    return absl::InvalidArgumentError(
        absl::StrCat("chunk: ", chunk.size(), " bytes, expected 1 to 65536"));
  }
  if (static_cast<std::int64_t>(chunk.size()) > missing_bytes_) {
    return absl::InvalidArgumentError("chunk: more bytes than wire_size_bytes");
  }
  missing_bytes_ -= static_cast<std::int64_t>(chunk.size());
  if (admission_) {
    if (bytes_.empty() && missing_bytes_ == 0) {
      bytes_ = std::move(chunk);  // a small block in one part
    } else {
      if (bytes_.empty()) {
        bytes_.reserve(static_cast<std::size_t>(missing_bytes_) + chunk.size());
      }
      bytes_ += chunk;
    }
  }
  if (missing_bytes_ == 0) complete();
  return absl::OkStatus();
}

void BlockAssembly::complete() {
  is_open_ = false;
  if (!admission_) return;
  if (is_compressed_) bytes_ = expand(bytes_, header_.size_bytes);
  // The digest detects wrong bytes, also after failed decompression.
  coordinator_.intake().deliver(worker_id_, header_, *admission_, std::exchange(bytes_, {}));
}

}  // namespace tessera::server
