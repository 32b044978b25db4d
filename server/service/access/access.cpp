#include "server/service/access/access.h"

#include <grpc/grpc_security_constants.h>
#include <grpcpp/security/auth_context.h>

#include <chrono>
#include <utility>

#include "absl/strings/str_cat.h"
#include "contract/digest.h"
#include "rpc/channel.h"
#include "server/service/quotas/call_context.h"

namespace tessera::server {
namespace {

// All rpcs. The rpcs themselves restrict roles further: clients see and change only their own jobs,
// workers read only jobs and assets of units leased to them.
constexpr AccessRule kRules[] = {
    // rpc, client, worker, is a stream
    {"JobService.CreateJob", true, false, false},
    {"JobService.GetJob", true, false, false},
    {"JobService.ListJobs", true, false, false},
    {"JobService.WatchJob", true, false, true},
    {"JobService.PauseJob", true, false, false},
    {"JobService.ResumeJob", true, false, false},
    {"JobService.CancelJob", true, false, false},
    {"JobService.RetryJob", true, false, false},
    {"JobService.RemoveJob", true, false, false},
    {"JobService.ExtendJob", true, false, false},
    {"JobService.UpdateJob", true, false, false},
    {"JobService.GetJobReport", true, false, true},
    {"JobService.ListDeliveries", true, false, false},
    {"JobService.FetchFrame", true, false, true},
    {"JobService.WatchEvents", true, false, true},
    {"AssetService.FindMissingAssets", true, false, false},
    {"AssetService.UploadAsset", true, false, true},
    {"AssetService.DownloadAsset", false, true, true},
    {"WorkerService.Work", false, true, true},
    {"WorkerService.Deliver", false, true, true},
    {"WorkerService.DescribeJob", false, true, false},
    {"WorkerService.ListWorkers", true, false, false},
    {"WorkerService.DrainWorker", false, false, false},
    {"WorkerService.BanWorker", false, false, false},
    {"WorkerService.AllowWorker", false, false, false},
    {"WorkerService.MoveWorker", false, false, false},
    {"WorkerService.SetAsideWorker", false, false, false},
    {"WorkerService.BringBackWorker", false, false, false},
    {"CertificateService.RenewCertificate", true, true, false},
    {"FarmService.SetLimit", false, false, false},
    {"FarmService.RemoveLimit", false, false, false},
    {"FarmService.ListLimits", true, false, false},
    {"FarmService.SetShare", false, false, false},
    {"FarmService.ResetShare", false, false, false},
    {"FarmService.ListShares", true, false, false},
    {"FarmService.SetBudget", false, false, false},
    {"FarmService.RemoveBudget", false, false, false},
    {"FarmService.ListBudgets", true, false, false},
    {"FarmService.ListUsage", true, false, false},
    {"FarmService.ListQuotas", true, false, false},
};

constexpr std::string_view kEventRpc = "JobService.WatchEvents";

using Clock = std::chrono::steady_clock;

std::int64_t now_s() {
  return std::chrono::duration_cast<std::chrono::seconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

bool may_call(const AccessRule& rule, Role role) {
  return role == Role::admin || (role == Role::client && rule.client) ||
         (role == Role::worker && rule.worker);
}

bool is_client(const Caller& caller) {
  return caller.identity && caller.identity->role == Role::client;
}

}  // namespace

const AccessRule* find_access_rule(std::string_view rpc) {
  for (const AccessRule& rule : kRules) {
    if (rpc == rule.rpc) return &rule;
  }
  return nullptr;
}

std::string sent_token(const grpc::CallbackServerContext& context) {
  const auto sent = context.client_metadata().find(contract::kTokenKey);
  if (sent == context.client_metadata().end()) return {};
  return {sent->second.data(), sent->second.size()};
}

Access::Access(std::unique_ptr<Revocations> revocations, ClientQuotas quotas,
               std::function<void(const QuotaKind&)> refused)
    : revocations_(std::move(revocations)),
      limits_(std::make_unique<ClientLimits>(std::move(quotas), std::move(refused))),
      streams_(std::make_unique<OpenStreams>()) {}

absl::StatusOr<Caller> Access::identify(const grpc::CallbackServerContext& context) const {
  if (revocations_) {
    const auto sent = context.auth_context()->FindPropertyValues(GRPC_X509_PEM_CERT_PROPERTY_NAME);
    if (sent.empty())
      return absl::UnauthenticatedError("this server requires a client certificate; pass --certs");
    auto identity = read_identity({sent.front().data(), sent.front().size()});
    if (!identity.ok()) return identity.status();
    Caller caller;
    caller.identity = *std::move(identity);
    if (absl::Status status = recheck(caller); !status.ok()) return status;
    return caller;
  }
  if (token_.empty()) return Caller{};
  const std::string token = sent_token(context);
  if (token.empty()) {
    return absl::UnauthenticatedError("this server needs the token in STORE/token");
  }
  if (contract::equal_in_constant_time(contract::sha256(token), contract::sha256(token_))) {
    return Caller{};
  }
  return absl::UnauthenticatedError("wrong token: this server's is in STORE/token");
}

/// Counts a client's call, and reserves its place among the calls in progress until it has ended.
/// Streams have places of their own.
absl::Status Access::count_call(grpc::CallbackServerContext& context, const std::string& client,
                                bool is_stream) const {
  const Clock::time_point now = Clock::now();
  absl::Status status = limits_->count_connection(client, context.peer(), now);
  absl::StatusOr<std::shared_ptr<const void>> place = nullptr;
  if (status.ok() && !is_stream) {
    place = limits_->reserve_call(client);
    status = place.status();
  }
  // Last, so that a call that is refused for another reason does not count towards the rate.
  if (status.ok()) status = limits_->count_call(client, now);
  auto* const call = dynamic_cast<CallContext*>(&context);  // null: the server limits no clients
  if (status.ok() && call != nullptr) call->hold(*std::move(place));
  if (can_be_retried(status)) context.AddTrailingMetadata(contract::kRetryKey, "");
  return status;
}

absl::StatusOr<Caller> Access::admit(grpc::CallbackServerContext& context,
                                     std::string_view rpc) const {
  auto caller = identify(context);
  if (!caller.ok()) return caller;
  const AccessRule* rule = find_access_rule(rpc);
  if (rule == nullptr) {
    return absl::PermissionDeniedError(absl::StrCat("no rule allows ", std::string(rpc)));
  }
  if (caller->identity && !may_call(*rule, caller->identity->role)) {
    return absl::PermissionDeniedError(absl::StrCat(role_name(caller->identity->role), " ",
                                                    caller->identity->name, " may not call ",
                                                    std::string(rpc)));
  }
  if (caller->identity && !is_client(*caller)) {
    limits_->note_connection(identity_uri(caller->identity->role, caller->identity->name),
                             context.peer(), Clock::now());
  }
  std::shared_ptr<const void> reservation;
  if (is_client(*caller)) {
    const std::string& client = caller->identity->name;
    if (absl::Status status = count_call(context, client, rule->is_stream); !status.ok()) {
      return status;
    }
    if (rule->is_stream) {
      auto reserved = limits_->reserve_stream(client, rpc == kEventRpc);
      if (!reserved.ok()) return reserved.status();
      reservation = *std::move(reserved);
    }
  }
  if (rule->is_stream && caller->identity) {
    using Places = std::pair<std::shared_ptr<const void>, std::shared_ptr<const void>>;
    caller->stream = std::make_shared<const Places>(streams_->add(context, *caller->identity),
                                                    std::move(reservation));
  }
  return caller;
}

void Access::cut_refused() const {
  if (!streams_) return;
  revocations_->update();
  limits_->connections().cut_refused(Clock::now());
  streams_->cut_refused(
      [this](const Identity& identity) {
        return recheck(Caller{identity, nullptr}).ok();
      },
      Clock::now());
}

absl::Status Access::count_upload(const Caller& caller, std::int64_t bytes) const {
  if (!is_client(caller)) return absl::OkStatus();
  return limits_->count_upload(caller.identity->name, bytes, Clock::now());
}

absl::Status Access::recheck(const Caller& caller) const {
  if (!caller.identity) return absl::OkStatus();
  const std::string uri = identity_uri(caller.identity->role, caller.identity->name);
  if (revocations_->contains(caller.identity->serial)) {
    return absl::UnauthenticatedError(absl::StrCat("the certificate of ", uri, " is revoked"));
  }
  if (now_s() > caller.identity->expires_s) {
    return absl::UnauthenticatedError(absl::StrCat("the certificate of ", uri, " has expired"));
  }
  return absl::OkStatus();
}

}  // namespace tessera::server
