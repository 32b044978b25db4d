#include "client/api/farm_client.h"

#include <algorithm>
#include <condition_variable>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <mutex>
#include <set>
#include <thread>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/api/client_certificate.h"
#include "client/api/server_token.h"
#include "rpc/backoff.h"
#include "rpc/channel.h"
#include "rpc/protocol_version.h"
#include "rpc/rpc_status.h"
#include "tessera/v1/asset_service.grpc.pb.h"
#include "tessera/v1/farm_service.grpc.pb.h"
#include "tessera/v1/job_service.grpc.pb.h"
#include "tessera/v1/worker_service.grpc.pb.h"

namespace tessera::client {
namespace {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

constexpr milliseconds kCallTimeout{20'000};
constexpr milliseconds kRetryTimeout{60'000};
constexpr milliseconds kFirstPause{50}, kMaxPause{1'000};
constexpr milliseconds kWaitSlice{100};  // after which a wait looks whether it was cancelled
constexpr std::int64_t kChunkBytes = 1 << 20;
constexpr std::int64_t kSmallUploadBytes = 64 << 10;  // does not delay the answers to pings
constexpr std::size_t kAssetsPerCall = 10'000;        // 40 bytes each: far below a message's limit

class Client : public FarmClient {
 public:
  Client(std::string address, std::string token, const Connection& connection,
         const std::shared_ptr<grpc::Channel>& channel)
      : address_(std::move(address)),
        token_(std::move(token)),
        certs_(connection.certs),
        connect_timeout_(connection.connect_timeout),
        backoff_(kFirstPause, kMaxPause) {
    use(channel);
    if (certs_.empty() || absl::StartsWith(address_, "unix:")) return;
    certificate_ = std::make_unique<ClientCertificate>(certs_, [this] { return this->channel(); });
  }

  ~Client() override {
    Client::cancel();
    if (connecting_.joinable()) connecting_.join();
  }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  void start_connecting() override {
    connecting_ = std::thread([this, channel = channel()] {
      const Clock::time_point end = Clock::now() + connect_timeout_;
      while (!is_cancelled() && Clock::now() < end &&
             !channel->WaitForConnected(std::chrono::system_clock::now() + kWaitSlice)) {
      }
    });
  }

  absl::StatusOr<v1::CreateJobResponse> create_job(const v1::CreateJobRequest& request) override {
    v1::CreateJobRequest versioned = request;
    versioned.set_protocol_version(contract::kProtocolVersion);
    v1::CreateJobResponse response;
    absl::Status status = unary(jobs_, &v1::JobService::Stub::CreateJob, versioned, response);
    if (!status.ok()) return status;
    return response;
  }

  absl::StatusOr<v1::Job> get_job(const std::string& job) override {
    v1::GetJobRequest request;
    request.set_job(job);
    return job_of<v1::GetJobResponse>(&v1::JobService::Stub::GetJob, request);
  }

  absl::StatusOr<v1::ListJobsResponse> list_jobs(const v1::ListJobsRequest& request) override {
    v1::ListJobsResponse response;
    absl::Status status = unary(jobs_, &v1::JobService::Stub::ListJobs, request, response);
    if (!status.ok()) return status;
    return response;
  }

  absl::StatusOr<v1::Job> watch_job(const std::string& job_id, milliseconds interval,
                                    const std::function<bool(const v1::Job&)>& visit) override {
    v1::WatchJobRequest request;
    request.set_job_id(job_id);
    request.mutable_interval()->set_seconds(interval.count() / 1000);
    request.mutable_interval()->set_nanos(static_cast<int>(interval.count() % 1000) * 1'000'000);
    v1::Job last;
    const absl::Status status = retry(milliseconds(0), [&](grpc::ClientContext& context) {
      const auto stream = jobs_->WatchJob(&context, request);
      v1::WatchJobResponse response;
      while (stream->Read(&response)) {
        note_contact();
        last = std::move(*response.mutable_job());
        if (visit(last)) continue;
        context.TryCancel();
        return stream->Finish(), absl::OkStatus();
      }
      return contract::from_rpc(stream->Finish());
    });
    if (!status.ok()) return status;
    return last;
  }

  absl::StatusOr<v1::Job> pause_job(const std::string& job_id) override {
    return job_of<v1::PauseJobResponse>(&v1::JobService::Stub::PauseJob,
                                        naming<v1::PauseJobRequest>(job_id));
  }
  absl::StatusOr<v1::Job> resume_job(const std::string& job_id) override {
    return job_of<v1::ResumeJobResponse>(&v1::JobService::Stub::ResumeJob,
                                         naming<v1::ResumeJobRequest>(job_id));
  }
  absl::StatusOr<v1::Job> cancel_job(const std::string& job_id) override {
    return job_of<v1::CancelJobResponse>(&v1::JobService::Stub::CancelJob,
                                         naming<v1::CancelJobRequest>(job_id));
  }
  absl::StatusOr<v1::Job> retry_job(const std::string& job_id) override {
    return job_of<v1::RetryJobResponse>(&v1::JobService::Stub::RetryJob,
                                        naming<v1::RetryJobRequest>(job_id));
  }
  absl::Status remove_job(const std::string& job_id) override {
    v1::RemoveJobResponse response;
    return unary(jobs_, &v1::JobService::Stub::RemoveJob, naming<v1::RemoveJobRequest>(job_id),
                 response);
  }
  absl::StatusOr<v1::Job> extend_job(const std::string& job_id, std::int32_t sample_count,
                                     double error) override {
    auto request = naming<v1::ExtendJobRequest>(job_id);
    request.set_sample_count(sample_count);
    if (error > 0) request.set_error_target(error);
    return job_of<v1::ExtendJobResponse>(&v1::JobService::Stub::ExtendJob, request);
  }

  absl::StatusOr<v1::Job> update_job(const v1::UpdateJobRequest& request) override {
    return job_of<v1::UpdateJobResponse>(&v1::JobService::Stub::UpdateJob, request);
  }

  absl::StatusOr<std::string> get_report(const std::string& job_id) override {
    const auto request = naming<v1::GetJobReportRequest>(job_id);
    std::string report;
    const absl::Status status = retry(milliseconds(0), [&](grpc::ClientContext& context) {
      const auto stream = jobs_->GetJobReport(&context, request);
      report.clear();
      v1::GetJobReportResponse response;
      while (stream->Read(&response)) {
        note_contact();
        report += response.report_json();
      }
      return contract::from_rpc(stream->Finish());
    });
    if (!status.ok()) return status;
    return report;
  }

  absl::StatusOr<std::vector<v1::Delivery>> list_deliveries(const std::string& job_id) override {
    std::vector<v1::Delivery> deliveries;
    v1::ListDeliveriesRequest request;
    request.set_job_id(job_id);
    do {
      v1::ListDeliveriesResponse response;
      absl::Status status = unary(jobs_, &v1::JobService::Stub::ListDeliveries, request, response);
      if (!status.ok()) return status;
      deliveries.insert(deliveries.end(), response.deliveries().begin(),
                        response.deliveries().end());
      request.set_page_token(response.next_page_token());
    } while (!request.page_token().empty());
    return deliveries;
  }

  absl::Status fetch_frame(const v1::FetchFrameRequest& request, const FrameSink& sink) override {
    return retry(milliseconds(0), [&](grpc::ClientContext& context) {
      const auto stream = jobs_->FetchFrame(&context, request);
      v1::FetchFrameResponse response;
      v1::FrameHeader header;  // with all missing tiles once the first chunk is here
      bool has_header = false, has_started = false;
      absl::Status kept;
      while (kept.ok() && stream->Read(&response)) {
        note_contact();  // a download may break after it has lasted longer than the time limit
        if (response.has_header()) {
          header = std::move(*response.mutable_header());
          has_header = true;
          continue;
        }
        if (response.has_more_missing_tiles()) {
          header.mutable_missing_tiles()->MergeFrom(response.more_missing_tiles().tiles());
          continue;
        }
        if (!std::exchange(has_started, true)) kept = sink.start(header);
        if (kept.ok()) kept = sink.write(response.chunk());
      }
      if (!kept.ok()) {
        context.TryCancel();
        stream->Finish();
        return kept;
      }
      const absl::Status status = contract::from_rpc(stream->Finish());
      return status.ok() && has_header && !has_started ? sink.start(header) : status;
    });
  }

  absl::Status watch_events(v1::WatchEventsRequest request,
                            const std::function<bool(const v1::Event&)>& visit) override {
    return retry(milliseconds(0), [&](grpc::ClientContext& context) {
      const auto stream = jobs_->WatchEvents(&context, request);
      v1::WatchEventsResponse response;
      while (stream->Read(&response)) {
        note_contact();
        for (const v1::Event& event : response.events()) {
          request.set_after_sequence(event.sequence());
          if (visit(event)) continue;
          context.TryCancel();
          return stream->Finish(), absl::OkStatus();
        }
      }
      return contract::from_rpc(stream->Finish());
    });
  }

  absl::Status drain_worker(const std::string& worker_id) override {
    return order(&v1::WorkerService::Stub::DrainWorker, worker_id).status();
  }
  absl::StatusOr<std::vector<std::string>> ban_worker(const std::string& worker_id) override {
    const auto banned = order(&v1::WorkerService::Stub::BanWorker, worker_id);
    if (!banned.ok()) return banned.status();
    return std::vector<std::string>(banned->worker_ids().begin(), banned->worker_ids().end());
  }
  absl::Status allow_worker(const std::string& worker_id) override {
    return order(&v1::WorkerService::Stub::AllowWorker, worker_id).status();
  }

  absl::Status move_worker(const std::string& worker_id, const std::string& pool) override {
    v1::MoveWorkerRequest request;
    request.set_worker_id(worker_id);
    request.set_pool(pool);
    v1::MoveWorkerResponse response;
    return unary(workers_, &v1::WorkerService::Stub::MoveWorker, request, response);
  }

  absl::Status set_aside_worker(const std::string& worker_id, const std::string& reason) override {
    v1::SetAsideWorkerRequest request;
    request.set_worker_id(worker_id);
    request.set_reason(reason);
    v1::SetAsideWorkerResponse response;
    return unary(workers_, &v1::WorkerService::Stub::SetAsideWorker, request, response);
  }
  absl::Status bring_back_worker(const std::string& worker_id) override {
    return order(&v1::WorkerService::Stub::BringBackWorker, worker_id).status();
  }

  absl::StatusOr<v1::Budget> set_budget(const v1::Budget& budget) override {
    v1::SetBudgetRequest request;
    *request.mutable_budget() = budget;
    v1::SetBudgetResponse response;
    absl::Status status = unary(farm_, &v1::FarmService::Stub::SetBudget, request, response);
    if (!status.ok()) return status;
    return response.budget();
  }
  absl::Status remove_budget(v1::Budget::Scope scope, const std::string& name) override {
    v1::RemoveBudgetRequest request;
    request.set_scope(scope);
    request.set_name(name);
    v1::RemoveBudgetResponse response;
    return unary(farm_, &v1::FarmService::Stub::RemoveBudget, request, response);
  }
  absl::StatusOr<std::vector<v1::Budget>> list_budgets() override {
    v1::ListBudgetsResponse response;
    absl::Status status =
        unary(farm_, &v1::FarmService::Stub::ListBudgets, v1::ListBudgetsRequest(), response);
    if (!status.ok()) return status;
    return std::vector<v1::Budget>(response.budgets().begin(), response.budgets().end());
  }
  absl::StatusOr<std::vector<v1::Usage>> list_usage(v1::ListUsageRequest request) override {
    std::vector<v1::Usage> usage;
    do {
      v1::ListUsageResponse page;
      absl::Status status = unary(farm_, &v1::FarmService::Stub::ListUsage, request, page);
      if (!status.ok()) return status;
      std::move(page.mutable_usage()->begin(), page.mutable_usage()->end(),
                std::back_inserter(usage));
      request.set_page_token(page.next_page_token());
    } while (!request.page_token().empty());
    return usage;
  }

  absl::StatusOr<std::vector<v1::ClientQuotas>> list_quotas() override {
    std::vector<v1::ClientQuotas> clients;
    v1::ListQuotasRequest request;
    do {
      v1::ListQuotasResponse page;
      absl::Status status = unary(farm_, &v1::FarmService::Stub::ListQuotas, request, page);
      if (!status.ok()) return status;
      std::move(page.mutable_clients()->begin(), page.mutable_clients()->end(),
                std::back_inserter(clients));
      request.set_page_token(page.next_page_token());
    } while (!request.page_token().empty());
    return clients;
  }

  absl::StatusOr<v1::Limit> set_limit(const std::string& name, std::int64_t units) override {
    v1::SetLimitRequest request;
    request.set_name(name);
    request.set_unit_count(units);
    v1::SetLimitResponse response;
    absl::Status status = unary(farm_, &v1::FarmService::Stub::SetLimit, request, response);
    if (!status.ok()) return status;
    return response.limit();
  }
  absl::Status remove_limit(const std::string& name) override {
    v1::RemoveLimitRequest request;
    request.set_name(name);
    v1::RemoveLimitResponse response;
    return unary(farm_, &v1::FarmService::Stub::RemoveLimit, request, response);
  }
  absl::StatusOr<std::vector<v1::Limit>> list_limits() override {
    v1::ListLimitsResponse response;
    absl::Status status =
        unary(farm_, &v1::FarmService::Stub::ListLimits, v1::ListLimitsRequest(), response);
    if (!status.ok()) return status;
    return std::vector<v1::Limit>(response.limits().begin(), response.limits().end());
  }

  absl::StatusOr<v1::ClientShare> set_share(const std::string& name, double weight) override {
    v1::SetShareRequest request;
    request.set_client(name);
    request.set_weight(weight);
    v1::SetShareResponse response;
    absl::Status status = unary(farm_, &v1::FarmService::Stub::SetShare, request, response);
    if (!status.ok()) return status;
    return response.share();
  }
  absl::StatusOr<v1::ClientShare> reset_share(const std::string& name) override {
    v1::ResetShareRequest request;
    request.set_client(name);
    v1::ResetShareResponse response;
    absl::Status status = unary(farm_, &v1::FarmService::Stub::ResetShare, request, response);
    if (!status.ok()) return status;
    return response.share();
  }
  absl::StatusOr<std::vector<v1::ClientShare>> list_shares() override {
    v1::ListSharesResponse response;
    absl::Status status =
        unary(farm_, &v1::FarmService::Stub::ListShares, v1::ListSharesRequest(), response);
    if (!status.ok()) return status;
    return std::vector<v1::ClientShare>(response.shares().begin(), response.shares().end());
  }

  absl::StatusOr<std::vector<v1::Worker>> list_workers() override {
    std::vector<v1::Worker> workers;
    v1::ListWorkersRequest request;
    do {
      v1::ListWorkersResponse page;
      absl::Status status = unary(workers_, &v1::WorkerService::Stub::ListWorkers, request, page);
      if (!status.ok()) return status;
      std::move(page.mutable_workers()->begin(), page.mutable_workers()->end(),
                std::back_inserter(workers));
      request.set_page_token(page.next_page_token());
    } while (!request.page_token().empty());
    return workers;
  }

  absl::StatusOr<std::vector<v1::AssetId>> find_missing_assets(
      const std::vector<v1::AssetId>& assets) override {
    std::vector<v1::AssetId> missing;
    for (std::size_t first = 0; first < assets.size(); first += kAssetsPerCall) {
      v1::FindMissingAssetsRequest request;
      const std::size_t end = std::min(assets.size(), first + kAssetsPerCall);
      for (std::size_t i = first; i < end; ++i) *request.add_assets() = assets[i];
      v1::FindMissingAssetsResponse response;
      absl::Status status =
          unary(assets_, &v1::AssetService::Stub::FindMissingAssets, request, response);
      if (!status.ok()) return status;
      missing.insert(missing.end(), response.missing().begin(), response.missing().end());
    }
    return missing;
  }

  absl::Status upload_asset(const v1::AssetId& asset, const std::string& path) override {
    const bool is_small = asset.size_bytes() <= kSmallUploadBytes;
    return retry(milliseconds(0), [&](grpc::ClientContext& context) {
      if (!is_small) {
        if (absl::Status status = open_uploads(); !status.ok()) return status;
      }
      v1::AssetService::Stub& stub = is_small ? *assets_ : *uploads_;
      std::ifstream file(path, std::ios::binary);
      if (!file) return absl::NotFoundError(absl::StrCat(path, ": cannot read the file"));
      v1::UploadAssetResponse response;
      const auto stream = stub.UploadAsset(&context, &response);
      v1::UploadAssetRequest request;
      *request.mutable_asset() = asset;
      bool open = stream->Write(request);
      std::string chunk(static_cast<std::size_t>(is_small ? kSmallUploadBytes : kChunkBytes), '\0');
      while (open && (file.read(chunk.data(), static_cast<std::streamsize>(chunk.size())) ||
                      file.gcount() > 0)) {
        request.set_chunk(chunk.data(), static_cast<std::size_t>(file.gcount()));
        open = stream->Write(request);
      }
      stream->WritesDone();
      absl::Status status = contract::from_rpc(stream->Finish());
      if (status.ok() || !absl::IsInvalidArgument(status)) return status;
      return absl::InvalidArgumentError(
          absl::StrCat(path, ": ", std::string(status.message()), " (has the file changed?)"));
    });
  }

  void cancel() override {
    const std::lock_guard lock(mutex_);
    cancelled_ = true;
    for (grpc::ClientContext* context : running_) context->TryCancel();
    wake_.notify_all();
  }

 private:
  template <typename Request>
  static Request naming(const std::string& job_id) {
    Request request;
    request.set_job_id(job_id);
    return request;
  }

  /// Large uploads have a connection of their own: on a slow line they delay the answers to pings.
  absl::Status open_uploads() {
    if (uploads_ != nullptr) return absl::OkStatus();
    const auto channel = contract::open_channel(address_, certs_, contract::Keepalive::bulk);
    if (channel.ok()) uploads_ = v1::AssetService::NewStub(*channel);
    return channel.status();
  }

  template <typename Response, typename Method, typename Request>
  absl::StatusOr<v1::Job> job_of(Method method, const Request& request) {
    Response response;
    absl::Status status = unary(jobs_, method, request, response);
    if (!status.ok()) return status;
    return std::move(*response.mutable_job());
  }

  template <typename Request, typename Response>
  absl::StatusOr<Response> order(grpc::Status (v1::WorkerService::Stub::*method)(
                                     grpc::ClientContext*, const Request&, Response*),
                                 const std::string& worker_id) {
    Request request;
    request.set_worker_id(worker_id);
    absl::StatusOr<Response> response = Response();
    absl::Status status = unary(workers_, method, request, *response);
    return status.ok() ? response : status;
  }

  template <typename Stub, typename Method, typename Request, typename Response>
  absl::Status unary(const std::unique_ptr<Stub>& stub, Method method, const Request& request,
                     Response& response) {
    return retry(kCallTimeout, [&](grpc::ClientContext& context) {
      return contract::from_rpc(((*stub).*method)(&context, request, &response));
    });
  }

  std::shared_ptr<grpc::Channel> channel() {
    const std::lock_guard lock(mutex_);
    return channel_;
  }

  void use(const std::shared_ptr<grpc::Channel>& channel) {
    jobs_ = v1::JobService::NewStub(channel);
    assets_ = v1::AssetService::NewStub(channel);
    workers_ = v1::WorkerService::NewStub(channel);
    farm_ = v1::FarmService::NewStub(channel);
    uploads_.reset();
    const std::lock_guard lock(mutex_);
    channel_ = channel;
  }

  /// Connects again if there is a new certificate: a connection ends with the one that it has.
  /// Returns whether it did.
  bool use_new_certificate() {
    if (certificate_ == nullptr) return false;
    if (!certificate_->is_replaced(std::chrono::system_clock::now())) return false;
    const auto opened = contract::open_channel(address_, certs_);
    if (!opened.ok()) return false;  // the next attempt tries again
    use(*opened);
    certificate_->note_connected();
    return true;
  }

  /// Runs `attempt` until it returns another status than Unavailable, or the time limit has passed.
  template <typename Attempt>
  absl::Status retry(milliseconds timeout, const Attempt& attempt) {
    if (certificate_ != nullptr) certificate_->start(connect_timeout_);
    Clock::time_point start = Clock::now();
    backoff_.reset();
    while (true) {
      use_new_certificate();
      const std::int64_t contacts_before = contacts_;
      absl::Status status = run_once(timeout, attempt);
      if (is_cancelled()) return absl::CancelledError("interrupted");
      if (!status.ok() && certificate_ != nullptr) {
        const bool is_ended = absl::IsUnauthenticated(status) || absl::IsCancelled(status);
        if (is_ended && use_new_certificate()) continue;  // the old one has expired
        status = certificate_->explain(status, std::chrono::system_clock::now());
      }
      if (!absl::IsUnavailable(status)) {
        note_contact();
        if (!absl::IsUnimplemented(status)) return status;
        return absl::FailedPreconditionError(absl::StrCat(
            "the server at ", address_, " does not offer this call: it is older than this ",
            "client; upgrade the server"));
      }
      if (contacts_ != contacts_before) {  // the stream worked before it broke
        start = Clock::now();
        backoff_.reset();
      }
      if (Clock::now() - start > (contacts_ > 0 ? kRetryTimeout : connect_timeout_)) {
        return absl::UnavailableError(
            absl::StrCat("no server answers at ", address_, ": ", std::string(status.message())));
      }
      wait(backoff_.next());
    }
  }

  template <typename Attempt>
  absl::Status run_once(milliseconds timeout, const Attempt& attempt) {
    grpc::ClientContext context;
    contract::prepare_call(context, token_, timeout);
    {
      const std::lock_guard lock(mutex_);
      if (cancelled_) return absl::CancelledError("interrupted");
      running_.insert(&context);
    }
    absl::Status status = attempt(context);
    if (contract::is_refused_for_now(context)) status = absl::UnavailableError(status.message());
    const std::lock_guard lock(mutex_);
    running_.erase(&context);
    return status;
  }

  /// Waits for `pause`, or until a lost connection has been made again. gRPC works on a
  /// connection only while somebody waits for it.
  void wait(milliseconds pause) {
    const Clock::time_point end = Clock::now() + pause;
    const bool was_connected = channel()->GetState(true) == GRPC_CHANNEL_READY;
    while (!is_cancelled()) {
      const auto left = std::chrono::duration_cast<milliseconds>(end - Clock::now());
      if (left.count() <= 0) return;
      const milliseconds slice = std::min(left, kWaitSlice);
      if (was_connected) {
        std::unique_lock lock(mutex_);
        wake_.wait_for(lock, slice, [this] { return cancelled_; });
      } else if (channel()->WaitForConnected(std::chrono::system_clock::now() + slice)) {
        return;
      }
    }
  }

  bool is_cancelled() {
    const std::lock_guard lock(mutex_);
    return cancelled_;
  }

  void note_contact() { ++contacts_; }

  const std::string address_, token_, certs_;
  const milliseconds connect_timeout_;
  std::unique_ptr<v1::JobService::Stub> jobs_;
  std::unique_ptr<v1::AssetService::Stub> assets_;
  std::unique_ptr<v1::WorkerService::Stub> workers_;
  std::unique_ptr<v1::FarmService::Stub> farm_;
  std::unique_ptr<v1::AssetService::Stub> uploads_;  // null before the first large upload
  std::thread connecting_;
  contract::Backoff backoff_;
  std::int64_t contacts_ = 0;

  std::mutex mutex_;                        // guards what follows
  std::shared_ptr<grpc::Channel> channel_;  // owners: this and the stubs
  std::condition_variable wake_;
  std::set<grpc::ClientContext*> running_;
  bool cancelled_ = false;

  std::unique_ptr<ClientCertificate> certificate_;  // null without TLS; its thread uses the channel
};

}  // namespace

absl::StatusOr<std::unique_ptr<FarmClient>> FarmClient::connect(const Connection& connection) {
  const std::string address = connection.server.empty() ? default_server() : connection.server;
  auto token = read_token(connection.token_file);
  if (!token.ok()) return token.status();
  const auto channel = contract::open_channel(address, connection.certs);
  if (!channel.ok()) return channel.status();
  return std::make_unique<Client>(address, *std::move(token), connection, *channel);
}

}  // namespace tessera::client
