#include "server/schedule/queue/fair_share.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tessera::server {
namespace {

constexpr double kMaxExponent = 256;    // half-lives between two rebases
constexpr double kFadedSeconds = 1e-3;  // use that no longer matters

}  // namespace

FairShare::FairShare(Duration half_life, std::map<std::string, double> weights, Time start)
    : half_life_(half_life), weights_(std::move(weights)), epoch_(start) {}

double FairShare::scale(Time when) const {
  return std::exp2(seconds(when - epoch_) / seconds(half_life_));
}

double FairShare::weight(const std::string& owner) const {
  const auto found = weights_.find(owner);
  return found == weights_.end() ? 1 : found->second;
}

void FairShare::set_weight(const std::string& owner, double weight) {
  weights_[owner] = weight;
}

double FairShare::position(const std::string& owner) const {
  const auto found = positions_.find(owner);
  return found == positions_.end() ? 0 : found->second;
}

double FairShare::step(const std::string& owner, double cpu_seconds, Time when) const {
  return cpu_seconds * scale(when) / weight(owner);
}

void FairShare::charge(const std::string& owner, double cpu_seconds, Time when) {
  double& position = positions_[owner];
  position = std::max(position + step(owner, cpu_seconds, when), 0.0);
}

double FairShare::usage(const std::string& owner, Time now) const {
  return position(owner) / scale(now);
}

double FairShare::cpu_seconds(const std::string& owner, Time now) const {
  return usage(owner, now) * weight(owner);
}

std::vector<UsageRow> FairShare::table(Time now) const {
  std::vector<UsageRow> table;
  table.reserve(positions_.size());
  for (const auto& [owner, position] : positions_)
    table.push_back({owner, cpu_seconds(owner, now)});
  return table;
}

void FairShare::restore(const std::vector<UsageRow>& table, Time now) {
  positions_.clear();
  for (const UsageRow& use : table) charge(use.owner, use.cpu_seconds, now);
}

bool FairShare::needs_rebase(Time now) const {
  return seconds(now - epoch_) > kMaxExponent * seconds(half_life_);
}

double FairShare::rebase(Time now) {
  const double factor = 1 / scale(now);
  epoch_ = now;
  for (auto& [owner, position] : positions_) position *= factor;
  return factor;
}

void FairShare::forget_faded(Time now) {
  for (auto it = positions_.begin(); it != positions_.end();) {
    const bool is_faded = cpu_seconds(it->first, now) < kFadedSeconds;
    it = is_faded ? positions_.erase(it) : std::next(it);
  }
}

}  // namespace tessera::server
