// The number of calls that a client may have in progress.
#include <grpcpp/generic/generic_stub.h>

#include <chrono>
#include <condition_variable>
#include <ctime>
#include <future>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client/api/farm_client.h"
#include "rpc/certificate_renewer.h"
#include "rpc/channel.h"
#include "server/service/quotas/client_limits.h"
#include "tessera/v1/farm_service.grpc.pb.h"
#include "tests/integration/server/support/secure_farm.h"

namespace tessera::server {
namespace {

using grpc::StatusCode;

constexpr double kPlaces = 3;

ClientQuotas places_for_all(double places) {
  ClientQuota quota;
  quota.concurrent_calls = places;
  return {quota, {}};
}

TEST(CallPlaces, EndedCallFreesItsPlace) {
  ClientLimits limits(places_for_all(kPlaces));
  const QuotaKind& kind = quota_kind(&ClientQuota::concurrent_calls);
  std::vector<std::shared_ptr<const void>> places;
  for (int i = 0; i < kPlaces; ++i) places.push_back(*limits.reserve_call("ann"));
  const absl::Status refused = limits.reserve_call("ann").status();
  EXPECT_TRUE(absl::IsResourceExhausted(refused));
  EXPECT_TRUE(can_be_retried(refused));
  EXPECT_EQ(limits.used("ann", kind, {}), kPlaces) << "a refused call takes no place";
  EXPECT_TRUE(limits.reserve_call("bob").ok()) << "clients do not share places";
  places.pop_back();
  EXPECT_TRUE(limits.reserve_call("ann").ok());
  places.clear();
  EXPECT_EQ(limits.used("ann", kind, {}), 0);
  EXPECT_EQ(limits.used("bob", kind, {}), 0);
}

TEST(CallPlaces, ZeroIsUnlimited) {
  ClientLimits limits(places_for_all(0));
  std::vector<std::shared_ptr<const void>> places;
  for (int i = 0; i < 1000; ++i) {
    auto place = limits.reserve_call("ann");
    ASSERT_TRUE(place.ok()) << i;
    places.push_back(*std::move(place));
  }
}

TEST(CallPlaces, OnlyRefusalsThatPassCanBeRetried) {
  ClientQuota quota;
  quota.streams = 1;
  ClientLimits limits({quota, {}});
  const auto open = limits.reserve_stream("ann", false);
  const absl::Status refused = limits.reserve_stream("ann", false).status();
  EXPECT_TRUE(absl::IsResourceExhausted(refused));
  EXPECT_FALSE(can_be_retried(refused));
  EXPECT_FALSE(can_be_retried(absl::OkStatus()));
}

/// A farm on which ann may have three calls in progress, and whose writer thread can be held up, so
/// that calls that wait for a transaction stay in progress.
class ConcurrentCalls : public SecureFarm {
 protected:
  ConcurrentCalls() { quotas_.by_client["ann"].concurrent_calls = kPlaces; }

  void SetUp() override {
    SecureFarm::SetUp();
    ASSERT_TRUE(upload_scene("ann").ok());
    ASSERT_TRUE(upload_scene("bob").ok());
  }
  void TearDown() override {
    release_writer();
    creating_.clear();
    SecureFarm::TearDown();
  }

  /// Holds up the writer thread until release_writer().
  void hold_writer() {
    running_->coordinator().settings().set_limit("hold", 1, [this](const auto&) {
      std::unique_lock lock(mutex_);
      wake_.wait(lock, [this] { return is_released_; });
    });
  }
  void release_writer() {
    const std::lock_guard lock(mutex_);
    is_released_ = true;
    wake_.notify_all();
  }

  /// Starts to create a job for ann.
  void start_create() {
    contexts_.push_back(std::make_unique<grpc::ClientContext>());
    prepare(*contexts_.back());
    const std::string name = "job" + std::to_string(creating_.size());
    creating_.push_back(
        std::async(std::launch::async, [this, name, context = contexts_.back().get()] {
          v1::CreateJobResponse response;
          return jobs("ann")->CreateJob(context, request_of(name), &response);
        }));
  }
  /// Takes all of ann's places with calls that wait for the writer. Returns whether it could.
  bool take_places() {
    hold_writer();
    for (int i = 0; i < kPlaces; ++i) start_create();
    return wait_for_places("ann", kPlaces) == kPlaces;
  }
  double places(const std::string& client) const {
    grpc::ClientContext context;
    prepare(context);
    v1::ListQuotasResponse response;
    const auto farm = v1::FarmService::NewStub(channel("root"));
    EXPECT_TRUE(farm->ListQuotas(&context, {}, &response).ok());
    for (const v1::ClientQuotas& entry : response.clients()) {
      if (entry.client() != client) continue;
      for (const v1::QuotaUse& use : entry.quotas()) {
        if (use.quota() == "concurrent-calls") return use.used();
      }
    }
    return -1;
  }
  /// Waits until a client has so many calls in progress, at most 10 s.
  double wait_for_places(const std::string& client, double expected) const {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(10);
    double taken = places(client);
    while (taken != expected && std::chrono::steady_clock::now() < end) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      taken = places(client);
    }
    return taken;
  }

  std::vector<std::unique_ptr<grpc::ClientContext>> contexts_;
  std::vector<std::future<grpc::Status>> creating_;

 private:
  std::mutex mutex_;
  std::condition_variable wake_;
  bool is_released_ = false;
};

TEST_F(ConcurrentCalls, ClientWithoutFreePlaceIsRefused) {
  ASSERT_TRUE(take_places());
  grpc::ClientContext context;
  prepare(context);
  v1::ListJobsResponse response;
  const auto begun = std::chrono::steady_clock::now();
  const grpc::Status refused = jobs("ann")->ListJobs(&context, {}, &response);
  EXPECT_EQ(refused.error_code(), StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(refused.error_message(),
            "quota concurrent-calls: client ann is limited to 3 calls in progress and would use 4; "
            "retry later, and make fewer calls at the same time, or ask the operator to raise "
            "--client-concurrent-calls");
  EXPECT_EQ(context.GetServerTrailingMetadata().count(contract::kRetryKey), 1u);
  EXPECT_GE(std::chrono::steady_clock::now() - begun, std::chrono::milliseconds(250))
      << "the refusal is answered late";
  for (const char* name : {"bob", "root"}) EXPECT_TRUE(try_call(name).ok()) << name;
  EXPECT_EQ(places("ann"), kPlaces) << "refused calls and those of others take none of them";
  release_writer();
  for (auto& creating : creating_) EXPECT_TRUE(creating.get().ok());
  EXPECT_EQ(wait_for_places("ann", 0), 0);
  EXPECT_TRUE(try_call("ann").ok()) << "the places are free again";
}

TEST_F(ConcurrentCalls, CallsOfAllConnectionsCount) {
  ASSERT_TRUE(take_places());  // each call over a connection of its own
  const auto other = channel("ann");
  EXPECT_EQ(try_call(other).error_code(), StatusCode::RESOURCE_EXHAUSTED);
}

TEST_F(ConcurrentCalls, PlaceIsFreeHoweverACallEnds) {
  const auto check = [&](const grpc::Status& status, StatusCode expected) {
    EXPECT_EQ(status.error_code(), expected) << status.error_message();
    EXPECT_EQ(wait_for_places("ann", 0), 0) << expected;
  };
  v1::CreateJobResponse created;
  check(try_call("ann"), StatusCode::OK);
  check(create("ann", {}, created), StatusCode::FAILED_PRECONDITION);
  grpc::ClientContext find, drain;
  prepare(find);
  prepare(drain);
  v1::GetJobResponse found;
  check(jobs("ann")->GetJob(&find, {}, &found), StatusCode::NOT_FOUND);
  v1::DrainWorkerResponse drained;
  check(v1::WorkerService::NewStub(channel("ann"))->DrainWorker(&drain, {}, &drained),
        StatusCode::PERMISSION_DENIED);
  hold_writer();
  start_create();
  ASSERT_EQ(wait_for_places("ann", 1), 1);
  contexts_.back()->TryCancel();
  EXPECT_EQ(creating_.back().get().error_code(), StatusCode::CANCELLED);
  EXPECT_EQ(places("ann"), 1) << "the server is still at work";
  release_writer();
  EXPECT_EQ(wait_for_places("ann", 0), 0) << "cancelled";
}

TEST_F(ConcurrentCalls, OpenStreamsTakeNoPlace) {
  const auto stub = jobs("ann");
  v1::WatchEventsRequest request;
  request.set_follow(true);
  grpc::ClientContext context;  // without a deadline
  const auto open = stub->WatchEvents(&context, request);
  create_job("ann", "shot");
  v1::WatchEventsResponse response;
  ASSERT_TRUE(open->Read(&response));
  EXPECT_EQ(wait_for_places("ann", 0), 0);
  context.TryCancel();
}

class SlowRate : public ConcurrentCalls {
 protected:
  SlowRate() { quotas_.by_client["ann"].calls = 1; }  // ten at once
};

TEST_F(SlowRate, CallsWithoutPlaceDoNotCountTowardsIt) {
  ASSERT_TRUE(take_places());
  const auto ann = channel("ann");
  std::vector<std::future<grpc::Status>> refused;
  for (int i = 0; i < 10; ++i) {
    refused.push_back(std::async(std::launch::async, [&] { return try_call(ann); }));
  }
  for (auto& call : refused) {
    const grpc::Status status = call.get();
    EXPECT_EQ(status.error_message().find("quota concurrent-calls"), 0u) << status.error_message();
  }
  release_writer();
  for (auto& creating : creating_) EXPECT_TRUE(creating.get().ok());
  ASSERT_EQ(wait_for_places("ann", 0), 0);
  const grpc::Status status = try_call(ann);
  EXPECT_TRUE(status.ok()) << status.error_message();
}

class NoPlaces : public ConcurrentCalls {
 protected:
  NoPlaces() {
    for (const char* name : {"w1", "root"}) quotas_.by_client[name].concurrent_calls = 0.5;
  }
};

TEST_F(NoPlaces, WorkersAndAdminsAreNotLimited) {
  EXPECT_TRUE(try_call("root").ok());
  grpc::ClientContext context;
  prepare(context);
  v1::DescribeJobResponse response;
  const auto stub = v1::WorkerService::NewStub(channel("w1"));
  EXPECT_EQ(stub->DescribeJob(&context, {}, &response).error_code(), StatusCode::NOT_FOUND);
}

TEST_F(ConcurrentCalls, UnknownRpcIsUnimplemented) {
  const auto ann = channel("ann");
  for (int i = 0; i < 20; ++i) {
    grpc::ClientContext context;
    prepare(context);
    grpc::CompletionQueue queue;
    const grpc::Slice bytes("");
    const grpc::ByteBuffer request(&bytes, 1);
    grpc::ByteBuffer response;
    grpc::Status status;
    const auto call =
        grpc::GenericStub(ann).PrepareUnaryCall(&context, "/tessera.v1.None/None", request, &queue);
    call->StartCall();
    call->Finish(&response, &status, this);
    void* tag = nullptr;
    bool ok = false;
    ASSERT_TRUE(queue.Next(&tag, &ok));
    EXPECT_EQ(status.error_code(), StatusCode::UNIMPLEMENTED) << status.error_message();
  }
  EXPECT_TRUE(try_call(ann).ok()) << "the server goes on";
}

TEST_F(ConcurrentCalls, FarmClientWaitsForAPlace) {
  ASSERT_TRUE(take_places());
  auto listing = std::async(std::launch::async, [this] {
    client::Connection connection;
    connection.server = server_->address();
    connection.certs = certs_of("ann");
    return client::FarmClient::connect(connection).value()->list_jobs({}).status();
  });
  EXPECT_EQ(listing.wait_for(std::chrono::milliseconds(1500)), std::future_status::timeout)
      << "it waits for a place";
  release_writer();
  const absl::Status status = listing.get();
  EXPECT_TRUE(status.ok()) << status;
}

TEST_F(ConcurrentCalls, RenewalWaitsForAPlace) {
  const std::string folder = folder_ + "/brief";
  const std::int64_t now = std::time(nullptr);
  ASSERT_TRUE(issue(certs_, Role::client, "ann", folder, {now - 800, now + 200}).ok());
  ASSERT_TRUE(take_places());
  std::promise<void> renewed;
  contract::CertificateRenewer::Options options;
  options.folder = folder;
  options.channel = [&] { return contract::open_channel(server_->address(), folder).value(); };
  options.renewed = [&] { renewed.set_value(); };
  options.failed = [](const absl::Status& status) { ADD_FAILURE() << status; };
  const contract::CertificateRenewer renewer(std::move(options));
  auto end = renewed.get_future();
  EXPECT_EQ(end.wait_for(std::chrono::milliseconds(1500)), std::future_status::timeout);
  release_writer();
  EXPECT_EQ(end.wait_for(std::chrono::seconds(10)), std::future_status::ready);
}

}  // namespace
}  // namespace tessera::server
