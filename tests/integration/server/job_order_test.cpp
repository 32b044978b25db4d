// Limits, pools and changes of jobs as messages.
#include "tests/integration/server/support/test_farm.h"

namespace tessera::server {
namespace {

class JobOrderTest : public TestFarm {
 protected:
  grpc::Status set_limit(const std::string& name, std::int64_t units) {
    grpc::ClientContext context;
    prepare(context);
    v1::SetLimitRequest request;
    request.set_name(name);
    request.set_unit_count(units);
    v1::SetLimitResponse response;
    return v1::FarmService::NewStub(server_->channel())->SetLimit(&context, request, &response);
  }
  std::vector<v1::Limit> limits() {
    grpc::ClientContext context;
    prepare(context);
    v1::ListLimitsResponse response;
    const auto stub = v1::FarmService::NewStub(server_->channel());
    EXPECT_TRUE(stub->ListLimits(&context, {}, &response).ok());
    return {response.limits().begin(), response.limits().end()};
  }
  grpc::Status update(const v1::UpdateJobRequest& request, v1::Job& job) {
    grpc::ClientContext context;
    prepare(context);
    v1::UpdateJobResponse response;
    grpc::Status status =
        v1::JobService::NewStub(server_->channel())->UpdateJob(&context, request, &response);
    job = response.job();
    return status;
  }
};

TEST_F(JobOrderTest, LimitsAreCheckedAndListed) {
  EXPECT_EQ(set_limit("a b", 1).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(set_limit("licence", -1).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_TRUE(set_limit("licence", 8).ok());
  EXPECT_TRUE(set_limit("licence", 4).ok());
  restart();
  ASSERT_EQ(limits().size(), 1u);
  EXPECT_EQ(limits()[0].name(), "licence");
  EXPECT_EQ(limits()[0].unit_count(), 4);
  grpc::ClientContext context;
  prepare(context);
  v1::RemoveLimitRequest request;
  request.set_name("other");
  v1::RemoveLimitResponse response;
  EXPECT_EQ(v1::FarmService::NewStub(server_->channel())
                ->RemoveLimit(&context, request, &response)
                .error_code(),
            grpc::StatusCode::NOT_FOUND);
}

TEST_F(JobOrderTest, UpdateChangesNamedFieldsOnly) {
  ASSERT_TRUE(set_limit("licence", 4).ok());
  const std::string first = create_job("first");
  v1::CreateJobRequest create_request = request_of("a");
  create_request.set_priority(5);
  create_request.set_pool("night");
  v1::JobDependency* dependency = create_request.add_dependencies();
  dependency->set_job_id(first);
  dependency->set_kind(v1::JobDependency::KIND_FRAMES);
  v1::CreateJobResponse created;
  ASSERT_TRUE(create(create_request, created).ok());
  EXPECT_EQ(created.job().pool(), "night");
  EXPECT_EQ(created.job().reason(), "waits for job " + first + " to finish frames; it is QUEUED");

  v1::UpdateJobRequest request;
  request.set_job_id(created.job().id());
  request.set_max_worker_count(3);
  v1::LimitUse* use = request.mutable_limits()->add_limits();
  use->set_limit("licence");
  use->set_unit_count(2);
  v1::Job job;
  ASSERT_TRUE(update(request, job).ok());
  EXPECT_EQ(job.priority(), 5);
  EXPECT_EQ(job.max_worker_count(), 3);
  EXPECT_EQ(job.limits_size(), 1);
  EXPECT_EQ(job.dependencies_size(), 1);

  restart();
  request.clear_limits();
  request.mutable_limits();  // present and empty
  request.set_clear_dependencies(true);
  ASSERT_TRUE(update(request, job).ok());
  EXPECT_EQ(job.pool(), "night");
  EXPECT_EQ(job.limits_size(), 0);
  EXPECT_EQ(job.dependencies_size(), 0);
  EXPECT_EQ(job.reason(), "no workers connected");

  request.set_priority(101);
  EXPECT_EQ(update(request, job).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  request.set_priority(100);
  request.set_pool("a b");
  EXPECT_EQ(update(request, job).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  request.set_job_id("nobody");
  EXPECT_EQ(update(request, job).error_code(), grpc::StatusCode::NOT_FOUND);
}

}  // namespace
}  // namespace tessera::server
