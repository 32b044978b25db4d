#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>

#include "contract/unit.h"
#include "server/schedule/plan/audit.h"
#include "server/schedule/plan/job_spec.h"

namespace tessera::server {

/// Audits that wait for a worker, by required tag and by the worker whose result they check, so
/// that a worker does not walk those that it cannot answer. Pure.
class AuditQueue {
 public:
  using Key = std::pair<JobKey, contract::Unit>;
  /// Audits of one committer's units; "": disputed ones, of any committer.
  using Groups = std::map<std::string, std::set<Key>>;

  /// Harmless for an audit that waits.
  void insert(const std::string& tag, const Key& key, Audit& audit);
  /// Harmless for an audit that does not wait.
  void erase(const std::string& tag, const Key& key, Audit& audit);
  bool empty() const { return size_ == 0; }
  std::size_t size() const { return size_; }
  /// Null: no audit waits for workers with this tag.
  const Groups* find(const std::string& tag) const;
  const std::map<std::string, Groups>& by_tag() const { return by_tag_; }

 private:
  std::size_t size_ = 0;
  std::map<std::string, Groups> by_tag_;
};

}  // namespace tessera::server
