#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "contract/digest.h"
#include "contract/unit.h"
#include "server/schedule/job_plan.h"

namespace tessera::server {

/// Whether a unit is to be audited: drawn by the store's key, which no worker knows, with
/// probability `fraction` in [0, 1]. A function of its arguments, so a draw survives a restart.
bool is_drawn_for_audit(std::string_view store_key, const std::string& job_id,
                        const contract::Unit& unit, double fraction);

/// A committed unit that other workers render again, and their results (farm.md, section 8).
///
/// Pixels are deterministic, so honest workers agree and none contradicts itself. Until two agree,
/// further workers are asked; when there are no others, those who were asked render once more.
class Audit {
 public:
  /// The worker whose result is committed comes first.
  Audit(std::string committer, const contract::Digest& committed);

  const std::string& committer() const { return answers_.front().worker_id; }
  bool has_answered(const std::string& worker_id) const;
  /// Whether a further result of this worker would help. `others`: there are workers that were not
  /// asked yet.
  bool may_ask(const std::string& worker_id, bool others) const;
  void answer(const std::string& worker_id, const contract::Digest& digest);
  /// The worker was found lying elsewhere: what it said counts no more. Not of the committer, whose
  /// unit is rendered again.
  void disregard(const std::string& worker_id);

  /// Whether results differ.
  bool is_disputed() const;
  /// Whether it is known who is right: two workers agree, or all but one contradict themselves.
  bool is_settled() const;
  /// Who lies, once settled.
  std::vector<std::string> faulty_workers() const;

  std::optional<Holder> holder;     // who renders it now
  std::optional<Time> alone_since;  // when there was nobody to ask any more

 private:
  struct Answers {
    std::string worker_id;
    std::vector<contract::Digest> digests;
    bool is_consistent() const;
  };
  /// The result that two workers agree on, who do not contradict themselves.
  std::optional<contract::Digest> agreed() const;
  int consistent_count() const;

  std::vector<Answers> answers_;  // in the order they came
};

}  // namespace tessera::server
