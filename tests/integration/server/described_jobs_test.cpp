// Descriptions of jobs that come with leases.
#include "tests/integration/server/support/test_farm.h"

namespace tessera::server {
namespace {

using DescribedJobsTest = TestFarm;

TEST_F(DescribedJobsTest, FirstLeaseDescribesItsJob) {
  ASSERT_TRUE(upload(id_of(kScene), kScene).ok());
  const v1::CreateJobRequest request = request_of("one");
  v1::CreateJobResponse created;
  ASSERT_TRUE(create(request, created).ok());
  TestWorker worker(server_->channel(), "worker");
  ASSERT_TRUE(worker.open());
  TestWorker::Unit unit;
  ASSERT_TRUE(worker.next(unit));
  ASSERT_EQ(worker.described.size(), 1u);
  EXPECT_EQ(worker.described[0].job_id(), created.job().id());
  EXPECT_EQ(worker.described[0].settings().SerializeAsString(),
            created.job().settings().SerializeAsString());
  EXPECT_EQ(worker.described[0].manifest().SerializeAsString(),
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
  ASSERT_TRUE(upload(id_of(kScene), kScene).ok());
  v1::CreateJobRequest request = request_of("many");
  for (int i = 0; i < 64; ++i) {
    v1::ManifestEntry& entry = *request.mutable_manifest()->add_assets();
    entry.set_uri("file" + std::to_string(i));
    *entry.mutable_asset() = id_of(kScene);
  }
  v1::CreateJobResponse created;
  ASSERT_TRUE(create(request, created).ok());
  TestWorker worker(server_->channel(), "worker");
  ASSERT_TRUE(worker.open());
  TestWorker::Unit unit;
  ASSERT_TRUE(worker.next(unit));
  EXPECT_TRUE(worker.described.empty());
  EXPECT_TRUE(worker.describe(created.job().id()).ok());
}

TEST_F(DescribedJobsTest, JobOfLongNamesIsNotDescribed) {
  ASSERT_TRUE(upload(id_of(kScene), kScene).ok());
  v1::CreateJobRequest request = request_of("long");
  for (int i = 0; i < 20; ++i) {
    v1::ManifestEntry& entry = *request.mutable_manifest()->add_assets();
    entry.set_uri(std::to_string(i) + std::string(1000, 'x'));
    *entry.mutable_asset() = id_of(kScene);
  }
  v1::CreateJobResponse created;
  const grpc::Status status = create(request, created);
  ASSERT_TRUE(status.ok()) << status.error_message();
  TestWorker worker(server_->channel(), "worker");
  ASSERT_TRUE(worker.open());
  TestWorker::Unit unit;
  ASSERT_TRUE(worker.next(unit));
  EXPECT_TRUE(worker.described.empty());
}

}  // namespace
}  // namespace tessera::server
