#include "server/schedule/queue/audit_queue.h"

namespace tessera::server {

void AuditQueue::insert(const std::string& tag, const Key& key, Audit& audit) {
  if (audit.group) return;
  audit.group = audit.is_disputed() ? "" : audit.committer();
  by_tag_[tag][*audit.group].insert(key);
  ++size_;
}

void AuditQueue::erase(const std::string& tag, const Key& key, Audit& audit) {
  if (!audit.group) return;
  const auto groups = by_tag_.find(tag);
  const auto group = groups->second.find(*audit.group);
  group->second.erase(key);
  if (group->second.empty()) groups->second.erase(group);
  if (groups->second.empty()) by_tag_.erase(groups);
  audit.group.reset();
  --size_;
}

const AuditQueue::Groups* AuditQueue::find(const std::string& tag) const {
  const auto found = by_tag_.find(tag);
  return found == by_tag_.end() ? nullptr : &found->second;
}

}  // namespace tessera::server
