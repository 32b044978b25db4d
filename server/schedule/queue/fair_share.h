#pragma once

#include <map>
#include <string>
#include <vector>

#include "server/schedule/plan/job_spec.h"

namespace tessera::server {

/// Range of weights that operators may give to owners.
inline constexpr double kMinWeight = 1e-3, kMaxWeight = 1e3;

/// An owner's use of the farm, decayed to the time of the table.
struct UsageRow {
  std::string owner;
  double cpu_seconds = 0;
};

/// CPU seconds that owners have used, divided by their weights. Use decays: it is halved in each
/// half-life, whether its job has ended or not.
///
/// All use decays at the same rate, so the order of owners changes only with charges. Therefore a
/// position is the use scaled by 2^(age of the table / half-life): positions are constant while
/// nothing is charged, and comparable with each other.
///
/// A new weight counts for later charges and leaves the position as it is. If past use were divided
/// by it too, the owner would get the whole farm, or nothing, until the others had caught up. Pure.
class FairShare {
 public:
  /// Requires half_life > 0 and positive weights. An owner without a weight has 1.
  FairShare(Duration half_life, std::map<std::string, double> weights, Time start);

  double weight(const std::string& owner) const;
  /// Requires a positive weight. Charges from before cannot be taken back exactly afterwards.
  void set_weight(const std::string& owner, double weight);
  /// Use per weight, scaled; 0 for an owner without use.
  double position(const std::string& owner) const;
  /// Returns the change of the owner's position for CPU seconds used at `when`.
  double step(const std::string& owner, double cpu_seconds, Time when) const;
  /// Adds CPU seconds used at `when`. Negative: takes back a charge, whose `when` is given again.
  void charge(const std::string& owner, double cpu_seconds, Time when);
  /// Decayed use per weight, CPU seconds.
  double usage(const std::string& owner, Time now) const;
  /// Decayed use, CPU seconds: what gives the owner's position with its present weight.
  double cpu_seconds(const std::string& owner, Time now) const;

  /// Returns the use of all owners, for restore() in the next process.
  std::vector<UsageRow> table(Time now) const;
  void restore(const std::vector<UsageRow>& table, Time now);

  /// Returns whether positions have grown so much that rebase() must be called.
  bool needs_rebase(Time now) const;
  /// Multiplies all positions by a factor so that they stay finite, and returns the factor.
  double rebase(Time now);
  /// Forgets owners whose use has decayed to less than a millisecond.
  void forget_faded(Time now);
  std::size_t size() const { return positions_.size(); }

 private:
  double scale(Time when) const;

  Duration half_life_;
  std::map<std::string, double> weights_;
  Time epoch_;  // when the scale is 1
  std::map<std::string, double> positions_;
};

}  // namespace tessera::server
