// A certificate is revoked while its holder has streams open.
#include <chrono>
#include <cstdio>
#include <string>
#include <thread>

#include "tests/integration/server/security/open_streams_farm.h"

namespace tessera::server {
namespace {

using Clock = std::chrono::steady_clock;
using grpc::StatusCode;
using std::chrono::milliseconds;
using std::chrono::seconds;

class RevocationTest : public OpenStreamsFarm {
 protected:
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
  std::this_thread::sleep_for(kStreamLimit);
  while (stream->Read(&response)) received += response.chunk().size();
  const grpc::Status status = stream->Finish();
  EXPECT_EQ(status.error_code(), StatusCode::CANCELLED) << status.error_message();
  EXPECT_LT(received, bytes.size());
}

TEST_F(RevocationTest, UnitsOfWorkerAreLeasedToAnother) {
  const std::string job = create_job("ann", "shot");
  const auto first = worker_at_work("w1", job);
  OpenCall work("work"), deliver("deliver");
  const Clock::time_point revoked = revoke_now(Role::worker, "w1");
  open_worker_streams(*first, work, deliver);
  deliver.expect_end_after(revoked);
  work.expect_end_after(revoked);
  EXPECT_EQ(first->describe(job).error_code(), StatusCode::UNAUTHENTICATED);
  const auto second = worker("w2", "two", token());
  ASSERT_TRUE(second->open());
  EXPECT_EQ(second->work(), 17) << "two passes of nine tiles, but for the one that was delivered";
  std::printf("the job was done %.2f s after the revocation\n",
              std::chrono::duration<double>(Clock::now() - revoked).count());
  EXPECT_LT(Clock::now() - revoked, kStreamLimit + seconds(5))
      << "the timeout of a lost worker is 5 s";
}

}  // namespace
}  // namespace tessera::server
