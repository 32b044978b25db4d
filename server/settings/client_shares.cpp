#include "server/settings/client_shares.h"

#include <set>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "server/schedule/queue/fair_share.h"

namespace tessera::server {
namespace {

std::string exact(double value) {
  return absl::StrFormat("%.17g", value);
}

Settings weight_rows(const std::map<std::string, double>& weights) {
  Settings rows;
  for (const auto& [client, weight] : weights) rows[client] = exact(weight);
  return rows;
}

Settings use_rows(const std::vector<UsageRow>& table) {
  Settings rows;
  for (const UsageRow& use : table) rows[use.owner] = exact(use.cpu_seconds);
  return rows;
}

}  // namespace

absl::Status ClientShares::load(FarmChange& change) {
  const auto shares = store_.settings().read(SettingKind::share);
  if (!shares.ok()) return shares.status();
  for (const auto& [client, value] : *shares) {
    double weight = 0;
    if (!absl::SimpleAtod(value, &weight) || !(weight >= kMinWeight && weight <= kMaxWeight)) {
      continue;
    }
    set_[client] = weight;
    change.scheduler().limits().set_weight(client, weight, change.now());
  }
  const auto use = store_.settings().read(SettingKind::use);
  if (!use.ok()) return use.status();
  std::vector<UsageRow> table;
  for (const auto& [owner, value] : *use) {
    double cpu_seconds = 0;
    if (absl::SimpleAtod(value, &cpu_seconds)) table.push_back({owner, cpu_seconds});
  }
  change.scheduler().limits().restore_usage(table, change.now());  // divides by the weights
  return absl::OkStatus();
}

ShareView ClientShares::view_of(const FarmView& farm, const std::string& client) const {
  const FairShare& share = farm.scheduler().limits().share();
  ShareSource source = ShareSource::by_default;
  if (options().count(client) > 0) source = ShareSource::option;
  if (set_.count(client) > 0) source = ShareSource::set;
  return {client, share.weight(client), source, share.usage(client, farm.now())};
}

std::vector<ShareView> ClientShares::list(const std::string& client) const {
  const FarmView view(farm_);
  std::set<std::string> clients;
  for (const Weights* weights : {&options(), &set_}) {
    for (const auto& [name, weight] : *weights) {
      if (client.empty() || name == client) clients.insert(name);
    }
  }
  std::vector<ShareView> shares;
  shares.reserve(clients.size());
  for (const std::string& name : clients) shares.push_back(view_of(view, name));
  return shares;
}

void ClientShares::set(const std::string& client, double weight, Answer done) {
  pipeline_.post([this, client, weight, done = std::move(done)] { done(set_now(client, weight)); });
}

absl::StatusOr<ShareView> ClientShares::set_now(const std::string& client, double weight) {
  Weights weights;
  {
    const FarmView view(farm_);
    weights = set_;
  }
  weights[client] = weight;
  if (weights.size() > kMaxSet) {
    return absl::ResourceExhaustedError(
        absl::StrCat("the weights of ", kMaxSet, " clients are set already"));
  }
  return change_now(client, std::move(weights));
}

void ClientShares::reset(const std::string& client, Answer done) {
  pipeline_.post([this, client, done = std::move(done)] { done(reset_now(client)); });
}

absl::StatusOr<ShareView> ClientShares::reset_now(const std::string& client) {
  Weights weights;
  {
    const FarmView view(farm_);
    weights = set_;
  }
  if (weights.erase(client) == 0) {
    return absl::NotFoundError(absl::StrCat("the weight of client \"", client, "\" is not set"));
  }
  return change_now(client, std::move(weights));
}

/// Replaces the set weights, which differ in that of `client`. The rows of use depend on the
/// weights, so both are written in one transaction; the weights last, as the parts of a transaction
/// fail one by one.
absl::StatusOr<ShareView> ClientShares::change_now(const std::string& client, Weights weights) {
  double weight = 1;
  for (const Weights* source : {&options(), &std::as_const(weights)}) {
    if (const auto found = source->find(client); found != source->end()) weight = found->second;
  }
  Settings use;
  {
    const FarmView view(farm_);
    FairShare share = view.scheduler().limits().committed_share();
    share.set_weight(client, weight);
    use = use_rows(share.table(view.now()));
  }
  const absl::Status saved = pipeline_.write_apart([&] {
    const absl::Status status = store_.settings().save(SettingKind::use, use);
    return status.ok() ? store_.settings().save(SettingKind::share, weight_rows(weights)) : status;
  });
  if (!saved.ok()) return saved;
  FarmChange change(farm_);
  set_ = std::move(weights);
  change.scheduler().limits().set_weight(client, weight, change.now());
  ShareView share = view_of(change, client);
  change.log(LogLevel::info,
             absl::StrCat("client ", client, " has weight ", weight,
                          share.source == ShareSource::set ? "" : ", which is no longer set"));
  return share;
}

void ClientShares::write_use(FarmChange& change) {
  pipeline_.post_write(
      [this, rows = use_rows(change.scheduler().limits().usage(change.now()))] {
        return store_.settings().save(SettingKind::use, rows);
      },
      [this](const absl::Status& status) {
        if (status.ok()) return;
        farm_.log(LogLevel::error, absl::StrCat("use of clients: ", status.ToString()));
      });
}

}  // namespace tessera::server
