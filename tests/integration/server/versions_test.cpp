// Programs of other versions get a message that names both versions and says what to do.
#include <string>

#include "contract/version.h"
#include "rpc/protocol_version.h"
#include "server/store/sqlite/database.h"
#include "tests/integration/server/support/test_farm.h"
#include "tests/support/disk/older_schema.h"

namespace tessera::server {
namespace {

using grpc::StatusCode;

class VersionsTest : public TestFarm {
 protected:
  /// The status with which the server refuses a worker that sends this hello.
  grpc::Status refusal(const v1::WorkerHello& hello) {
    TestWorker worker(server_->channel(), hello.worker_id());
    worker.hello = hello;
    EXPECT_FALSE(worker.open());
    return worker.close();
  }
  v1::ListWorkersResponse workers() {
    grpc::ClientContext context;
    prepare(context);
    v1::ListWorkersResponse response;
    EXPECT_TRUE(v1::WorkerService::NewStub(server_->channel())
                    ->ListWorkers(&context, v1::ListWorkersRequest(), &response)
                    .ok());
    return response;
  }
  v1::ListJobsResponse jobs() {
    grpc::ClientContext context;
    prepare(context);
    v1::ListJobsResponse response;
    EXPECT_TRUE(jobs_->ListJobs(&context, v1::ListJobsRequest(), &response).ok());
    return response;
  }
  v1::WorkerHello hello() { return TestWorker(server_->channel(), "w1").hello; }
  grpc::Status submit(int protocol_version) {
    v1::CreateJobRequest request = request_of("a");
    request.set_protocol_version(protocol_version);
    v1::CreateJobResponse response;
    EXPECT_TRUE(upload(id_of(kScene), kScene).ok());
    return create(request, response);
  }
};

TEST_F(VersionsTest, WorkerWithoutProtocolIsRefused) {
  v1::WorkerHello old = hello();
  old.clear_protocol_version();
  const grpc::Status status = refusal(old);
  EXPECT_EQ(status.error_code(), StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(status.error_message(),
            "this worker speaks protocol version 0 (none was sent), this server version 1: upgrade "
            "the worker");
  EXPECT_EQ(workers().workers_size(), 0) << "a refused worker is not listed";
}

// An older worker may differ in everything; the protocol version is the reason to name.
TEST_F(VersionsTest, ProtocolIsCheckedBeforeContract) {
  v1::WorkerHello old = hello();
  old.clear_protocol_version();
  old.set_contract_version(10);
  old.clear_numerics_sha256();
  old.clear_name();
  const grpc::Status status = refusal(old);
  EXPECT_EQ(status.error_code(), StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(status.error_message(),
            "this worker speaks protocol version 0 (none was sent), this server version 1: upgrade "
            "the worker");
}

TEST_F(VersionsTest, RefusedWorkerDoesNotReplaceAnother) {
  TestWorker worker(server_->channel(), "w1");
  ASSERT_TRUE(worker.open());
  v1::WorkerHello old = hello();
  old.clear_protocol_version();
  EXPECT_EQ(refusal(old).error_code(), StatusCode::FAILED_PRECONDITION);
  const std::string job = create_job("a");
  TestWorker::Unit unit;
  EXPECT_TRUE(worker.next(unit)) << "the first worker is still connected";
}

TEST_F(VersionsTest, WorkerWithNewerProtocolIsRefused) {
  v1::WorkerHello newer = hello();
  newer.set_protocol_version(contract::kProtocolVersion + 1);
  const grpc::Status status = refusal(newer);
  EXPECT_EQ(status.error_code(), StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(status.error_message(),
            "this worker speaks protocol version 2, this server version 1: upgrade the server, or "
            "install its version of the worker");
}

TEST_F(VersionsTest, WorkerWithOlderContractIsRefused) {
  v1::WorkerHello old = hello();
  old.set_contract_version(10);
  const grpc::Status status = refusal(old);
  EXPECT_EQ(status.error_code(), StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(status.error_message(), "this worker has render contract 10, this server " +
                                        std::to_string(contract::kRenderContract) +
                                        ": install the server's version of the worker");
}

TEST_F(VersionsTest, WorkerOfThisVersionConnects) {
  TestWorker worker(server_->channel(), "w1");
  EXPECT_TRUE(worker.open());
}

TEST_F(VersionsTest, ClientWithoutProtocolIsRefused) {
  const grpc::Status status = submit(0);
  EXPECT_EQ(status.error_code(), StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(status.error_message(),
            "this client speaks protocol version 0 (none was sent), this server version 1: upgrade "
            "the client");
  EXPECT_EQ(jobs().jobs_size(), 0) << "a refused client creates no job";
}

// Only CreateJob has a version: older clients can watch and fetch their jobs.
TEST_F(VersionsTest, OlderClientSeesExistingJobs) {
  const std::string job = create_job("a");
  EXPECT_EQ(submit(0).error_code(), StatusCode::FAILED_PRECONDITION);
  ASSERT_EQ(jobs().jobs_size(), 1);
  EXPECT_EQ(jobs().jobs(0).id(), job);
}

TEST_F(VersionsTest, ClientWithNewerProtocolIsRefused) {
  const grpc::Status status = submit(contract::kProtocolVersion + 1);
  EXPECT_EQ(status.error_code(), StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(status.error_message(),
            "this client speaks protocol version 2, this server version 1: upgrade the server, or "
            "install its version of the client");
}

TEST_F(VersionsTest, ClientOfThisVersionSubmits) {
  const grpc::Status status = submit(contract::kProtocolVersion);
  EXPECT_TRUE(status.ok()) << status.error_message();
}

TEST_F(VersionsTest, JobsOfOlderStoreAreKept) {
  const std::string job = create_job("a");
  jobs_.reset();
  server_.reset();
  {
    const auto rows = Database::open(folder_ + "/store.db", "", Database::Mode::writer);
    ASSERT_TRUE(rows.ok()) << rows.status();
    ASSERT_TRUE((*rows)->script(sql_to_older_schema(1).c_str()).ok());
  }
  restart();
  TestWorker worker(server_->channel(), "w1");
  ASSERT_TRUE(worker.open());
  worker.work();
  EXPECT_EQ(watch(job).back().state(), v1::Job::STATE_DONE);
}

}  // namespace
}  // namespace tessera::server
