#include "worker/render/parallel_tbb.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <memory>

namespace tessera::render {

ParallelFor parallel_tbb(int threads) {
  // Shared by copies of the returned function, because an arena cannot be copied.
  auto arena = std::make_shared<tbb::task_arena>(threads < 1 ? 1 : threads);
  return [arena](std::int64_t count, const std::function<void(std::int64_t)>& body) {
    arena->execute([&] {
      tbb::parallel_for(tbb::blocked_range<std::int64_t>(0, count, 1),
                        [&](const tbb::blocked_range<std::int64_t>& range) {
                          for (std::int64_t i = range.begin(); i < range.end(); ++i) body(i);
                        });
    });
  };
}

}  // namespace tessera::render
