#include <gtest/gtest.h>
#include <zstd.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "tests/integration/server/support/test_farm.h"

namespace tessera::server {
namespace {

/// A reference of the test jobs' 48 x 40 pixels.
const std::string black_reference(std::size_t{16} * 48 * 40, '\0');

class FarmTest : public TestFarm {
 protected:
  nlohmann::json report_of(const std::string& job) {
    grpc::ClientContext context;
    prepare(context);
    v1::GetJobReportRequest request;
    request.set_job_id(job);
    const auto stream = jobs_->GetJobReport(&context, request);
    std::string report;
    for (v1::GetJobReportResponse part; stream->Read(&part);) report += part.report_json();
    EXPECT_TRUE(stream->Finish().ok());
    return nlohmann::json::parse(report);
  }
};

std::unique_ptr<TestWorker> worker_of(const TestServer& server, const std::string& id) {
  return std::make_unique<TestWorker>(server.channel(), id);
}

// Whole jobs --------------------------------------------------------------------------------------

TEST_F(FarmTest, JobRendersFromSubmissionToImage) {
  const std::string job = create_job("a", 64);
  auto worker = worker_of(*server_, "w1");
  ASSERT_TRUE(worker->open());
  EXPECT_EQ(worker->work(), 9 * 2);
  const auto states = watch(job);
  ASSERT_FALSE(states.empty());
  EXPECT_EQ(states.back().state(), v1::Job::STATE_DONE);
  EXPECT_EQ(states.back().progress().committed_sample_count(), 48 * 40 * 64);
  const v1::FrameHeader header = fetch_exr(job);
  EXPECT_EQ(header.pixels_sha256().size(), 32u);

  const nlohmann::json report = report_of(job);
  for (const char* key : {"schema",
                          "version",
                          "job",
                          "contract",
                          "status",
                          "reasons",
                          "warnings",
                          "scene_sha256",
                          "settings",
                          "frames",
                          "cpu_seconds",
                          "cpu_seconds_wasted",
                          "wall_seconds",
                          "load_seconds",
                          "build_seconds",
                          "render_seconds",
                          "overhead_fraction",
                          "peak_rss_bytes",
                          "accelerator",
                          "units",
                          "workers"}) {
    EXPECT_TRUE(report.contains(key)) << key;
  }
  EXPECT_EQ(report["schema"], "tessera.report/1");
  EXPECT_EQ(report["status"], "DONE");
  EXPECT_EQ(report["units"]["total"], 18);
  EXPECT_EQ(report["workers"][0]["units"], 18);
  const auto& frame = report["frames"].at(0);
  for (const char* key :
       {"frame", "file", "width", "height", "pixels_sha256", "spp_mean", "spp_max", "samples",
        "status", "mean_luminance", "estimated", "true", "heavy_tail_share", "unseen_event_bound",
        "dropped_samples", "clamped_energy", "truncated_energy", "curve"}) {
    EXPECT_TRUE(frame.contains(key)) << key;
  }
  EXPECT_TRUE(frame["true"].is_null());
  EXPECT_EQ(frame["curve"].size(), 2u);
  EXPECT_EQ(frame["pixels_sha256"], contract::Digest::from_binary(header.pixels_sha256())->hex());
}

TEST_F(FarmTest, ReportHasWorkPerRayOfAccelerator) {
  const std::string job = create_job("a", 64);
  const nlohmann::json before = report_of(job)["accelerator"];
  EXPECT_EQ(before["name"], "production");
  EXPECT_TRUE(before["rays"].is_null());
  EXPECT_TRUE(before["nodes_per_ray"].is_null());
  auto worker = worker_of(*server_, "w1");
  ASSERT_TRUE(worker->open());
  ASSERT_EQ(worker->work(), 9 * 2);
  watch(job);
  const nlohmann::json after = report_of(job)["accelerator"];
  EXPECT_EQ(after["rays"], 8 * 18);
  EXPECT_EQ(after["nodes_per_ray"], 2.5);
  EXPECT_EQ(after["primitives_per_ray"], 0.5);
}

TEST_F(FarmTest, ReportWarnsOfRoundedSampleCount) {
  EXPECT_TRUE(report_of(create_job("a", 64))["warnings"].empty());
  const nlohmann::json warnings = report_of(create_job("b", 62))["warnings"];
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_EQ(warnings[0], "--spp 62 was rounded up to 64");
}

TEST_F(FarmTest, ReferenceGivesTrueErrorPerPass) {
  ASSERT_TRUE(upload(id_of(kScene), kScene).ok());
  v1::CreateJobRequest request = request_of("a", 64);
  *request.add_references() = id_of(black_reference);
  v1::CreateJobResponse made;
  const grpc::Status refused = create(request, made);
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_NE(refused.error_message().find("references"), std::string::npos);
  ASSERT_TRUE(upload(id_of(black_reference), black_reference).ok());
  ASSERT_TRUE(create(request, made).ok());
  auto worker = worker_of(*server_, "w1");
  ASSERT_TRUE(worker->open());
  EXPECT_EQ(worker->work(), 9 * 2);
  watch(made.job().id());
  const auto frame = report_of(made.job().id())["frames"].at(0);
  const auto& curve = frame["curve"];
  ASSERT_EQ(curve.size(), 2u);
  for (const auto& point : curve) {
    EXPECT_GT(point["error_true"].get<double>(), 0);
    EXPECT_NE(point["error_true"], point["error"]) << "the estimate does not use the reference";
  }
  EXPECT_EQ(frame["true"]["error"], curve[1]["error_true"]) << "the image's is that of the last";
}

TEST_F(FarmTest, WorkStreamWithoutHelloTimesOut) {
  const std::string job = create_job("a", 64);
  auto worker = worker_of(*server_, "w1");
  ASSERT_TRUE(worker->open());
  grpc::ClientContext context;
  prepare(context);
  const auto stub = v1::WorkerService::NewStub(server_->channel());
  const auto silent = stub->Work(&context);
  v1::WorkResponse response;
  EXPECT_FALSE(silent->Read(&response));
  const grpc::Status status = silent->Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::DEADLINE_EXCEEDED);
  EXPECT_EQ(status.error_message(), "timed out waiting for Hello");
  EXPECT_EQ(worker->work(), 9 * 2);
}

TEST_F(FarmTest, RestartMidJobKeepsEveryPixel) {
  const std::string whole = create_job("whole", 64);
  {
    auto worker = worker_of(*server_, "w1");
    ASSERT_TRUE(worker->open());
    worker->work();
    EXPECT_EQ(watch(whole).back().state(), v1::Job::STATE_DONE);
  }
  const std::string cut = create_job("cut", 64);
  {
    auto worker = worker_of(*server_, "w1");
    ASSERT_TRUE(worker->open());
    EXPECT_EQ(worker->work(7), 7);
  }
  restart();
  auto worker = worker_of(*server_, "w2");
  ASSERT_TRUE(worker->open());
  EXPECT_EQ(worker->work(), 18 - 7) << "no acknowledged unit is rendered again";
  EXPECT_EQ(watch(cut).back().state(), v1::Job::STATE_DONE);
  EXPECT_EQ(fetch_exr(cut).pixels_sha256(), fetch_exr(whole).pixels_sha256());
}

TEST_F(FarmTest, ImagesAreExportedAsPngAndJpeg) {
  const std::string job = create_job("a");
  auto worker = worker_of(*server_, "w1");
  ASSERT_TRUE(worker->open());
  worker->work();
  watch(job);
  v1::FetchFrameRequest request;
  request.set_job_id(job);
  const std::pair<v1::FetchFrameRequest::Format, std::string> kinds[] = {
      {v1::FetchFrameRequest::FORMAT_PNG, "\x89PNG"},
      {v1::FetchFrameRequest::FORMAT_JPEG, "\xff\xd8\xff"}};
  for (const auto& [format, magic] : kinds) {
    request.set_format(format);
    v1::FrameHeader header;
    std::string bytes;
    ASSERT_TRUE(fetch(request, header, bytes).ok());
    EXPECT_EQ(bytes.substr(0, magic.size()), magic);
    EXPECT_EQ(contract::sha256(bytes).binary(), header.file_sha256());
  }
  request.set_frame(5);
  v1::FrameHeader header;
  std::string bytes;
  EXPECT_EQ(fetch(request, header, bytes).error_code(), grpc::StatusCode::NOT_FOUND);
}

// Assets ------------------------------------------------------------------------------------------

/// Uploads small assets, which are rows, and one that is a file of several chunks.
class FarmAssetTest : public FarmTest, public ::testing::WithParamInterface<std::size_t> {};
INSTANTIATE_TEST_SUITE_P(Bytes, FarmAssetTest, ::testing::Values(5'000, 65'536, 65'537, 2'500'000));

TEST_P(FarmAssetTest, AppearsOnceVerified) {
  const std::string bytes(GetParam(), 'x');
  EXPECT_TRUE(is_missing(id_of(bytes)));
  EXPECT_EQ(upload(id_of(bytes), bytes.substr(1)).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(upload(id_of(bytes), std::string(GetParam(), 'y')).error_code(),
            grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(upload(id_of(bytes), bytes + "x").error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_TRUE(is_missing(id_of(bytes)));
  EXPECT_TRUE(upload(id_of(bytes), bytes).ok());
  EXPECT_TRUE(upload(id_of(bytes), bytes).ok()) << "repeating it is harmless";
  EXPECT_FALSE(is_missing(id_of(bytes)));
  std::string got;
  EXPECT_TRUE(download(id_of(bytes), got).ok());
  EXPECT_EQ(got, bytes);
}

TEST_F(FarmTest, EmptyAssetIsAccepted) {
  ASSERT_TRUE(upload(id_of(""), "").ok());
  grpc::ClientContext context;
  prepare(context);
  v1::DownloadAssetRequest request;
  *request.mutable_asset() = id_of("");
  auto stream = assets_->DownloadAsset(&context, request);
  v1::DownloadAssetResponse response;
  EXPECT_TRUE(stream->Read(&response));
  EXPECT_TRUE(response.chunk().empty());
  EXPECT_FALSE(stream->Read(&response));
  EXPECT_TRUE(stream->Finish().ok());
}

// Requests ----------------------------------------------------------------------------------------

TEST_F(FarmTest, MalformedJobErrorNamesField) {
  ASSERT_TRUE(upload(id_of(kScene), kScene).ok());
  using Edit = std::function<void(v1::CreateJobRequest&)>;
  const std::pair<const char*, Edit> cases[] = {
      {"request_id", [](auto& r) { r.clear_request_id(); }},
      {"name", [](auto& r) { r.set_name(std::string(201, 'n')); }},
      {"name", [](auto& r) { r.set_name(std::string("a\0b", 3)); }},
      {"name", [](auto& r) { r.set_name("a\n2026-01-01 forged"); }},
      {"request_id", [](auto& r) { r.set_request_id("\x1b[2J"); }},
      {"required_tag", [](auto& r) { r.set_required_tag("gpu\t"); }},
      {"pool", [](auto& r) { r.set_pool("a b"); }},
      {"limits.limit", [](auto& r) { r.add_limits()->set_unit_count(1); }},
      {"limits.unit_count", [](auto& r) { r.add_limits()->set_limit("licence"); }},
      {"limits: licence is named twice",
       [](auto& r) {
         for (int i = 0; i < 2; ++i) {
           r.add_limits()->set_limit("licence");
           r.mutable_limits(i)->set_unit_count(1);
         }
       }},
      {"dependencies.kind", [](auto& r) { r.add_dependencies()->set_job_id("a"); }},
      {"dependencies.job_id",
       [](auto& r) { r.add_dependencies()->set_kind(v1::JobDependency::KIND_END); }},
      {"priority", [](auto& r) { r.set_priority(101); }},
      {"max_worker_count", [](auto& r) { r.set_max_worker_count(-1); }},
      {"width_px", [](auto& r) { r.mutable_settings()->set_width_px(0); }},
      {"tile_px", [](auto& r) { r.mutable_settings()->set_tile_px(24); }},
      {"tile_px",
       [](auto& r) {
         r.mutable_settings()->set_width_px(65536);
         r.mutable_settings()->set_height_px(65536);
         r.mutable_settings()->set_tile_px(8);
       }},
      {"camera", [](auto& r) { r.mutable_settings()->set_camera(std::string(1001, 'c')); }},
      {"camera", [](auto& r) { r.mutable_settings()->set_camera("a\nb"); }},
      {"animation", [](auto& r) { r.mutable_settings()->set_animation(std::string(1001, 'a')); }},
      {"variant", [](auto& r) { r.mutable_settings()->set_variant(std::string(1001, 'v')); }},
      {"frames",
       [](auto& r) {
         while (r.settings().frames_size() <= 4096) {
           *r.mutable_settings()->add_frames() = r.settings().frames(0);
         }
       }},
      {"fps", [](auto& r) { r.mutable_settings()->set_fps(std::nan("")); }},
      {"scene_uri", [](auto& r) { r.mutable_manifest()->set_scene_uri("other.gltf"); }},
      {"uri", [](auto& r) { r.mutable_manifest()->mutable_assets(0)->set_uri("../scene.gltf"); }},
      {"uri", [](auto& r) { r.mutable_manifest()->mutable_assets(0)->set_uri("/etc/passwd"); }},
      {"sha256",
       [](auto& r) { r.mutable_manifest()->mutable_assets(0)->mutable_asset()->set_sha256("x"); }},
      {"environment_uri", [](auto& r) { r.mutable_settings()->set_environment_uri("sky.exr"); }},
      {"references",
       [](auto& r) {
         for (int i = 0; i < 2; ++i) *r.add_references() = id_of(black_reference);
       }},
      {"references.size_bytes", [](auto& r) { *r.add_references() = id_of("short"); }},
      {"scene_warnings", [](auto& r) { r.add_scene_warnings(""); }},
      {"scene_warnings",
       [](auto& r) {
         for (int i = 0; i < 102; ++i) r.add_scene_warnings("w");
       }},
      {"references.sha256", [](auto& r) { r.add_references()->set_size_bytes(48 * 40 * 16); }}};
  for (const auto& [field, edit] : cases) {
    v1::CreateJobRequest request = request_of("a");
    edit(request);
    v1::CreateJobResponse response;
    const grpc::Status status = create(request, response);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << field;
    EXPECT_NE(status.error_message().find(field), std::string::npos) << status.error_message();
  }
}

TEST_F(FarmTest, JobWithMissingAssetIsRefused) {
  v1::CreateJobResponse response;
  const grpc::Status status = create(request_of("a"), response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_NE(status.error_message().find("scene.gltf"), std::string::npos);
}

// Workers -----------------------------------------------------------------------------------------

TEST_F(FarmTest, WorkerWithOtherNumericsIsRefused) {
  auto other = worker_of(*server_, "w2");
  other->hello.set_numerics_sha256(std::string(32, 'm'));
  EXPECT_FALSE(other->open());
  const grpc::Status status = other->close();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_NE(status.error_message().find("6d6d6d"), std::string::npos) << status.error_message();
  ASSERT_TRUE(worker_of(*server_, "w1")->open()) << "a worker with the contract's numerics";

  auto newer = worker_of(*server_, "w3");
  newer->hello.set_contract_version(99);
  EXPECT_FALSE(newer->open());
  EXPECT_EQ(newer->close().error_code(), grpc::StatusCode::FAILED_PRECONDITION);
}

TEST_F(FarmTest, NewWorkStreamClosesOldOne) {
  auto old = worker_of(*server_, "w1");
  ASSERT_TRUE(old->open());
  auto fresh = worker_of(*server_, "w1");
  ASSERT_TRUE(fresh->open());
  TestWorker::Unit none;
  EXPECT_FALSE(old->next(none));  // ended by the server; closing first would give CANCELLED
  EXPECT_EQ(old->close().error_code(), grpc::StatusCode::ABORTED);
}

TEST_F(FarmTest, MalformedHelloErrorNamesField) {
  using Edit = std::function<void(v1::WorkerHello&)>;
  const std::pair<const char*, Edit> cases[] = {
      {"worker_id", [](auto& h) { h.set_worker_id("no spaces allowed"); }},
      {"name", [](auto& h) { h.set_name("line\nbreak"); }},
      {"host", [](auto& h) { h.set_host("\x1b]0;title\x07"); }},
      {"isa", [](auto& h) { h.set_isa(std::string("avx2\0", 5)); }},
      {"tags", [](auto& h) { h.add_tags(std::string(65, 't')); }},
      {"tags", [](auto& h) { h.add_tags(""); }},
      {"tags", [](auto& h) { h.add_tags("gpu\n"); }},
      {"store_id", [](auto& h) { h.set_store_id(std::string(65, 's')); }}};
  for (const auto& [field, edit] : cases) {
    auto worker = worker_of(*server_, "w1");
    edit(worker->hello);
    EXPECT_FALSE(worker->open()) << field;
    const grpc::Status status = worker->close();
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << field;
    EXPECT_NE(status.error_message().find(field), std::string::npos) << status.error_message();
  }
}

TEST_F(FarmTest, BlocksMayBeSplitOrBatched) {
  create_job("a");
  auto worker = worker_of(*server_, "w1");
  ASSERT_TRUE(worker->open());
  TestWorker::Unit units[3];
  for (auto& unit : units) ASSERT_TRUE(worker->next(unit));
  ASSERT_TRUE(worker->send(worker->messages_of(units[0], worker->block_of(units[0]), 999)));
  v1::DeliverRequest both = worker->messages_of(units[1], worker->block_of(units[1]))[0];
  *both.add_parts() = worker->messages_of(units[2], worker->block_of(units[2]))[0].parts(0);
  ASSERT_TRUE(worker->send({both}));
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(worker->next_acknowledgement().status(), v1::Acknowledgement::ACK_STATUS_COMMITTED);
  }
}

TEST_F(FarmTest, CompressedBlocksAreCommitted) {
  create_job("a");
  auto worker = worker_of(*server_, "w1");
  ASSERT_TRUE(worker->open());
  TestWorker::Unit unit;
  ASSERT_TRUE(worker->next(unit));
  const std::string block = worker->block_of(unit);
  std::string planes(block.size(), '\0');
  for (std::size_t i = 0; i < block.size(); ++i) {
    planes[i % 4 * (block.size() / 4) + i / 4] = block[i];
  }
  std::string wire(ZSTD_compressBound(planes.size()), '\0');
  wire.resize(ZSTD_compress(wire.data(), wire.size(), planes.data(), planes.size(), 1));
  v1::DeliverRequest message = worker->messages_of(unit, block)[0];
  v1::BlockPart& part = *message.mutable_parts(0);
  part.set_chunk(wire);
  part.mutable_header()->set_wire_size_bytes(static_cast<std::int64_t>(wire.size()));
  part.mutable_header()->set_compression(v1::BlockHeader::COMPRESSION_ZSTD_PLANES);
  ASSERT_TRUE(worker->send({message}));
  EXPECT_EQ(worker->next_acknowledgement().status(), v1::Acknowledgement::ACK_STATUS_COMMITTED);

  ASSERT_TRUE(worker->next(unit));
  v1::DeliverRequest bomb = worker->messages_of(unit, worker->block_of(unit))[0];
  bomb.mutable_parts(0)->set_chunk("this is no zstd frame");
  bomb.mutable_parts(0)->mutable_header()->set_wire_size_bytes(21);
  bomb.mutable_parts(0)->mutable_header()->set_compression(
      v1::BlockHeader::COMPRESSION_ZSTD_PLANES);
  ASSERT_TRUE(worker->send({bomb}));
  EXPECT_EQ(worker->next_acknowledgement().status(), v1::Acknowledgement::ACK_STATUS_REJECTED);
}

TEST_F(FarmTest, InvalidDeliveryEndsStream) {
  create_job("a");
  using Edit = std::function<void(v1::DeliverRequest&)>;
  const std::pair<const char*, Edit> cases[] = {
      {"bytes without a header", [](auto& m) { m.mutable_parts(0)->clear_header(); }},
      {"an empty chunk", [](auto& m) { m.mutable_parts(0)->clear_chunk(); }},
      {"a chunk too long",
       [](auto& m) { m.mutable_parts(0)->set_chunk(std::string((64 << 10) + 1, 'x')); }},
      {"more bytes than announced",
       [](auto& m) { m.mutable_parts(0)->mutable_chunk()->append("x"); }},
      {"a huge size",
       [](auto& m) {
         m.mutable_parts(0)->mutable_header()->set_size_bytes(std::int64_t{1} << 62);
         m.mutable_parts(0)->mutable_header()->set_wire_size_bytes(std::int64_t{1} << 62);
       }},
      {"a negative size",
       [](auto& m) {
         m.mutable_parts(0)->mutable_header()->set_size_bytes(-1);
         m.mutable_parts(0)->mutable_header()->set_wire_size_bytes(-1);
       }},
      {"a time that is no number",
       [](auto& m) { m.mutable_parts(0)->mutable_header()->set_cpu_seconds(std::nan("")); }},
      {"header: count", [](auto& m) { m.mutable_parts(0)->mutable_header()->set_ray_count(-1); }},
      {"a digest cut short",
       [](auto& m) { m.mutable_parts(0)->mutable_header()->set_sha256("short"); }}};
  int number = 0;
  for (const auto& [what, edit] : cases) {
    auto worker = worker_of(*server_, "w" + std::to_string(++number));
    worker->hello.set_credit_count(1);
    ASSERT_TRUE(worker->open());
    TestWorker::Unit unit;
    ASSERT_TRUE(worker->next(unit)) << what;
    v1::DeliverRequest message = worker->messages_of(unit, worker->block_of(unit))[0];
    edit(message);
    worker->send({message});
    EXPECT_EQ(worker->finish_deliver().error_code(), grpc::StatusCode::INVALID_ARGUMENT) << what;
  }
}

TEST_F(FarmTest, DeliverWithoutWorkStreamIsRefused) {
  auto worker = worker_of(*server_, "w1");
  v1::DeliverRequest message;
  message.add_parts()->set_chunk("x");
  worker->send({message});
  EXPECT_EQ(worker->finish_deliver().error_code(), grpc::StatusCode::FAILED_PRECONDITION);
}

TEST_F(FarmTest, ListDeliveriesReturnsPages) {
  const std::string job = create_job("a", 64);
  auto worker = worker_of(*server_, "w1");
  ASSERT_TRUE(worker->open());
  EXPECT_EQ(worker->work(), 9 * 2);
  EXPECT_EQ(watch(job).back().state(), v1::Job::STATE_DONE);
  v1::ListDeliveriesRequest request;
  request.set_job_id(job);
  request.set_page_size(9);
  std::set<std::pair<std::int32_t, std::int32_t>> units;
  const auto list = [&](v1::ListDeliveriesResponse& response) {
    grpc::ClientContext context;
    prepare(context);
    return jobs_->ListDeliveries(&context, request, &response);
  };
  int pages = 0;
  do {
    v1::ListDeliveriesResponse response;
    ASSERT_TRUE(list(response).ok());
    for (const v1::Delivery& delivery : response.deliveries()) {
      units.emplace(delivery.tile(), delivery.pass());
      EXPECT_EQ(delivery.worker_id(), "w1");
      EXPECT_EQ(delivery.outcome(), v1::Delivery::OUTCOME_COMMITTED);
      EXPECT_TRUE(delivery.has_lease_duration());
      EXPECT_EQ(delivery.end_time().seconds(), 1'700'000'000) << "by the test's clock";
    }
    request.set_page_token(response.next_page_token());
    ++pages;
  } while (!request.page_token().empty());
  EXPECT_EQ(units.size(), 18u);
  EXPECT_EQ(pages, 3) << "two full pages and an empty last one";
  v1::ListDeliveriesResponse none;
  request.set_page_token("x");
  EXPECT_EQ(list(none).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  request.clear_page_token();
  request.set_page_size(10'001);
  EXPECT_EQ(list(none).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(FarmTest, FutureEventSequenceIsRefused) {
  create_job("a", 64);
  // Reads the events after a sequence; sets the newest and returns the stream's status.
  const auto read = [this](std::int64_t after, std::int64_t& newest) {
    grpc::ClientContext context;
    prepare(context);
    v1::WatchEventsRequest request;
    request.set_after_sequence(after);
    const auto stream = jobs_->WatchEvents(&context, request);
    v1::WatchEventsResponse response;
    while (stream->Read(&response)) newest = response.events().rbegin()->sequence();
    return stream->Finish();
  };
  std::int64_t newest = 0;
  ASSERT_TRUE(read(0, newest).ok());
  ASSERT_GT(newest, 0);
  EXPECT_TRUE(read(newest, newest).ok());
  EXPECT_EQ(read(newest + 1, newest).error_code(), grpc::StatusCode::OUT_OF_RANGE);
  restart();
  EXPECT_TRUE(read(newest + 1, newest).ok()) << "sequence numbers of another server process";
}

class TokenTest : public TestFarm {
 protected:
  TokenTest() { token_ = "secret"; }
};

TEST_F(TokenTest, EveryCallNeedsToken) {
  for (const char* sent : {"", "wrong", "secret"}) {
    grpc::ClientContext context;
    contract::prepare_call(context, sent, std::chrono::seconds(10));
    v1::ListJobsResponse response;
    const grpc::Status status = jobs_->ListJobs(&context, {}, &response);
    EXPECT_EQ(status.ok(), std::string(sent) == "secret") << sent;
    if (!status.ok()) {
      EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAUTHENTICATED);
    }
  }
  EXPECT_EQ(upload(id_of("x"), "x").error_code(), grpc::StatusCode::UNAUTHENTICATED);
  auto worker = worker_of(*server_, "w1");
  EXPECT_FALSE(worker->open());
  EXPECT_EQ(worker->close().error_code(), grpc::StatusCode::UNAUTHENTICATED);
}

}  // namespace
}  // namespace tessera::server
