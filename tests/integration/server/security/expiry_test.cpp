// Certificates expire while their holders have streams open.
#include <algorithm>
#include <chrono>
#include <ctime>
#include <filesystem>
#include <random>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "client/api/farm_client.h"
#include "contract/film_block.h"
#include "server/identity/private_file.h"
#include "tests/integration/server/security/open_streams_farm.h"

namespace tessera::server {
namespace {

using Clock = std::chrono::steady_clock;
using grpc::StatusCode;
using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr int kValidSeconds = 6;
/// Long enough that the renewed certificate is not due before the streams of the old one have
/// ended.
constexpr int kRenewedSeconds = 12;

/// Pixels of a frame that is too large for the buffers of a connection, and that no compression
/// makes small.
constexpr std::int32_t kNoiseWidth = 1024, kNoiseHeight = 1024, kNoiseTile = 64;

class ExpiryTest : public OpenStreamsFarm {
 protected:
  /// Issues a certificate that is valid from now on.
  void issue_brief(Role role, const std::string& name, int length = kValidSeconds) const {
    std::filesystem::remove_all(certs_of(name));
    const std::int64_t now = std::time(nullptr);
    ASSERT_TRUE(issue(certs_, role, name, certs_of(name), {now, now + length}).ok());
  }
  std::int64_t expiry_of(const std::string& name) const {
    return read_identity(read_file(certs_of(name) + "/tls.crt").value())->expires_s;
  }
  static Clock::time_point steady(std::int64_t seconds_since_1970) {
    const auto wall = std::chrono::system_clock::from_time_t(seconds_since_1970);
    return Clock::now() +
           std::chrono::duration_cast<Clock::duration>(wall - std::chrono::system_clock::now());
  }

  /// Waits until the job is done. The server may take its worker, which sends nothing meanwhile,
  /// for lost before the image is written.
  void expect_done(const std::string& owner, const std::string& job_id) const {
    grpc::ClientContext context;
    contract::prepare_call(context, "", std::chrono::minutes(2));
    v1::WatchJobRequest request;
    request.set_job_id(job_id);
    const auto stub = jobs(owner);
    const auto stream = stub->WatchJob(&context, request);
    v1::Job::State state = v1::Job::STATE_UNSPECIFIED;
    for (v1::WatchJobResponse response; stream->Read(&response);) state = response.job().state();
    EXPECT_EQ(state, v1::Job::STATE_DONE);
  }
  /// Waits until the server takes back the units of the worker, a few seconds after its last
  /// message.
  void wait_until_lost(const std::string& worker_id) const {
    const auto stub = v1::WorkerService::NewStub(channel("root"));
    const auto is_lost = [&] {
      grpc::ClientContext context;
      prepare(context);
      v1::ListWorkersResponse response;
      EXPECT_TRUE(stub->ListWorkers(&context, {}, &response).ok());
      return std::any_of(
          response.workers().begin(), response.workers().end(), [&](const v1::Worker& worker) {
            return worker.id() == worker_id && worker.state() == v1::Worker::STATE_LOST;
          });
    };
    for (int i = 0; i < 200 && !is_lost(); ++i) std::this_thread::sleep_for(milliseconds(100));
    EXPECT_TRUE(is_lost()) << worker_id;
  }
  /// Has w2 render a frame of noise for `owner`. Returns the job's id.
  std::string render_noise(const std::string& owner) const {
    EXPECT_TRUE(upload_scene(owner).ok());
    v1::CreateJobRequest request = request_of("noise", 8);
    request.mutable_settings()->set_width_px(kNoiseWidth);
    request.mutable_settings()->set_height_px(kNoiseHeight);
    request.mutable_settings()->set_tile_px(kNoiseTile);
    v1::CreateJobResponse response;
    const grpc::Status status = create(owner, request, response);
    EXPECT_TRUE(status.ok()) << status.error_message();
    std::mt19937 rng(7);
    std::vector<float> noise(1 << 20);
    for (float& value : noise) value = static_cast<float>(rng()) * 0x1p-32f;
    const auto renderer = worker("w2", "renderer", token());
    EXPECT_TRUE(renderer->open());
    contract::FilmBlock block = contract::FilmBlock::zeros({kNoiseTile, kNoiseTile, 0, true});
    std::fill(block.alpha.begin(), block.alpha.end(), 8.0f);
    std::size_t offset = 0;
    for (TestWorker::Unit unit; renderer->next(unit);) {
      offset = (offset + 49'157) % (noise.size() - block.rgb.size());
      std::copy_n(&noise[offset], block.rgb.size(), block.rgb.begin());
      renderer->send(renderer->messages_of(unit, contract::encode(block)));
      EXPECT_EQ(renderer->next_acknowledgement().status(),
                v1::Acknowledgement::ACK_STATUS_COMMITTED);
      renderer->grant(1);
    }
    expect_done(owner, response.job().id());
    return response.job().id();
  }
};

TEST_F(ExpiryTest, ClientsStreamsEndInFiveSeconds) {
  const std::string done = render_noise("ann");
  const std::string job = create_job("ann", "shot");
  issue_brief(Role::client, "ann");
  const Clock::time_point end = steady(expiry_of("ann"));
  OpenCall watch("watch"), events("events"), upload("upload");
  open_watch(watch, "ann", job);
  open_events(events, "ann");
  open_upload(upload, "ann");
  grpc::ClientContext context;
  prepare(context);
  const auto ann = jobs("ann");
  v1::FetchFrameRequest request;
  request.set_job_id(done);
  const auto fetch = ann->FetchFrame(&context, request);
  v1::FetchFrameResponse response;
  ASSERT_TRUE(fetch->Read(&response));
  const std::int64_t size = response.header().size_bytes();
  std::int64_t received = 0;
  for (OpenCall* call : {&watch, &events, &upload}) call->expect_end_after(end);
  std::this_thread::sleep_until(end + kStreamLimit);  // nobody reads the fetch
  while (fetch->Read(&response)) received += static_cast<std::int64_t>(response.chunk().size());
  const grpc::Status status = fetch->Finish();
  EXPECT_EQ(status.error_code(), StatusCode::CANCELLED) << status.error_message();
  EXPECT_LT(received, size);
}

TEST_F(ExpiryTest, WorkersStreamsEndInFiveSeconds) {
  const std::string job = create_job("ann", "shot");
  issue_brief(Role::worker, "w1");
  const Clock::time_point end = steady(expiry_of("w1"));
  const auto first = worker_at_work("w1", job);
  OpenCall work("work"), deliver("deliver");
  open_worker_streams(*first, work, deliver);
  deliver.expect_end_after(end);
  work.expect_end_after(end);
  // A test's worker sends no heartbeats: one that waited for these units would be lost as well.
  wait_until_lost("one");
  const auto second = worker("w2", "two", token());
  ASSERT_TRUE(second->open());
  EXPECT_EQ(second->work(), 17) << "two passes of nine tiles, but for the one that was delivered";
}

TEST_F(ExpiryTest, FetchOfRenewedClientIsCompleted) {
  const std::string job = render_noise("ann");
  issue_brief(Role::client, "ann", kRenewedSeconds);
  const std::int64_t first_expiry = expiry_of("ann");
  const Clock::time_point cut = steady(first_expiry) + milliseconds(3500);
  // The first transfer is so slow that it has not ended when it is cut.
  constexpr seconds kPause{4};
  client::Connection connection;
  connection.server = server_->address();
  connection.certs = certs_of("ann");
  const auto ann = client::FarmClient::connect(connection).value();
  int starts = 0;
  v1::FrameHeader header;
  std::string image;
  client::FarmClient::FrameSink sink;
  sink.start = [&](const v1::FrameHeader& received) {
    ++starts;
    header = received;
    image.clear();
    return absl::OkStatus();
  };
  sink.write = [&](std::string_view chunk) {
    std::this_thread::sleep_until(std::min(cut, Clock::now() + kPause));
    image += chunk;
    return absl::OkStatus();
  };
  v1::FetchFrameRequest request;
  request.set_job_id(job);
  const absl::Status status = ann->fetch_frame(request, sink);
  ASSERT_TRUE(status.ok()) << status;
  EXPECT_GE(starts, 2) << "the first transfer was cut";
  EXPECT_GT(expiry_of("ann"), first_expiry);
  EXPECT_EQ(static_cast<std::int64_t>(image.size()), header.size_bytes());
  EXPECT_EQ(contract::sha256(image).binary(), header.file_sha256());
}

}  // namespace
}  // namespace tessera::server
