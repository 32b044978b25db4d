#include "server/telemetry/delivery_log.h"

#include <algorithm>
#include <utility>

namespace tessera::server {

void DeliveryLog::add(Delivery delivery) {
  const MutexLock lock(mutex_);
  Known& worker = workers_[std::string(delivery.worker_id)];
  if (!worker.id) worker.id = std::make_shared<const std::string>(delivery.worker_id);
  ++worker.count;
  delivery.worker_text = worker.id;
  delivery.worker_id = *worker.id;
  delivery.sequence = ++last_sequence_;
  deliveries_.push_back(std::move(delivery));
  if (deliveries_.size() <= kMaxDeliveries) return;
  const auto oldest = workers_.find(deliveries_.front().worker_id);
  if (--oldest->second.count == 0) workers_.erase(oldest);
  deliveries_.pop_front();
}

std::size_t DeliveryLog::worker_count() const {
  const MutexLock lock(mutex_);
  return workers_.size();
}

std::vector<Delivery> DeliveryLog::read(std::int64_t job, std::int64_t after,
                                        std::size_t limit) const {
  const MutexLock lock(mutex_);
  std::vector<Delivery> found;
  if (deliveries_.empty()) return found;
  const std::int64_t first = deliveries_.front().sequence;
  const auto count = static_cast<std::int64_t>(deliveries_.size());
  for (std::int64_t i = std::clamp<std::int64_t>(after + 1 - first, 0, count);
       i < count && found.size() < limit; ++i) {
    const Delivery& delivery = deliveries_[static_cast<std::size_t>(i)];
    if (delivery.job == job) found.push_back(delivery);
  }
  return found;
}

}  // namespace tessera::server
