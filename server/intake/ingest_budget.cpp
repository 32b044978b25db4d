#include "server/intake/ingest_budget.h"

namespace tessera::server {

void IngestBudget::take(std::int64_t bytes) {
  const MutexLock lock(mutex_);
  used_bytes_ += bytes;
}

void IngestBudget::give_back(std::int64_t bytes) {
  std::vector<std::function<void()>> resumes;
  {
    const MutexLock lock(mutex_);
    used_bytes_ -= bytes;
    if (used_bytes_ < limit_bytes_) resumes.swap(waiting_);
  }
  for (const auto& resume : resumes) resume();
}

std::shared_ptr<void> IngestBudget::hold(std::int64_t bytes) {
  take(bytes);
  return {nullptr, [this, bytes](void*) { give_back(bytes); }};
}

bool IngestBudget::has_room_or_call(std::function<void()> resume) {
  const MutexLock lock(mutex_);
  if (used_bytes_ < limit_bytes_ || stopping_) return true;
  waiting_.push_back(std::move(resume));
  return false;
}

void IngestBudget::stop() {
  const MutexLock lock(mutex_);
  stopping_ = true;
}

std::int64_t IngestBudget::used_bytes() const {
  const MutexLock lock(mutex_);
  return used_bytes_;
}

}  // namespace tessera::server
