#pragma once

#include <google/protobuf/message_lite.h>

#include <cstddef>

namespace tessera::server {

/// Decides how many elements fit into one page of a reply. A page holds at least one element, so
/// an element must be far smaller than a gRPC message (rpc/channel.h).
class MessageBudget {
 public:
  /// Returns whether `element` still fits into the page, and counts it if so.
  bool add(const google::protobuf::MessageLite& element) {
    constexpr std::size_t kPageBytes = 3 << 20;
    constexpr std::size_t kFramingBytes = 8;  // tag and length of an element
    const std::size_t size = element.ByteSizeLong() + kFramingBytes;
    if (used_bytes_ != 0 && used_bytes_ + size > kPageBytes) return false;
    used_bytes_ += size;
    return true;
  }

 private:
  std::size_t used_bytes_ = 0;
};

}  // namespace tessera::server
