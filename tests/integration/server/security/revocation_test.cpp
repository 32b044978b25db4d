// A certificate is revoked while its holder has streams open.
#include <chrono>
#include <cstdio>
#include <string>
#include <thread>

#include "tests/integration/server/support/secure_farm.h"

namespace tessera::server {
namespace {

using Clock = std::chrono::steady_clock;
using grpc::StatusCode;
using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr seconds kLimit{5};  // within which a revocation must take effect

/// A stream on a thread of its own, which notes when and how it ends.
class OpenCall {
 public:
  explicit OpenCall(const char* what) : what_(what) {
    contract::prepare_call(context, "", seconds(20));  // a stream that does not end fails the test
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
      ended_ = Clock::now();
    });
  }
  /// Waits for the end, and checks that it came soon after `revoked` and because of it.
  void expect_end_after(Clock::time_point revoked) {
    thread_.join();
    const double late = std::chrono::duration<double>(ended_ - revoked).count();
    std::printf("%s ended %.2f s after the revocation: %s\n", what_, late,
                status_.error_message().c_str());
    EXPECT_GT(late, 0) << what_ << " was not open";
    EXPECT_LT(ended_ - revoked, kLimit) << what_;
    const StatusCode code = status_.error_code();
    EXPECT_TRUE(code == StatusCode::UNAUTHENTICATED || code == StatusCode::CANCELLED)
        << what_ << ": " << code << " " << status_.error_message();
  }

  grpc::ClientContext context;

 private:
  const char* const what_;
  std::thread thread_;
  grpc::Status status_;
  Clock::time_point ended_;
};

class RevocationTest : public SecureFarm {
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
  Clock::time_point revoke_now(Role role, const std::string& name) const {
    EXPECT_TRUE(revoke(certs_, role, name).ok());
    return Clock::now();
  }
};

TEST_F(RevocationTest, ClientsStreamsEndInFiveSeconds) {
  const std::string job = create_job("ann", "shot");
  const std::string other = create_job("bob", "other");
  OpenCall watch("watch"), events("events"), upload("upload");
  open_watch(watch, "ann", job);
  open_events(events, "ann");
  open_upload(upload, "ann");
  grpc::ClientContext context;
  const auto bob = jobs("bob");
  v1::WatchJobRequest request;
  request.set_job_id(other);
  const auto others_watch = bob->WatchJob(&context, request);
  v1::WatchJobResponse response;
  ASSERT_TRUE(others_watch->Read(&response));
  std::this_thread::sleep_for(milliseconds(500));
  const Clock::time_point revoked = revoke_now(Role::client, "ann");
  for (OpenCall* call : {&watch, &events, &upload}) call->expect_end_after(revoked);
  grpc::ClientContext pause;
  prepare(pause);
  v1::PauseJobRequest pausing;
  pausing.set_job_id(other);
  v1::PauseJobResponse paused;
  ASSERT_TRUE(bob->PauseJob(&pause, pausing, &paused).ok());
  EXPECT_TRUE(others_watch->Read(&response)) << "another client's stream stays open";
  context.TryCancel();
}

TEST_F(RevocationTest, TransferThatNobodyReadsIsCut) {
  const std::string bytes(32 << 20, 'd');
  upload_large("root", bytes);
  grpc::ClientContext context;
  v1::DownloadAssetRequest request;
  *request.mutable_asset() = id_of(bytes);
  const auto stub = v1::AssetService::NewStub(channel("root"));
  const auto stream = stub->DownloadAsset(&context, request);
  v1::DownloadAssetResponse response;
  ASSERT_TRUE(stream->Read(&response));
  std::size_t received = response.chunk().size();
  revoke_now(Role::admin, "root");
  std::this_thread::sleep_for(kLimit);
  while (stream->Read(&response)) received += response.chunk().size();
  const grpc::Status status = stream->Finish();
  EXPECT_EQ(status.error_code(), StatusCode::CANCELLED) << status.error_message();
  EXPECT_LT(received, bytes.size());
}

TEST_F(RevocationTest, UnitsOfWorkerAreLeasedToAnother) {
  const std::string job = create_job("ann", "shot");
  const auto first = worker("w1", "one", token());
  ASSERT_TRUE(first->open());
  TestWorker::Unit unit;
  ASSERT_TRUE(first->next(unit));
  ASSERT_TRUE(first->describe(job).ok());
  ASSERT_TRUE(first->send(first->messages_of(unit, first->block_of(unit))));
  OpenCall work("work"), deliver("deliver");
  const Clock::time_point revoked = revoke_now(Role::worker, "w1");
  deliver.start([&](grpc::ClientContext&) {
    while (first->send({v1::DeliverRequest()})) std::this_thread::sleep_for(milliseconds(20));
    return first->finish_deliver();
  });
  work.start([&](grpc::ClientContext&) {
    TestWorker::Unit next;
    while (first->next(next)) {
    }
    return first->finish_work();
  });
  deliver.expect_end_after(revoked);
  work.expect_end_after(revoked);
  EXPECT_EQ(first->describe(job).error_code(), StatusCode::UNAUTHENTICATED);
  const auto second = worker("w2", "two", token());
  ASSERT_TRUE(second->open());
  EXPECT_EQ(second->work(), 17) << "two passes of nine tiles, but for the one that was delivered";
  std::printf("the job was done %.2f s after the revocation\n",
              std::chrono::duration<double>(Clock::now() - revoked).count());
  EXPECT_LT(Clock::now() - revoked, kLimit + seconds(5)) << "the timeout of a lost worker is 5 s";
}

}  // namespace
}  // namespace tessera::server
