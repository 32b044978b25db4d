// Descriptions of jobs that come with leases.
#include "tests/integration/server/support/test_farm.h"

namespace tessera::server {
namespace {

class DescribedJobsTest : public TestFarm {
 protected:
  /// Creates a job and leases a unit of it to the worker.
  v1::Job lease(const v1::CreateJobRequest& request) {
    EXPECT_TRUE(upload(id_of(kScene), kScene).ok());
    v1::CreateJobResponse created;
    const grpc::Status status = create(request, created);
    EXPECT_TRUE(status.ok()) << status.error_message();
    worker_ = std::make_unique<TestWorker>(server_->channel(), "worker");
    EXPECT_TRUE(worker_->open());
    TestWorker::Unit unit;
    EXPECT_TRUE(worker_->next(unit));
    return created.job();
  }
  void TearDown() override {
    worker_.reset();
    TestFarm::TearDown();
  }

  std::unique_ptr<TestWorker> worker_;
};

/// A job with further files under these names.
v1::CreateJobRequest request_with(int count, const std::string& name) {
  v1::CreateJobRequest request = request_of("job");
  for (int i = 0; i < count; ++i) {
    v1::ManifestEntry& entry = *request.mutable_manifest()->add_assets();
    entry.set_uri(name + std::to_string(i));
    *entry.mutable_asset() = id_of(kScene);
  }
  return request;
}

TEST_F(DescribedJobsTest, FirstLeaseDescribesItsJob) {
  const v1::CreateJobRequest request = request_of("one");
  const v1::Job job = lease(request);
  ASSERT_EQ(worker_->described.size(), 1u);
  EXPECT_EQ(worker_->described[0].job_id(), job.id());
  EXPECT_EQ(worker_->described[0].settings().SerializeAsString(),
            job.settings().SerializeAsString());
  EXPECT_EQ(worker_->described[0].manifest().SerializeAsString(),
            request.manifest().SerializeAsString());
}

TEST_F(DescribedJobsTest, LaterLeasesDescribeNothing) {
  create_job("one");
  TestWorker worker(server_->channel(), "worker");
  worker.hello.set_credit_count(1);
  ASSERT_TRUE(worker.open());
  EXPECT_GT(worker.work(), 1);
  EXPECT_EQ(worker.described.size(), 1u);
}

TEST_F(DescribedJobsTest, JobOfManyFilesIsNotDescribed) {
  const v1::Job job = lease(request_with(64, "file"));
  EXPECT_TRUE(worker_->described.empty());
  EXPECT_TRUE(worker_->describe(job.id()).ok());
}

TEST_F(DescribedJobsTest, JobOfLongNamesIsNotDescribed) {
  lease(request_with(20, std::string(1000, 'x')));
  EXPECT_TRUE(worker_->described.empty());
}

}  // namespace
}  // namespace tessera::server
