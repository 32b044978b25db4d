#include "worker/agent/units/unit_queue.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::agent {

UnitKey key_of(const v1::UnitId& id) {
  return {id.job_id(), {id.frame(), id.tile(), id.pass()}};
}

v1::UnitId id_of(const UnitKey& key) {
  v1::UnitId id;
  id.set_job_id(key.job_id);
  id.set_frame(key.unit.frame);
  id.set_tile(key.unit.tile);
  id.set_pass(key.unit.pass);
  return id;
}

std::string to_string(const UnitKey& key) {
  return absl::StrCat(key.job_id, " ", key.unit.frame, " ", key.unit.tile, " ", key.unit.pass);
}

UnitQueue::Entry* UnitQueue::find(const UnitKey& key, Phase phase) {
  const auto found = entries_.find(key);
  return found != entries_.end() && found->second.phase == phase ? &found->second : nullptr;
}

void UnitQueue::erase(const UnitKey& key) {
  const auto found = entries_.find(key);
  if (found->second.phase == Phase::waiting) std::erase(waiting_, key);
  started_.erase(key);
  entries_.erase(found);
}

void UnitQueue::add_lease(const v1::Lease& lease) {
  const auto shared = std::make_shared<const v1::Lease>(lease);
  credits_ = std::max(0, credits_ - lease.tile_count());
  for (std::int32_t i = 0; i < lease.tile_count(); ++i) {
    UnitKey key{lease.job_id(), {lease.frame(), lease.first_tile() + i, lease.pass()}};
    const auto [place, is_new] = entries_.try_emplace(key);
    Entry& entry = place->second;
    entry.lease = shared;
    if (is_new) {
      waiting_.push_back(std::move(key));
    } else if (entry.phase == Phase::unacknowledged && entry.offered) {
      entry.offered.reset();
      to_offer_.push_back(std::move(key));
    }
  }
}

const v1::Lease* UnitQueue::lease_of(const UnitKey& key) const {
  const auto found = entries_.find(key);
  return found == entries_.end() ? nullptr : found->second.lease.get();
}

std::vector<UnitKey> UnitQueue::revoke(const std::vector<UnitKey>& units) {
  std::vector<UnitKey> returned;
  for (const UnitKey& key : units) {
    if (find(key, Phase::waiting) == nullptr) continue;
    erase(key);
    returned.push_back(key);
  }
  return returned;
}

std::vector<UnitKey> UnitQueue::return_waiting() {
  std::vector<UnitKey> returned(waiting_.begin(), waiting_.end());
  for (const UnitKey& key : returned) entries_.erase(key);
  waiting_.clear();
  return returned;
}

void UnitQueue::start(const UnitKey& key) {
  Entry* entry = find(key, Phase::waiting);
  if (entry == nullptr) return;
  std::erase(waiting_, key);
  entry->phase = Phase::started;
  started_.insert(key);
}

void UnitQueue::requeue(const UnitKey& key) {
  Entry* entry = find(key, Phase::started);
  if (entry == nullptr) return;
  entry->phase = Phase::waiting;
  started_.erase(key);
  waiting_.push_front(key);
}

bool UnitQueue::finish(const UnitKey& key, std::string block, const contract::Digest& sha256,
                       double cpu_seconds, const contract::TraversalCounts& cost) {
  Entry* entry = find(key, Phase::started);
  if (entry == nullptr) return false;
  entry->phase = Phase::unacknowledged;
  started_.erase(key);
  entry->block = std::make_shared<const std::string>(std::move(block));
  entry->sha256 = sha256;
  entry->cpu_seconds = cpu_seconds;
  entry->cost = cost;
  to_offer_.push_back(key);
  return true;
}

std::optional<v1::UnitFailure> UnitQueue::fail(const UnitKey& key, const std::string& message,
                                               const std::string& log_tail, absl::StatusCode code) {
  const auto found = entries_.find(key);
  if (found == entries_.end() || found->second.phase == Phase::unacknowledged) return std::nullopt;
  v1::UnitFailure failure;
  *failure.mutable_lease() = *found->second.lease;
  failure.set_tile(key.unit.tile);
  failure.set_message(message);
  failure.set_log_tail(log_tail);
  failure.set_code(static_cast<std::int32_t>(code));
  erase(key);
  return failure;
}

std::vector<UnitKey> UnitQueue::started() const {
  return {started_.begin(), started_.end()};
}

std::optional<UnitQueue::Block> UnitQueue::next_block(Time now) {
  while (!to_offer_.empty()) {
    const UnitKey key = std::move(to_offer_.front());
    to_offer_.pop_front();
    Entry* entry = find(key, Phase::unacknowledged);
    if (entry == nullptr || entry->offered) continue;
    entry->offered = now;
    return Block{key, entry->lease, entry->block, entry->sha256, entry->cpu_seconds, entry->cost};
  }
  return std::nullopt;
}

std::optional<Time> UnitQueue::oldest_offer() const {
  std::optional<Time> oldest;
  for (const auto& [key, entry] : entries_) {
    if (entry.offered && (!oldest || *entry.offered < *oldest)) oldest = entry.offered;
  }
  return oldest;
}

void UnitQueue::reset_offers() {
  to_offer_.clear();
  for (auto& [key, entry] : entries_) {
    if (entry.phase != Phase::unacknowledged) continue;
    entry.offered.reset();
    to_offer_.push_back(key);
  }
}

std::optional<Time> UnitQueue::offered(const UnitKey& key) const {
  const auto found = entries_.find(key);
  return found == entries_.end() ? std::nullopt : found->second.offered;
}

bool UnitQueue::acknowledge(const UnitKey& key) {
  if (find(key, Phase::unacknowledged) == nullptr) return false;
  erase(key);
  return true;
}

void UnitQueue::fill_hello(v1::WorkerHello& hello, const CreditWindow& window) {
  return_waiting();
  std::set<const v1::Lease*> named;
  for (const auto& [key, entry] : entries_) {
    *(entry.phase == Phase::started ? hello.add_running() : hello.add_unacknowledged()) =
        id_of(key);
    if (named.insert(entry.lease.get()).second) *hello.add_leases() = *entry.lease;
  }
  hello.set_store_id(entries_.empty() ? "" : store_id_);
  credits_ = std::max(0, room(window));
  hello.set_credit_count(credits_);
}

void UnitQueue::set_store(const std::string& store_id) {
  if (store_id_ != store_id) {
    entries_.clear();
    waiting_.clear();
    started_.clear();
    to_offer_.clear();
  }
  store_id_ = store_id;
}

void UnitQueue::drop_job(const std::string& job_id) {
  std::erase_if(waiting_, [&](const UnitKey& key) { return key.job_id == job_id; });
  std::erase_if(started_, [&](const UnitKey& key) { return key.job_id == job_id; });
  std::erase_if(entries_, [&](const auto& entry) { return entry.first.job_id == job_id; });
}

std::int32_t UnitQueue::room(const CreditWindow& window) const {
  const auto under_way = std::count_if(entries_.begin(), entries_.end(), [](const auto& entry) {
    return entry.second.offered.has_value();
  });
  return std::min(window.prefetch_limit + static_cast<std::int32_t>(under_way),
                  window.in_flight_limit) -
         size();
}

std::int32_t UnitQueue::credits_to_grant(const CreditWindow& window) {
  const std::int32_t grant = std::max(0, room(window) - credits_);
  credits_ += grant;
  return grant;
}

CreditWindow credit_window(int thread_count, double ack_latency_seconds, double unit_seconds,
                           std::int64_t block_bytes, std::int64_t buffer_bytes) {
  constexpr double kMaxInFlight = 10'000;  // for units that take almost no time
  const double in_flight =
      unit_seconds > 0 ? std::ceil(thread_count * ack_latency_seconds / unit_seconds) : 0;
  const double wanted = 2.0 * thread_count + std::min(in_flight, kMaxInFlight);
  const std::int64_t fits =
      std::clamp<std::int64_t>(buffer_bytes / std::max<std::int64_t>(block_bytes, 1), 1, 1 << 30);
  return {static_cast<std::int32_t>(wanted), static_cast<std::int32_t>(fits)};
}

}  // namespace tessera::agent
