#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <functional>
#include <thread>
#include <vector>

namespace tessera::image {

/// Calls work(i) for all i < count, with several threads.
inline void for_all(std::int32_t count, int threads,
                    const std::function<void(std::int32_t)>& work) {
  std::atomic<std::int32_t> next{0};
  const auto run = [&] {
    for (std::int32_t i = next++; i < count; i = next++) work(i);
  };
  std::vector<std::thread> others;
  for (int k = 1; k < std::min(threads, count); ++k) others.emplace_back(run);
  run();
  for (std::thread& thread : others) thread.join();
}

}  // namespace tessera::image
