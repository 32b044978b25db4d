// WatchJob.
#include <gtest/gtest.h>

#include <chrono>
#include <string>
#include <thread>

#include "tests/integration/server/support/test_farm.h"

namespace tessera::server {
namespace {

class WatchTest : public TestFarm {
 protected:
  template <typename Request, typename Response>
  v1::Job order(grpc::Status (v1::JobService::Stub::*call)(grpc::ClientContext*, const Request&,
                                                           Response*),
                const std::string& job) {
    grpc::ClientContext context;
    prepare(context);
    Request request;
    request.set_job_id(job);
    Response response;
    const grpc::Status status = (jobs_.get()->*call)(&context, request, &response);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return response.job();
  }
};

TEST_F(WatchTest, UnknownJobIsNotFound) {
  grpc::ClientContext context;
  prepare(context);
  v1::WatchJobRequest request;
  request.set_job_id("nothing");
  auto stream = jobs_->WatchJob(&context, request);
  v1::WatchJobResponse response;
  EXPECT_FALSE(stream->Read(&response));
  EXPECT_EQ(stream->Finish().error_code(), grpc::StatusCode::NOT_FOUND);
}

TEST_F(WatchTest, CancellationEndsIt) {
  const std::string job = create_job("a");
  std::thread canceller([&] {
    const v1::Job cancelled =
        order<v1::CancelJobRequest, v1::CancelJobResponse>(&v1::JobService::Stub::CancelJob, job);
    EXPECT_EQ(cancelled.state(), v1::Job::STATE_CANCELLED);
  });
  EXPECT_EQ(watch(job).back().state(), v1::Job::STATE_CANCELLED);
  canceller.join();
}

TEST_F(WatchTest, ChangesArriveAtOnce) {
  const std::string job = create_job("a");
  grpc::ClientContext context;
  prepare(context);
  v1::WatchJobRequest request;
  request.set_job_id(job);
  request.mutable_interval()->set_seconds(60);
  const auto stream = jobs_->WatchJob(&context, request);
  v1::WatchJobResponse response;
  ASSERT_TRUE(stream->Read(&response));
  for (int i = 0; i < 8; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));  // the stream waits
    const bool pause = i % 2 == 0;
    if (pause) {
      order<v1::PauseJobRequest, v1::PauseJobResponse>(&v1::JobService::Stub::PauseJob, job);
    } else {
      order<v1::ResumeJobRequest, v1::ResumeJobResponse>(&v1::JobService::Stub::ResumeJob, job);
    }
    const auto since = std::chrono::steady_clock::now();
    ASSERT_TRUE(stream->Read(&response));
    // Without being woken it looks once a second.
    EXPECT_LT(std::chrono::steady_clock::now() - since, std::chrono::milliseconds(500)) << i;
    EXPECT_EQ(response.job().state() == v1::Job::STATE_PAUSED, pause);
  }
  context.TryCancel();
  EXPECT_FALSE(stream->Read(&response));
  stream->Finish();
}

}  // namespace
}  // namespace tessera::server
