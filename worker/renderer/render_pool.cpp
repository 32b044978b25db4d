#include "worker/renderer/render_pool.h"

#include <ctime>
#include <utility>

#include "worker/render/float_control.h"

namespace tessera::agent {

std::int64_t thread_cpu_ns() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return std::int64_t{time.tv_sec} * 1'000'000'000 + time.tv_nsec;
}

RenderPool::RenderPool(int thread_count) {
  for (int i = 0; i < thread_count; ++i) {
    threads_.emplace_back([this] { work(); });
  }
}

RenderPool::~RenderPool() {
  {
    const std::lock_guard lock(mutex_);
    done_ = true;
  }
  wake_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void RenderPool::submit(std::function<void()> task) {
  {
    const std::lock_guard lock(mutex_);
    tasks_.push_back(std::move(task));
  }
  wake_.notify_one();
}

render::ParallelFor RenderPool::parallel_for(std::atomic<std::int64_t>& helper_cpu_ns) {
  return [this, &helper_cpu_ns](std::int64_t count, const std::function<void(std::int64_t)>& body) {
    run_loop(count, body, helper_cpu_ns);
  };
}

void RenderPool::Loop::run() {
  for (std::int64_t i = next.fetch_add(1); i < count; i = next.fetch_add(1)) body(i);
}

RenderPool::Loop* RenderPool::open_loop() {
  for (Loop* loop : loops_) {
    if (loop->unfinished()) return loop;
  }
  return nullptr;
}

void RenderPool::work() {
  render::require_ieee_floats("when a thread of the renderer starts");
  std::unique_lock lock(mutex_);
  while (true) {
    if (!tasks_.empty()) {
      auto task = std::move(tasks_.front());
      tasks_.pop_front();
      lock.unlock();
      task();
      task = nullptr;
      render::require_ieee_floats("after a task of the renderer");
      lock.lock();
    } else if (Loop* loop = open_loop()) {
      help(lock, *loop);
    } else if (done_) {
      return;
    } else {
      ++idle_;
      wake_.wait(lock);
      --idle_;
    }
  }
}

void RenderPool::help(std::unique_lock<std::mutex>& lock, Loop& loop) {
  ++loop.helpers;
  lock.unlock();
  const std::int64_t start = thread_cpu_ns();
  loop.run();
  render::require_ieee_floats("after a loop of the renderer");
  loop.helper_cpu_ns.fetch_add(thread_cpu_ns() - start);
  lock.lock();
  if (--loop.helpers == 0) helper_left_.notify_all();
}

void RenderPool::run_loop(std::int64_t count, const std::function<void(std::int64_t)>& body,
                          std::atomic<std::int64_t>& helper_cpu_ns) {
  Loop loop{count, body, helper_cpu_ns};
  std::list<Loop*>::iterator place;
  {
    const std::lock_guard lock(mutex_);
    place = loops_.insert(loops_.end(), &loop);
    if (idle_ > 0) wake_.notify_all();
  }
  loop.run();
  std::unique_lock lock(mutex_);
  loops_.erase(place);
  helper_left_.wait(lock, [&loop] { return loop.helpers == 0; });
}

}  // namespace tessera::agent
