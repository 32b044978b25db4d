#include "server/telemetry/delivery_log.h"

#include <algorithm>

namespace tessera::server {

void DeliveryLog::add(Delivery delivery) {
  const std::lock_guard lock(mutex_);
  const auto known = workers_.find(delivery.worker_id);
  delivery.worker_id =
      known != workers_.end() ? *known : *workers_.emplace(delivery.worker_id).first;
  delivery.sequence = ++last_sequence_;
  deliveries_.push_back(delivery);
  if (deliveries_.size() > kMaxDeliveries) deliveries_.pop_front();
}

std::vector<Delivery> DeliveryLog::read(std::int64_t job, std::int64_t after,
                                        std::size_t limit) const {
  const std::lock_guard lock(mutex_);
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
