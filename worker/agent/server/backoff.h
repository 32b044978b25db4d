#pragma once

#include <chrono>

namespace tessera::agent {

/// Spans of contract::Backoff between attempts to reach the server.
constexpr std::chrono::milliseconds kFirstPause{50}, kMaxPause{2'000};

}  // namespace tessera::agent
