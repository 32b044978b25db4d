#include "server/service/farm_service.h"

#include <chrono>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "rpc/rpc_status.h"
#include "server/service/finish.h"
#include "server/service/messages/account_messages.h"
#include "server/service/messages/field_checks.h"
#include "server/service/messages/message_budget.h"
#include "server/service/messages/messages.h"

namespace tessera::server {
namespace {

constexpr std::int64_t kMaxUnits = 1'000'000;
constexpr int kMaxUsagePage = 10'000, kMaxQuotaPage = 1000;

/// Adds up to `size` sums, and the token if there are more or the message is full.
void add_page(const std::vector<UsageSum>& sums, int size, v1::ListUsageResponse& response) {
  MessageBudget budget;
  for (const UsageSum& sum : sums) {
    v1::Usage usage = to_message(sum);
    if (response.usage_size() == size || !budget.add(usage)) break;
    *response.add_usage() = std::move(usage);
  }
  const auto count = static_cast<std::size_t>(response.usage_size());
  if (count < sums.size()) response.set_next_page_token(page_token_after(sums[count - 1]));
}

/// Returns whether the quota is about jobs and files, whose owners are known on every farm.
bool is_of_jobs(const QuotaKind& kind) {
  return kind.member == &ClientQuota::jobs || kind.member == &ClientQuota::gigasamples ||
         kind.member == &ClientQuota::gb || kind.member == &ClientQuota::stored_gb;
}

/// Returns a function that answers SetShare or ResetShare.
template <typename Response>
ClientShares::Answer answer_with(Response* response, grpc::ServerUnaryReactor* reactor) {
  return [response, reactor](const absl::StatusOr<ShareView>& share) {
    if (share.ok()) *response->mutable_share() = to_message(*share);
    reactor->Finish(contract::to_rpc(share.status()));
  };
}

}  // namespace

grpc::ServerUnaryReactor* FarmService::SetLimit(grpc::CallbackServerContext* context,
                                                const v1::SetLimitRequest* request,
                                                v1::SetLimitResponse* response) {
  absl::Status status = access_.admit(*context, "FarmService.SetLimit").status();
  if (status.ok()) status = check_name("name", request->name());
  if (status.ok() && (request->unit_count() < 0 || request->unit_count() > kMaxUnits)) {
    status = absl::InvalidArgumentError(
        absl::StrCat("unit_count: ", request->unit_count(), " is not in [0, ", kMaxUnits, "]"));
  }
  if (!status.ok()) return finish(context, status);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.settings().set_limit(request->name(), request->unit_count(),
                                    [=](const absl::StatusOr<LimitView>& limit) {
                                      if (limit.ok())
                                        *response->mutable_limit() = to_message(*limit);
                                      reactor->Finish(contract::to_rpc(limit.status()));
                                    });
  return reactor;
}

grpc::ServerUnaryReactor* FarmService::RemoveLimit(grpc::CallbackServerContext* context,
                                                   const v1::RemoveLimitRequest* request,
                                                   v1::RemoveLimitResponse* /*response*/) {
  const absl::Status status = access_.admit(*context, "FarmService.RemoveLimit").status();
  if (!status.ok()) return finish(context, status);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.settings().remove_limit(request->name(), [reactor](const absl::Status& removed) {
    reactor->Finish(contract::to_rpc(removed));
  });
  return reactor;
}

grpc::ServerUnaryReactor* FarmService::ListLimits(grpc::CallbackServerContext* context,
                                                  const v1::ListLimitsRequest* /*request*/,
                                                  v1::ListLimitsResponse* response) {
  const absl::Status status = access_.admit(*context, "FarmService.ListLimits").status();
  if (!status.ok()) return finish(context, status);
  for (const LimitView& limit : coordinator_.settings().limits()) {
    *response->add_limits() = to_message(limit);
  }
  return finish(context, absl::OkStatus());
}

grpc::ServerUnaryReactor* FarmService::SetShare(grpc::CallbackServerContext* context,
                                                const v1::SetShareRequest* request,
                                                v1::SetShareResponse* response) {
  absl::Status status = access_.admit(*context, "FarmService.SetShare").status();
  if (status.ok()) status = check_name("client", request->client());
  if (status.ok()) status = check_weight(request->weight());
  if (!status.ok()) return finish(context, status);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.shares().set(request->client(), request->weight(), answer_with(response, reactor));
  return reactor;
}

grpc::ServerUnaryReactor* FarmService::ResetShare(grpc::CallbackServerContext* context,
                                                  const v1::ResetShareRequest* request,
                                                  v1::ResetShareResponse* response) {
  const absl::Status status = access_.admit(*context, "FarmService.ResetShare").status();
  if (!status.ok()) return finish(context, status);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.shares().reset(request->client(), answer_with(response, reactor));
  return reactor;
}

grpc::ServerUnaryReactor* FarmService::ListShares(grpc::CallbackServerContext* context,
                                                  const v1::ListSharesRequest* /*request*/,
                                                  v1::ListSharesResponse* response) {
  const auto caller = access_.admit(*context, "FarmService.ListShares");
  if (!caller.ok()) return finish(context, caller.status());
  for (const ShareView& share : coordinator_.shares().list(caller->visible_owner())) {
    *response->add_shares() = to_message(share);
  }
  return finish(context, absl::OkStatus());
}

grpc::ServerUnaryReactor* FarmService::SetBudget(grpc::CallbackServerContext* context,
                                                 const v1::SetBudgetRequest* request,
                                                 v1::SetBudgetResponse* response) {
  const absl::Status status = access_.admit(*context, "FarmService.SetBudget").status();
  if (!status.ok()) return finish(context, status);
  const auto account = to_account(request->budget().scope(), request->budget().name());
  if (!account.ok()) return finish(context, account.status());
  const auto budget = from_message(request->budget());
  if (!budget.ok()) return finish(context, budget.status());
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.budgets().set(*account, *budget, [=](const absl::StatusOr<Budgets::Entry>& set) {
    if (set.ok()) *response->mutable_budget() = to_message(set->first, set->second);
    reactor->Finish(contract::to_rpc(set.status()));
  });
  return reactor;
}

grpc::ServerUnaryReactor* FarmService::RemoveBudget(grpc::CallbackServerContext* context,
                                                    const v1::RemoveBudgetRequest* request,
                                                    v1::RemoveBudgetResponse* /*response*/) {
  const absl::Status status = access_.admit(*context, "FarmService.RemoveBudget").status();
  if (!status.ok()) return finish(context, status);
  const auto account = to_account(request->scope(), request->name());
  if (!account.ok()) return finish(context, account.status());
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  coordinator_.budgets().remove(*account, [reactor](const absl::Status& removed) {
    reactor->Finish(contract::to_rpc(removed));
  });
  return reactor;
}

grpc::ServerUnaryReactor* FarmService::ListBudgets(grpc::CallbackServerContext* context,
                                                   const v1::ListBudgetsRequest* /*request*/,
                                                   v1::ListBudgetsResponse* response) {
  const auto caller = access_.admit(*context, "FarmService.ListBudgets");
  if (!caller.ok()) return finish(context, caller.status());
  for (const auto& [account, state] : coordinator_.budgets().list(caller->visible_owner())) {
    *response->add_budgets() = to_message(account, state);
  }
  return finish(context, absl::OkStatus());
}

grpc::ServerUnaryReactor* FarmService::ListUsage(grpc::CallbackServerContext* context,
                                                 const v1::ListUsageRequest* request,
                                                 v1::ListUsageResponse* response) {
  const auto caller = access_.admit(*context, "FarmService.ListUsage");
  if (!caller.ok()) return finish(context, caller.status());
  absl::Status status = check_range("page_size", request->page_size(), 0, kMaxUsagePage);
  auto query = from_message(*request);
  status.Update(query.status());
  if (!status.ok()) return finish(context, status);
  if (const std::string owner = caller->visible_owner(); !owner.empty()) {
    if (query->owner.value_or(owner) != owner) return finish(context, absl::OkStatus());
    query->owner = owner;
  }
  const int size = request->page_size() == 0 ? kMaxUsagePage : request->page_size();
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  io_.post([this, query = *std::move(query), size, response, reactor] {
    const auto sums = coordinator_.queries().usage(query, static_cast<std::size_t>(size) + 1);
    if (sums.ok()) add_page(*sums, size, *response);
    reactor->Finish(contract::to_rpc(sums.status()));
  });
  return reactor;
}

v1::ClientQuotas FarmService::quotas_of(const std::string& client, const OwnerUse& use) const {
  const auto now = std::chrono::steady_clock::now();
  const ClientLimits* limits = access_.limits();
  v1::ClientQuotas message;
  message.set_client(client);
  for (const QuotaKind& kind : kQuotaKinds) {
    v1::QuotaUse& quota = *message.add_quotas();
    quota.set_quota(kind.name);
    quota.set_used(use.of(kind) + (limits == nullptr ? 0 : limits->used(client, kind, now)));
    // Without certificates only quotas of jobs and files are in force.
    const bool is_in_force = limits != nullptr || is_of_jobs(kind);
    if (is_in_force) {
      quota.set_limit(coordinator_.farm().options().client_quotas.of(client).*kind.member);
    }
  }
  return message;
}

grpc::ServerUnaryReactor* FarmService::ListQuotas(grpc::CallbackServerContext* context,
                                                  const v1::ListQuotasRequest* request,
                                                  v1::ListQuotasResponse* response) {
  const auto caller = access_.admit(*context, "FarmService.ListQuotas");
  if (!caller.ok()) return finish(context, caller.status());
  const absl::Status status = check_range("page_size", request->page_size(), 0, kMaxQuotaPage);
  if (!status.ok()) return finish(context, status);
  std::set<std::string> clients;
  if (access_.limits() != nullptr) clients = access_.limits()->clients();
  if (!caller->visible_owner().empty()) clients.insert(caller->visible_owner());
  const auto uses = coordinator_.queries().quota_use(clients);
  const int size = request->page_size() == 0 ? kMaxQuotaPage : request->page_size();
  for (auto use = uses.upper_bound(request->page_token()); use != uses.end(); ++use) {
    if (!caller->visible_owner().empty() && use->first != caller->visible_owner()) continue;
    if (response->clients_size() == size) {
      response->set_next_page_token(response->clients(size - 1).client());
      break;
    }
    *response->add_clients() = quotas_of(use->first, use->second);
  }
  return finish(context, absl::OkStatus());
}

}  // namespace tessera::server
