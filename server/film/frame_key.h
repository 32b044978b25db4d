#pragma once

#include <compare>
#include <cstdint>
#include <string>

namespace tessera::server {

/// One frame of one job.
struct FrameKey {
  std::string job_id;
  std::int32_t frame = 0;
  auto operator<=>(const FrameKey&) const = default;
};

}  // namespace tessera::server
