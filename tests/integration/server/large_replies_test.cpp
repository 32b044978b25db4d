#include <gtest/gtest.h>

#include <set>
#include <thread>
#include <utility>

#include "server/service/messages/messages.h"
#include "server/service/streams/report_stream.h"
#include "tests/integration/server/support/test_farm.h"

namespace tessera::server {
namespace {

/// A server that sends one report.
class ReportServer : public v1::JobService::CallbackService {
 public:
  explicit ReportServer(std::string report) : report_(std::move(report)) {
    grpc::ServerBuilder builder;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port_);
    builder.RegisterService(this);
    server_ = builder.BuildAndStart();
  }

  /// Returns the parts as a client with the default limit of message sizes receives them.
  std::vector<std::string> read_parts() const {
    const auto stub = v1::JobService::NewStub(grpc::CreateChannel(
        "127.0.0.1:" + std::to_string(port_), grpc::InsecureChannelCredentials()));
    grpc::ClientContext context;
    const auto stream = stub->GetJobReport(&context, v1::GetJobReportRequest());
    std::vector<std::string> parts;
    for (v1::GetJobReportResponse part; stream->Read(&part);) parts.push_back(part.report_json());
    const grpc::Status status = stream->Finish();
    EXPECT_TRUE(status.ok()) << status.error_message();
    return parts;
  }

  /// Whether the report was read on another thread than that of gRPC which took the request.
  bool was_read_apart() const { return reader_ != handler_; }

 private:
  grpc::ServerWriteReactor<v1::GetJobReportResponse>* GetJobReport(
      grpc::CallbackServerContext* /*context*/,
      const v1::GetJobReportRequest* /*request*/) override {
    handler_ = std::this_thread::get_id();
    return send_report(io_, Caller{}, [this]() -> absl::StatusOr<std::string> {
      reader_ = std::this_thread::get_id();
      return report_;
    });
  }

  const std::string report_;
  std::thread::id handler_, reader_;
  IoPool io_{1};
  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

std::string joined(const std::vector<std::string>& parts) {
  std::string text;
  for (const std::string& part : parts) text += part;
  return text;
}

TEST(LargeReplies, ReportBeyondMessageLimitArrives) {
  const std::string report(std::size_t{9} << 20, 'r');
  EXPECT_EQ(joined(ReportServer(report).read_parts()), report);
  EXPECT_EQ(ReportServer("{}").read_parts(), std::vector<std::string>{"{}"});
}

TEST(LargeReplies, ReportIsReadOnThreadOfThePool) {
  const ReportServer server("{}");
  EXPECT_EQ(server.read_parts().size(), 1U);
  EXPECT_TRUE(server.was_read_apart());
}

TEST(LargeReplies, PartsOfReportHoldWholeCharacters) {
  std::string report = "r";  // 1 MiB is no multiple of the character's 3 bytes
  while (report.size() < (std::size_t{2} << 20)) report += "\xE2\x82\xAC";
  const std::vector<std::string> parts = ReportServer(report).read_parts();
  ASSERT_EQ(parts.size(), 3u);
  EXPECT_EQ(joined(parts), report);
  for (const std::string& part : parts) EXPECT_EQ(part.size() % 3, &part == &parts[0] ? 1u : 0u);
}

TEST(LargeReplies, MissingTilesComeInSeveralMessages) {
  FrameFile file;
  file.missing_tiles.assign(4 * kTilesPerMessage + 1, {8, 8, 8, 8});
  const v1::FrameHeader header = to_message(file);
  std::size_t count = static_cast<std::size_t>(header.missing_tiles_size());
  EXPECT_LT(header.ByteSizeLong(), static_cast<std::size_t>(contract::kMaxMessageBytes));
  while (count < file.missing_tiles.size()) {
    const v1::MissingTiles more = missing_tiles_from(file, count);
    ASSERT_GT(more.tiles_size(), 0);
    EXPECT_LT(more.ByteSizeLong(), static_cast<std::size_t>(contract::kMaxMessageBytes));
    count += static_cast<std::size_t>(more.tiles_size());
  }
  EXPECT_EQ(count, file.missing_tiles.size());
}

class LargeLists : public TestFarm {
 protected:
  v1::ListWorkersResponse workers(std::int32_t size, const std::string& token) {
    grpc::ClientContext context;
    prepare(context);
    v1::ListWorkersRequest request;
    request.set_page_size(size);
    request.set_page_token(token);
    v1::ListWorkersResponse page;
    const auto stub = v1::WorkerService::NewStub(server_->channel());
    const grpc::Status status = stub->ListWorkers(&context, request, &page);
    EXPECT_EQ(status.ok(), size >= 0) << status.error_message();
    return page;
  }
};

TEST_F(LargeLists, JobListEndsPageBeforeMessageLimit) {
  ASSERT_TRUE(upload(id_of(kScene), kScene).ok());
  constexpr int kJobs = 150;
  for (int i = 0; i < kJobs; ++i) {
    v1::CreateJobRequest request = request_of("job" + std::to_string(i));
    while (request.settings().frames_size() < 4096) {
      *request.mutable_settings()->add_frames() = request.settings().frames(0);
    }
    for (auto& range : *request.mutable_settings()->mutable_frames()) {
      range.set_first(1 << 30);
      range.set_last(1 << 30);
    }
    v1::CreateJobResponse response;
    const grpc::Status status = create(request, response);
    ASSERT_TRUE(status.ok()) << status.error_message();
  }
  std::set<std::string> names;
  v1::ListJobsRequest request;
  request.set_page_size(1000);
  int pages = 0;
  do {
    grpc::ClientContext context;
    prepare(context);
    v1::ListJobsResponse page;
    ASSERT_TRUE(jobs_->ListJobs(&context, request, &page).ok());
    EXPECT_LT(page.ByteSizeLong(), static_cast<std::size_t>(contract::kMaxMessageBytes));
    for (const v1::Job& job : page.jobs()) names.insert(job.name());
    request.set_page_token(page.next_page_token());
    ++pages;
  } while (!request.page_token().empty());
  EXPECT_EQ(names.size(), std::size_t{kJobs});
  EXPECT_GT(pages, 1);
}

TEST_F(LargeLists, WorkersAreListedInPages) {
  std::vector<std::unique_ptr<TestWorker>> connected;
  for (const char* id : {"w3", "w1", "w2"}) {
    connected.push_back(std::make_unique<TestWorker>(server_->channel(), id));
    ASSERT_TRUE(connected.back()->open());
  }
  const v1::ListWorkersResponse first = workers(2, "");
  ASSERT_EQ(first.workers_size(), 2);
  EXPECT_EQ(first.workers(0).id(), "w1");
  EXPECT_EQ(first.workers(1).id(), "w2");
  const v1::ListWorkersResponse second = workers(2, first.next_page_token());
  ASSERT_EQ(second.workers_size(), 1);
  EXPECT_EQ(second.workers(0).id(), "w3");
  EXPECT_EQ(second.next_page_token(), "");
  EXPECT_EQ(workers(0, "").workers_size(), 3);
  workers(-1, "");
}

}  // namespace
}  // namespace tessera::server
