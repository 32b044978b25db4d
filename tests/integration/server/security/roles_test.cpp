// Permissions of each role.
#include <grpcpp/generic/generic_stub.h>

#include <chrono>
#include <thread>

#include "server/service/access/access.h"
#include "tessera/v1/certificate_service.pb.h"
#include "tessera/v1/farm_service.grpc.pb.h"
#include "tessera/v1/worker_service.pb.h"
#include "tests/integration/server/support/all_methods.h"
#include "tests/integration/server/support/secure_farm.h"

namespace tessera::server {
namespace {

using grpc::StatusCode;

class RolesTest : public SecureFarm {
 protected:
  /// Calls any rpc, unary or streaming, with one empty message; returns its status.
  static grpc::Status call_with_nothing(const std::shared_ptr<grpc::Channel>& channel,
                                        const google::protobuf::MethodDescriptor& method) {
    grpc::GenericStub stub(channel);
    grpc::CompletionQueue queue;
    grpc::ClientContext context;
    prepare(context);
    const std::string path = "/" + method.service()->full_name() + "/" + method.name();
    const auto call = stub.PrepareCall(&context, path, &queue);
    const auto wait = [&queue] {
      void* tag = nullptr;
      bool ok = false;
      return queue.Next(&tag, &ok) && ok;
    };
    call->StartCall(nullptr);
    wait();
    const grpc::Slice nothing("");
    call->WriteLast(grpc::ByteBuffer(&nothing, 1), {}, nullptr);
    wait();
    grpc::ByteBuffer answer;
    do {
      call->Read(&answer, nullptr);
    } while (wait());
    grpc::Status status;
    call->Finish(&status, nullptr);
    wait();
    return status;
  }

  template <typename Request, typename Response, typename Method>
  grpc::Status job_call(const std::string& name, Method method, const std::string& job_id) const {
    grpc::ClientContext context;
    prepare(context);
    Request request;
    request.set_job_id(job_id);
    Response response;
    const auto stub = jobs(name);
    return ((*stub).*method)(&context, request, &response);
  }
  grpc::Status find(const std::string& name, const std::string& text, v1::Job& job) const {
    grpc::ClientContext context;
    prepare(context);
    v1::GetJobRequest request;
    request.set_job(text);
    v1::GetJobResponse response;
    grpc::Status status = jobs(name)->GetJob(&context, request, &response);
    job = response.job();
    return status;
  }
  std::vector<std::string> list(const std::string& name) const {
    grpc::ClientContext context;
    prepare(context);
    v1::ListJobsResponse response;
    EXPECT_TRUE(jobs(name)->ListJobs(&context, {}, &response).ok());
    std::vector<std::string> names;
    for (const v1::Job& job : response.jobs()) names.push_back(job.name());
    return names;
  }
  StatusCode watch(const std::string& name, const std::string& job_id) const {
    grpc::ClientContext context;
    prepare(context);
    v1::WatchJobRequest request;
    request.set_job_id(job_id);
    const auto stub = jobs(name);
    const auto stream = stub->WatchJob(&context, request);
    v1::WatchJobResponse response;
    EXPECT_FALSE(stream->Read(&response));
    return stream->Finish().error_code();
  }
  StatusCode fetch(const std::string& name, const std::string& job_id) const {
    grpc::ClientContext context;
    prepare(context);
    v1::FetchFrameRequest request;
    request.set_job_id(job_id);
    request.set_allow_partial(true);
    const auto stub = jobs(name);
    const auto stream = stub->FetchFrame(&context, request);
    v1::FetchFrameResponse response;
    EXPECT_FALSE(stream->Read(&response));
    return stream->Finish().error_code();
  }
  StatusCode report(const std::string& name, const std::string& job_id) const {
    grpc::ClientContext context;
    prepare(context);
    v1::GetJobReportRequest request;
    request.set_job_id(job_id);
    const auto stub = jobs(name);
    const auto stream = stub->GetJobReport(&context, request);
    v1::GetJobReportResponse response;
    while (stream->Read(&response)) {
    }
    return stream->Finish().error_code();
  }
};

TEST_F(RolesTest, EveryRpcEnforcesItsRule) {
  ASSERT_GE(all_methods().size(), 40u);
  const auto client = channel("ann"), worker = channel("w1"), admin = channel("root");
  for (const auto* method : all_methods()) {
    const std::string rpc = method->service()->name() + "." + method->name();
    const AccessRule* rule = find_access_rule(rpc);
    ASSERT_NE(rule, nullptr) << rpc << " has no rule in server/service/access/access.cpp";
    EXPECT_EQ(rule->is_stream, method->client_streaming() || method->server_streaming()) << rpc;
    const auto is_denied = [&](const std::shared_ptr<grpc::Channel>& caller) {
      const StatusCode code = call_with_nothing(caller, *method).error_code();
      EXPECT_NE(code, StatusCode::UNAUTHENTICATED) << rpc;
      EXPECT_NE(code, StatusCode::UNAVAILABLE) << rpc;
      return code == StatusCode::PERMISSION_DENIED;
    };
    EXPECT_EQ(is_denied(client), !rule->client) << rpc;
    EXPECT_EQ(is_denied(worker), !rule->worker) << rpc;
    EXPECT_FALSE(is_denied(admin)) << rpc;
  }
}

TEST_F(RolesTest, ClientFindsOnlyItsJobs) {
  const std::string ann = create_job("ann", "shot");
  const std::string bob = create_job("bob", "other");
  v1::Job job;
  ASSERT_TRUE(find("ann", "last", job).ok());
  EXPECT_EQ(job.id(), ann);
  EXPECT_EQ(job.owner(), "ann");
  for (const std::string& text : {ann, ann.substr(0, 7), std::string("shot")}) {
    EXPECT_EQ(find("bob", text, job).error_code(), StatusCode::NOT_FOUND) << text;
    EXPECT_TRUE(find("ann", text, job).ok()) << text;
    EXPECT_TRUE(find("root", text, job).ok()) << text;
  }
  EXPECT_EQ(list("ann"), std::vector<std::string>{"shot"});
  EXPECT_EQ(list("bob"), std::vector<std::string>{"other"});
  EXPECT_EQ(list("root"), (std::vector<std::string>{"other", "shot"}));
}

TEST_F(RolesTest, ClientControlsOnlyItsJobs) {
  using Stub = v1::JobService::Stub;
  const std::string job = create_job("ann", "shot");
  const auto codes = [&](const std::string& name) {
    return std::vector<StatusCode>{
        job_call<v1::PauseJobRequest, v1::PauseJobResponse>(name, &Stub::PauseJob, job)
            .error_code(),
        job_call<v1::ResumeJobRequest, v1::ResumeJobResponse>(name, &Stub::ResumeJob, job)
            .error_code(),
        job_call<v1::ExtendJobRequest, v1::ExtendJobResponse>(name, &Stub::ExtendJob, job)
            .error_code(),
        report(name, job),
        job_call<v1::ListDeliveriesRequest, v1::ListDeliveriesResponse>(name, &Stub::ListDeliveries,
                                                                        job)
            .error_code(),
        job_call<v1::CancelJobRequest, v1::CancelJobResponse>(name, &Stub::CancelJob, job)
            .error_code(),
        job_call<v1::RetryJobRequest, v1::RetryJobResponse>(name, &Stub::RetryJob, job)
            .error_code(),
    };
  };
  EXPECT_EQ(codes("bob"), std::vector<StatusCode>(7, StatusCode::NOT_FOUND));
  EXPECT_EQ((job_call<v1::RemoveJobRequest, v1::RemoveJobResponse>("bob", &Stub::RemoveJob, job)
                 .error_code()),
            StatusCode::NOT_FOUND);
  EXPECT_EQ(watch("bob", job), StatusCode::NOT_FOUND);
  EXPECT_EQ(fetch("bob", job), StatusCode::NOT_FOUND);
  EXPECT_EQ(codes("ann"), std::vector<StatusCode>(7, StatusCode::OK));
  EXPECT_EQ(codes("root"), std::vector<StatusCode>(7, StatusCode::OK));
}

TEST_F(RolesTest, ClientStreamsAreLimitedToEight) {
  const std::string job = create_job("ann", "shot");
  struct Watch {
    std::unique_ptr<v1::JobService::Stub> stub;
    grpc::ClientContext context;
    std::unique_ptr<grpc::ClientReader<v1::WatchJobResponse>> stream;
  };
  v1::WatchJobRequest request;
  request.set_job_id(job);
  std::vector<std::unique_ptr<Watch>> watches;
  const auto open_one = [&](const std::string& name) {
    Watch& watch = *watches.emplace_back(std::make_unique<Watch>());
    watch.stub = jobs(name);
    prepare(watch.context);
    watch.stream = watch.stub->WatchJob(&watch.context, request);
    v1::WatchJobResponse response;
    return watch.stream->Read(&response);
  };
  for (int i = 0; i < 8; ++i) EXPECT_TRUE(open_one("ann")) << i;
  EXPECT_FALSE(open_one("ann"));
  EXPECT_EQ(watches.back()->stream->Finish().error_code(), StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_TRUE(open_one("root")) << "admins are not counted";
  EXPECT_EQ(watch("bob", job), StatusCode::NOT_FOUND) << "other clients have their own limit";
  watches.front()->context.TryCancel();
  watches.front()->stream->Finish();
  bool is_free = false;
  for (int i = 0; i < 100 && !is_free; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    is_free = open_one("ann");
  }
  EXPECT_TRUE(is_free) << "a reservation is released";
  for (const auto& watch : watches) watch->context.TryCancel();
}

TEST_F(RolesTest, ClientSeesOnlyItsShareAndSetsNone) {
  const auto farm = [&](const char* name) { return v1::FarmService::NewStub(channel(name)); };
  const auto set = [&](const char* caller, const char* client) {
    grpc::ClientContext context;
    prepare(context);
    v1::SetShareRequest request;
    request.set_client(client);
    request.set_weight(2);
    v1::SetShareResponse response;
    return farm(caller)->SetShare(&context, request, &response).error_code();
  };
  const auto listed = [&](const char* caller) {
    grpc::ClientContext context;
    prepare(context);
    v1::ListSharesResponse response;
    EXPECT_TRUE(farm(caller)->ListShares(&context, {}, &response).ok());
    std::vector<std::string> clients;
    for (const v1::ClientShare& share : response.shares()) clients.push_back(share.client());
    return clients;
  };
  EXPECT_EQ(set("ann", "ann"), StatusCode::PERMISSION_DENIED);
  EXPECT_EQ(set("root", "ann"), StatusCode::OK);
  EXPECT_EQ(set("root", "bob"), StatusCode::OK);
  EXPECT_EQ(listed("ann"), std::vector<std::string>{"ann"});
  EXPECT_EQ(listed("root"), (std::vector<std::string>{"ann", "bob"}));
  grpc::ClientContext context;
  prepare(context);
  v1::ResetShareRequest request;
  request.set_client("bob");
  v1::ResetShareResponse response;
  EXPECT_EQ(farm("bob")->ResetShare(&context, request, &response).error_code(),
            StatusCode::PERMISSION_DENIED);
}

TEST_F(RolesTest, ForeignRequestIdRevealsNothing) {
  create_job("ann", "shot");
  v1::CreateJobResponse response;
  const grpc::Status status = create("bob", request_of("shot"), response);
  EXPECT_EQ(status.error_code(), StatusCode::ALREADY_EXISTS);
  EXPECT_FALSE(response.has_job());
  EXPECT_TRUE(create("ann", request_of("shot"), response).ok())
      << "its own request returns the same job";
}

TEST_F(RolesTest, WorkerReadsOnlyLeasedJobs) {
  const std::string job = create_job("ann", "shot");
  EXPECT_EQ(download_scene("w1").error_code(), StatusCode::NOT_FOUND);
  const auto busy = worker("w1", "one", token());
  EXPECT_EQ(busy->describe(job).error_code(), StatusCode::NOT_FOUND);
  ASSERT_TRUE(busy->open());
  TestWorker::Unit unit;
  ASSERT_TRUE(busy->next(unit));
  EXPECT_TRUE(busy->describe(job).ok());
  EXPECT_TRUE(download_scene("w1").ok());

  const auto idle = worker("w2", "two", token());
  idle->hello.set_credit_count(0);
  ASSERT_TRUE(idle->open());
  EXPECT_EQ(idle->describe(job).error_code(), StatusCode::NOT_FOUND);
  EXPECT_EQ(download_scene("w2").error_code(), StatusCode::NOT_FOUND);
  EXPECT_EQ(download_scene("ann").error_code(), StatusCode::PERMISSION_DENIED);
  EXPECT_TRUE(download_scene("root").ok());
  idle->close();

  EXPECT_EQ(busy->work(), 17) << "two passes of nine tiles, but for the one above";
}

TEST_F(RolesTest, WorkerCannotDeliverForAnother) {
  create_job("ann", "shot");
  const auto correct = worker("w1", "one", token());
  ASSERT_TRUE(correct->open());
  const auto thief = worker("w2", "one", "");
  thief->send({v1::DeliverRequest()});
  EXPECT_EQ(thief->finish_deliver().error_code(), StatusCode::FAILED_PRECONDITION);
}

}  // namespace
}  // namespace tessera::server
