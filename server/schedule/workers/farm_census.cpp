#include "server/schedule/workers/farm_census.h"

#include <algorithm>

namespace tessera::server {
namespace {

void take_one(std::map<std::string, std::int32_t>& counts, const std::string& name) {
  const auto found = counts.find(name);
  if (found != counts.end() && --found->second == 0) counts.erase(found);
}

}  // namespace

void FarmCensus::add(const std::string& tag, const Worker& worker) {
  Count& count = by_tag_[tag];
  count.threads += worker.thread_count;
  ++count.hosts[worker.host];
  ++count.witnesses[worker.witness];
}

void FarmCensus::remove(const std::string& tag, const Worker& worker) {
  const auto found = by_tag_.find(tag);
  if (found == by_tag_.end()) return;
  Count& count = found->second;
  count.threads -= worker.thread_count;
  take_one(count.hosts, worker.host);
  take_one(count.witnesses, worker.witness);
  if (count.hosts.empty()) by_tag_.erase(found);
}

void FarmCensus::add(const Worker& worker) {
  add("", worker);
  for (const std::string& served : worker.serves) add(served, worker);
}

void FarmCensus::remove(const Worker& worker) {
  remove("", worker);
  for (const std::string& served : worker.serves) remove(served, worker);
}

const FarmCensus::Count* FarmCensus::find(const std::string& tag) const {
  const auto found = by_tag_.find(tag);
  return found == by_tag_.end() ? nullptr : &found->second;
}

std::int32_t FarmCensus::threads(const std::string& tag) const {
  const Count* count = find(tag);
  return count == nullptr ? 1 : std::max(count->threads, 1);
}

bool FarmCensus::has_witness_beyond(const std::string& tag,
                                    const std::set<std::string>& asked) const {
  const Count* count = find(tag);
  if (count == nullptr) return false;
  const auto present = std::count_if(asked.begin(), asked.end(), [&](const std::string& witness) {
    return count->witnesses.count(witness) > 0;
  });
  return static_cast<std::size_t>(present) < count->witnesses.size();
}

}  // namespace tessera::server
