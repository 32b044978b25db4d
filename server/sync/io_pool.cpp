#include "server/sync/io_pool.h"

#include <sys/resource.h>
#include <unistd.h>

#include <utility>

namespace tessera::server {
namespace {

/// Lowers the priority of the calling thread only: on Linux, each thread has its own nice value.
void lower_priority() {
  constexpr int kNice = 10;
  ::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), kNice);
}

}  // namespace

IoPool::IoPool(int thread_count, Priority priority) {
  for (int i = 0; i < thread_count; ++i) {
    threads_.emplace_back([this, priority] {
      if (priority == Priority::low) lower_priority();
      run();
    });
  }
}

IoPool::~IoPool() {
  {
    const MutexLock lock(mutex_);
    is_stopping_ = true;
  }
  wake_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void IoPool::post(std::function<void()> task) {
  {
    const MutexLock lock(mutex_);
    tasks_.push_back(std::move(task));
  }
  wake_.notify_one();
}

void IoPool::run() {
  while (true) {
    std::function<void()> task;
    {
      const MutexLock lock(mutex_);
      while (!is_stopping_ && tasks_.empty()) wake_.wait(mutex_);
      if (tasks_.empty()) return;
      task = std::move(tasks_.front());
      tasks_.pop_front();
    }
    task();
  }
}

}  // namespace tessera::server
