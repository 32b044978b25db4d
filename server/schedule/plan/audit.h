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
#include "server/schedule/plan/job_plan.h"

namespace tessera::server {

/// Returns whether a unit is drawn for an audit, with probability `fraction` in [0, 1]. The draw
/// uses the store's key, which no worker knows. Depends on its arguments only, so it survives a
/// restart.
bool is_drawn_for_audit(std::string_view store_key, const std::string& job_id,
                        const contract::Unit& unit, double fraction);

/// A committed unit that other workers render again, with their results
/// (docs/explanation/fault-tolerance.md).
///
/// Pixels are deterministic, so correct workers agree and none contradicts itself. Until two agree,
/// further workers are asked; if there are no others, those asked render the unit once more.
///
/// Results count by witness (witness_name()): workers with one certificate count as one.
class Audit {
 public:
  /// Starts with the committed result and its worker. An empty witness is the worker's ID.
  Audit(std::string committer, const contract::Digest& committed, std::string witness = {});

  const std::string& committer() const { return answers_.front().worker_id; }
  /// Names the committer's witness, if it was not known when the audit began.
  void set_committers_witness(const std::string& witness) { answers_.front().witness = witness; }
  std::set<std::string> witnesses() const;
  bool has_answered(const std::string& witness) const;
  /// Returns whether another result of this witness would help. `others`: whether there are
  /// witnesses that have not been asked yet.
  bool may_ask(const std::string& witness, bool others) const;
  void answer(const std::string& worker_id, const contract::Digest& digest,
              const std::string& witness = {});
  /// Ignores the results of a witness found faulty elsewhere. Not for the committer, whose unit is
  /// rendered again.
  void disregard(const std::string& witness);

  /// Forgets all results but the committed one.
  void restart();

  /// Returns whether results differ.
  bool is_disputed() const;
  /// Returns whether the correct result is known: two workers agree, or all but one contradict
  /// themselves.
  bool is_settled() const;
  /// Returns the workers with wrong results. Requires is_settled().
  std::vector<std::string> faulty_workers() const;

  std::optional<Holder> holder;      // worker that renders it now
  std::optional<Time> alone_since;   // since when no worker can be asked
  std::optional<std::string> group;  // under which it waits for a worker, see AuditQueue

 private:
  struct Answers {
    std::string worker_id, witness;
    std::vector<contract::Digest> digests;
    bool is_consistent() const;
  };
  /// Returns the result that two workers agree on, neither of which contradicts itself.
  std::optional<contract::Digest> agreed() const;
  int consistent_count() const;

  std::vector<Answers> answers_;  // in order of arrival
};

}  // namespace tessera::server
