#pragma once

#include <chrono>
#include <cstdio>
#include <memory>
#include <string>
#include <thread>
#include <utility>

#include "tests/integration/server/support/secure_farm.h"

namespace tessera::server {

/// Time within which the streams of a certificate end that has been revoked or has expired.
inline constexpr std::chrono::seconds kStreamLimit{5};

/// A stream on a thread of its own, which notes when and how it ends.
class OpenCall {
 public:
  explicit OpenCall(const char* what) : what_(what) {
    // A stream that does not end fails the test.
    contract::prepare_call(context, "", std::chrono::seconds(20));
  }
  ~OpenCall() {
    context.TryCancel();
    if (thread_.joinable()) thread_.join();
  }

  /// `run` blocks until the stream has ended.
  template <typename Run>
  void start(Run run) {
    thread_ = std::thread([this, run = std::move(run)] {
      status_ = run(context);
      ended_ = std::chrono::steady_clock::now();
    });
  }
  /// Waits for the end, and checks that it came soon after the end of the certificate, and because
  /// of it.
  void expect_end_after(std::chrono::steady_clock::time_point certificate_end) {
    thread_.join();
    const double late = std::chrono::duration<double>(ended_ - certificate_end).count();
    std::printf("%s ended %.2f s after its certificate: %s\n", what_, late,
                status_.error_message().c_str());
    EXPECT_GT(late, 0) << what_ << " was not open";
    EXPECT_LT(ended_ - certificate_end, kStreamLimit) << what_;
    const grpc::StatusCode code = status_.error_code();
    EXPECT_TRUE(code == grpc::StatusCode::UNAUTHENTICATED || code == grpc::StatusCode::CANCELLED)
        << what_ << ": " << code << " " << status_.error_message();
  }

  grpc::ClientContext context;

 private:
  const char* const what_;
  std::thread thread_;
  grpc::Status status_;
  std::chrono::steady_clock::time_point ended_;
};

/// A farm whose callers have streams open when their certificates end.
class OpenStreamsFarm : public SecureFarm {
 protected:
  /// Reads a stream to its end.
  template <typename Response, typename Stream>
  static grpc::Status drain(Stream& stream) {
    for (Response response; stream.Read(&response);) {
    }
    return stream.Finish();
  }
  void open_watch(OpenCall& call, const std::string& name, const std::string& job_id) const {
    call.start([stub = jobs(name), job_id](grpc::ClientContext& context) {
      v1::WatchJobRequest request;
      request.set_job_id(job_id);
      const auto stream = stub->WatchJob(&context, request);
      return drain<v1::WatchJobResponse>(*stream);
    });
  }
  void open_events(OpenCall& call, const std::string& name) const {
    call.start([stub = jobs(name)](grpc::ClientContext& context) {
      v1::WatchEventsRequest request;
      request.set_follow(true);
      const auto stream = stub->WatchEvents(&context, request);
      return drain<v1::WatchEventsResponse>(*stream);
    });
  }
  /// Begins an upload and sends nothing more.
  void open_upload(OpenCall& call, const std::string& name) const {
    call.start([stub = v1::AssetService::NewStub(channel(name))](grpc::ClientContext& context) {
      v1::UploadAssetResponse response;
      const auto stream = stub->UploadAsset(&context, &response);
      v1::UploadAssetRequest request;
      *request.mutable_asset() = id_of(std::string(1000, 'u'));
      stream->Write(request);
      return stream->Finish();
    });
  }
  /// A worker with the certificate `name` that has delivered one unit of the job.
  std::unique_ptr<TestWorker> worker_at_work(const std::string& name, const std::string& job) {
    auto opened = worker(name, "one", token());
    EXPECT_TRUE(opened->open());
    TestWorker::Unit unit;
    EXPECT_TRUE(opened->next(unit));
    EXPECT_TRUE(opened->describe(job).ok());
    EXPECT_TRUE(opened->send(opened->messages_of(unit, opened->block_of(unit))));
    return opened;
  }
  /// Keeps both streams of a worker open.
  static void open_worker_streams(TestWorker& worker, OpenCall& work, OpenCall& deliver) {
    deliver.start([&worker](grpc::ClientContext&) {
      const std::chrono::milliseconds pause{20};
      while (worker.send({v1::DeliverRequest()})) std::this_thread::sleep_for(pause);
      return worker.finish_deliver();
    });
    work.start([&worker](grpc::ClientContext&) {
      TestWorker::Unit next;
      while (worker.next(next)) {
      }
      return worker.finish_work();
    });
  }
  /// Uploads an asset in several messages.
  void upload_large(const std::string& name, const std::string& bytes) const {
    grpc::ClientContext context;
    prepare(context);
    v1::UploadAssetResponse response;
    const auto stub = v1::AssetService::NewStub(channel(name));
    const auto stream = stub->UploadAsset(&context, &response);
    v1::UploadAssetRequest request;
    *request.mutable_asset() = id_of(bytes);
    stream->Write(request);
    for (std::size_t at = 0; at < bytes.size(); at += 1 << 20) {
      request.set_chunk(bytes.substr(at, 1 << 20));
      if (!stream->Write(request)) break;
    }
    stream->WritesDone();
    const grpc::Status status = stream->Finish();
    ASSERT_TRUE(status.ok()) << status.error_message();
  }
};

}  // namespace tessera::server
