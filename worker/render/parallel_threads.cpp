#include "worker/render/parallel_threads.h"

#include <atomic>
#include <thread>
#include <vector>

#include "worker/render/frame_renderer.h"

namespace tessera::render {

ParallelFor parallel_threads(int threads) {
  return [threads](std::int64_t count, const std::function<void(std::int64_t)>& body) {
    std::atomic<std::int64_t> next{0};
    const auto work = [&] {
      for (std::int64_t i = next++; i < count; i = next++) body(i);
    };
    std::vector<std::thread> others;
    for (int i = 1; i < threads && i < count; ++i) others.emplace_back(work);
    work();
    for (std::thread& thread : others) thread.join();
  };
}

}  // namespace tessera::render
