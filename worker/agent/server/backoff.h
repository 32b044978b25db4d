#pragma once

#include <chrono>

namespace tessera::agent {

/// Pauses between attempts to reach the server: each is twice the one before it.
constexpr std::chrono::milliseconds kFirstPause{50}, kMaxPause{2'000};

}  // namespace tessera::agent
