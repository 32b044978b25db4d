// Quotas of clients for jobs, files, streams, event subscriptions and connections, and the calls
// that show them.
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "tessera/v1/farm_service.grpc.pb.h"
#include "tests/integration/server/support/secure_farm.h"

namespace tessera::server {
namespace {

using grpc::StatusCode;

constexpr double kGiga = 1e9;

class QuotasTest : public SecureFarm {
 protected:
  QuotasTest() {
    ClientQuota ann;
    ann.jobs = 2;
    ann.event_subscriptions = 1;
    quotas_.by_client["ann"] = ann;
  }

  grpc::Status list(const std::string& name, const v1::ListQuotasRequest& request,
                    v1::ListQuotasResponse& response) const {
    grpc::ClientContext context;
    prepare(context);
    return v1::FarmService::NewStub(channel(name))->ListQuotas(&context, request, &response);
  }
  /// Returns the use of a client, by quota, as `name` sees it.
  std::map<std::string, v1::QuotaUse> use_of(const std::string& client,
                                             const std::string& name = "root") const {
    v1::ListQuotasResponse response;
    EXPECT_TRUE(list(name, {}, response).ok());
    std::map<std::string, v1::QuotaUse> uses;
    for (const v1::ClientQuotas& entry : response.clients()) {
      if (entry.client() != client) continue;
      for (const v1::QuotaUse& use : entry.quotas()) uses[use.quota()] = use;
    }
    return uses;
  }
  double stored_bytes(const std::string& client) const {
    return use_of(client)["stored-gb"].used() * kGiga;
  }
  grpc::Status submit(const std::string& owner, const std::string& name) const {
    v1::CreateJobResponse response;
    return create(owner, request_of(name), response);
  }
  double refusals(const std::string& quota) const {
    for (const auto& family : running_->coordinator().queries().metrics()) {
      if (family.name != "tessera_quota_refusals_total") continue;
      for (const auto& metric : family.metric) {
        if (metric.label.front().value == quota) return metric.counter.value;
      }
    }
    return -1;
  }
};

TEST_F(QuotasTest, JobsOverQuotaOfOneClientAreRefused) {
  create_job("ann", "one");
  create_job("ann", "two");
  const grpc::Status status = submit("ann", "three");
  EXPECT_EQ(status.error_code(), StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(
      status.error_message(),
      "quota jobs: client ann is limited to 2 unfinished jobs and would use 3; wait for jobs to "
      "finish, or cancel some, or ask the operator to raise --client-jobs");
  for (const char* name : {"four", "five", "six"}) create_job("bob", name);
  EXPECT_EQ(use_of("ann")["jobs"].used(), 2);
  EXPECT_EQ(use_of("ann")["jobs"].limit(), 2);
  EXPECT_EQ(use_of("bob")["jobs"].used(), 3);
  EXPECT_EQ(use_of("bob")["jobs"].limit(), 0);
  EXPECT_EQ(refusals("jobs"), 1);
}

TEST_F(QuotasTest, EventSubscriptionsAreCountedApart) {
  const auto stub = jobs("ann");
  v1::WatchEventsRequest request;
  request.set_follow(true);
  grpc::ClientContext first, second;
  prepare(first);
  prepare(second);
  const auto open = stub->WatchEvents(&first, request);
  create_job("ann", "shot");
  v1::WatchEventsResponse response;
  ASSERT_TRUE(open->Read(&response));
  const grpc::Status refused = stub->WatchEvents(&second, request)->Finish();
  EXPECT_EQ(refused.error_code(), StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_NE(
      refused.error_message().find("quota event-subscriptions: client ann is limited to 1 event"),
      std::string::npos)
      << refused.error_message();
  EXPECT_EQ(use_of("ann")["event-subscriptions"].used(), 1);
  EXPECT_EQ(use_of("ann")["streams"].used(), 1);
  first.TryCancel();
}

class FewConnections : public QuotasTest {
 protected:
  FewConnections() { quotas_.by_client["ann"].connections = 3; }

  /// Makes a call over each of some new connections.
  std::vector<std::shared_ptr<grpc::Channel>> connect(const std::string& name, int count) const {
    std::vector<std::shared_ptr<grpc::Channel>> channels;
    for (int i = 0; i < count; ++i) {
      channels.push_back(channel(name));
      EXPECT_TRUE(try_call(channels.back()).ok()) << i;
    }
    return channels;
  }
  /// Waits until a client has so many connections, at most 5 s.
  double connections_of(const std::string& client, double expected) const {
    double open = -1;
    for (int i = 0; i < 100 && open != expected; ++i) {
      open = use_of(client)["connections"].used();
      if (open != expected) std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    return open;
  }
};

TEST_F(FewConnections, OneMoreIsRefusedAndClosed) {
  const auto open = connect("ann", 3);
  const auto more = channel("ann");
  const grpc::Status refused = try_call(more);
  EXPECT_EQ(refused.error_code(), StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(refused.error_message(),
            "quota connections: client ann is limited to 3 open connections and would use 4; end "
            "some programs that use this certificate, or let one make their calls, or ask the "
            "operator to raise "
            "--client-connections");
  EXPECT_EQ(refusals("connections"), 1);
  EXPECT_TRUE(more->WaitForStateChange(GRPC_CHANNEL_READY,
                                       std::chrono::system_clock::now() + std::chrono::seconds(5)))
      << "the server ends the connection";
  for (const auto& each : open) EXPECT_TRUE(try_call(each).ok()) << "the others go on";
  EXPECT_EQ(use_of("ann")["connections"].used(), 3);
  EXPECT_EQ(use_of("ann")["connections"].limit(), 3);
}

TEST_F(FewConnections, ClosedOneFreesItsPlace) {
  auto open = connect("ann", 3);
  EXPECT_EQ(connections_of("ann", 3), 3);
  open.pop_back();
  EXPECT_EQ(connections_of("ann", 2), 2);
  EXPECT_TRUE(try_call("ann").ok());
}

TEST_F(FewConnections, OthersAreNotAffected) {
  const auto open = connect("ann", 3);
  const auto others = connect("bob", 8), admins = connect("root", 8);
  EXPECT_EQ(try_call("ann").error_code(), StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_TRUE(try_call("bob").ok());
  EXPECT_EQ(use_of("bob")["connections"].limit(), 100) << "the default";
}

TEST_F(FewConnections, ManyCallsOfOneAreOneConnection) {
  const auto open = channel("ann");
  for (int i = 0; i < 20; ++i) EXPECT_TRUE(try_call(open).ok());
  EXPECT_EQ(use_of("ann")["connections"].used(), 1);
}

TEST_F(QuotasTest, ClientSeesOnlyItsOwn) {
  create_job("bob", "other");
  ASSERT_TRUE(try_call("ann").ok());
  EXPECT_EQ(use_of("ann", "ann").size(), kQuotaKinds.size());
  EXPECT_GT(use_of("ann", "ann")["calls"].used(), 0);
  EXPECT_TRUE(use_of("bob", "ann").empty());
  EXPECT_EQ(use_of("bob", "root").size(), kQuotaKinds.size());
}

TEST_F(QuotasTest, ListIsPaged) {
  create_job("bob", "other");
  ASSERT_TRUE(try_call("ann").ok());
  v1::ListQuotasRequest request;
  request.set_page_size(1);
  v1::ListQuotasResponse response;
  ASSERT_TRUE(list("root", request, response).ok());
  ASSERT_EQ(response.clients_size(), 1);
  EXPECT_EQ(response.clients(0).client(), "ann");
  request.set_page_token(response.next_page_token());
  response.Clear();
  ASSERT_TRUE(list("root", request, response).ok());
  ASSERT_EQ(response.clients_size(), 1);
  EXPECT_EQ(response.clients(0).client(), "bob");
  EXPECT_EQ(response.next_page_token(), "");
  request.set_page_size(1001);
  EXPECT_EQ(list("root", request, response).error_code(), StatusCode::INVALID_ARGUMENT);
}

TEST_F(QuotasTest, StoredBytesAreSceneFilesAndResults) {
  const auto scene = static_cast<double>(sizeof kScene - 1);
  ASSERT_TRUE(upload_scene("ann").ok());
  EXPECT_NEAR(stored_bytes("ann"), scene, 1e-3) << "an upload counts before a job names it";
  const std::string job = create_job("ann", "shot");
  EXPECT_GT(stored_bytes("ann"), scene + 1000) << "an unfinished job counts with what it may need";
  const auto first = worker("w1", "one", token());
  ASSERT_TRUE(first->open());
  EXPECT_EQ(first->work(), 18);
  v1::Job done;
  for (int i = 0; i < 100 && done.state() != v1::Job::STATE_DONE; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    grpc::ClientContext context;
    prepare(context);
    v1::GetJobRequest request;
    request.set_job(job);
    v1::GetJobResponse response;
    ASSERT_TRUE(jobs("ann")->GetJob(&context, request, &response).ok());
    done = response.job();
  }
  ASSERT_EQ(done.state(), v1::Job::STATE_DONE);
  const double kept = stored_bytes("ann");
  EXPECT_GT(kept, scene + 500) << "the image";
  EXPECT_LT(kept, scene + 200'000);
  restart();
  EXPECT_NEAR(stored_bytes("ann"), kept, 1e-3) << "a restart changes nothing";
  grpc::ClientContext context;
  prepare(context);
  v1::RemoveJobRequest request;
  request.set_job_id(job);
  v1::RemoveJobResponse response;
  ASSERT_TRUE(jobs("ann")->RemoveJob(&context, request, &response).ok());
  EXPECT_NEAR(stored_bytes("ann"), 0, 1e-3);
}

class SmallStore : public QuotasTest {
 protected:
  SmallStore() { quotas_.by_client["ann"].stored_gb = 100 / kGiga; }
};

TEST_F(SmallStore, FilesOverQuotaAreRefused) {
  EXPECT_TRUE(upload("ann", std::string(60, 'a')).ok());
  EXPECT_TRUE(upload("ann", std::string(60, 'a')).ok()) << "an existing file is not counted twice";
  const grpc::Status status = upload("ann", std::string(60, 'b'));
  EXPECT_EQ(status.error_code(), StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_NE(status.error_message().find("quota stored-gb: client ann is limited to 1e-07 GB of"),
            std::string::npos)
      << status.error_message();
  EXPECT_TRUE(upload("bob", std::string(60, 'b')).ok());
  EXPECT_TRUE(upload("ann", std::string(60, 'b')).ok()) << "it exists now, and costs nothing";
  EXPECT_EQ(submit("ann", "shot").error_code(), StatusCode::FAILED_PRECONDITION);
  EXPECT_TRUE(upload_scene("bob").ok());
  EXPECT_EQ(submit("ann", "shot").error_code(), StatusCode::RESOURCE_EXHAUSTED)
      << "the job may need more than is left";
}

TEST_F(QuotasTest, WrongSizeInManifestIsRefused) {
  ASSERT_TRUE(upload_scene("ann").ok());
  v1::CreateJobRequest request = request_of("shot");
  request.mutable_manifest()->mutable_assets(0)->mutable_asset()->set_size_bytes(0);
  v1::CreateJobResponse response;
  EXPECT_EQ(create("ann", request, response).error_code(), StatusCode::INVALID_ARGUMENT);
}

}  // namespace
}  // namespace tessera::server
