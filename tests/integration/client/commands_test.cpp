#include "client/commands/commands.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstddef>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "client/api/farm_client.h"
#include "client/commands/completion.h"
#include "client/manual/pages.h"
#include "rpc/settings_message.h"
#include "tests/integration/client/fake_farm.h"
#include "tests/integration/client/made_image.h"
#include "tests/support/json_schema.h"
#include "tests/support/scratch_folder.h"

namespace tessera::client {
namespace {

using nlohmann::json;
using support::document_faults;
using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

std::string read_file(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

class CommandsTest : public ::testing::Test {
 protected:
  Outcome run(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin() + 1, {"--server", farm_.address()});
    return run_client(arguments);
  }
  /// A report with one finished frame, as a server makes it.
  static std::string report() {
    return R"({"schema":"tessera.report/1","version":"1.0.0","job":"abc","name":"scene","contract":1,
      "status":"DONE","reasons":[],"warnings":["frame 1: 2 samples were not finite"],
      "scene_sha256":")" +
           std::string(64, 'a') + R"(","settings":{},"frames":[{"frame":1,"file":"1.exr",
      "width":64,"height":32,"pixels_sha256":")" +
           std::string(64, 'b') + R"(","spp_mean":64,"spp_max":64,"samples":131072,"status":"DONE",
      "mean_luminance":0.5,"estimated":{"rmse":0.01,"relmse":0.002,"error":0.0425,
      "error_upper95":0.045},"true":null,"heavy_tail_share":0.1,"unseen_event_bound":0.001,
      "dropped_samples":2,"clamped_energy":0,"truncated_energy":0,
      "curve":[{"cpu_seconds":1.5,"wall_seconds":1,"samples":16384,"relmse":0.02,"error":0.125,
                "error_true":null},
               {"cpu_seconds":12.5,"wall_seconds":7,"samples":131072,"relmse":0.002,
                "error":0.0425,"error_true":null}]}],
      "cpu_seconds":12.5,"cpu_seconds_wasted":0.5,"wall_seconds":65,"load_seconds":0.1,
      "build_seconds":0.2,"render_seconds":12.5,"overhead_fraction":0.06,"peak_rss_bytes":104857600,
      "units":{"total":200,"retried":1,"duplicated":0,"audited":0,"mismatched":0},
      "workers":[{"id":"w1","isa":"avx2","threads":2,"units":200,"cpu_seconds":12.5}]})";
  }

  FakeFarm farm_;
};

TEST_F(CommandsTest, ListPrintsNewestJobFirst) {
  farm_.add_job("aaa111", "first", v1::Job::STATE_DONE);
  farm_.add_job("bbb222", "second", v1::Job::STATE_RUNNING);
  const Outcome text = run({"list"});
  EXPECT_EQ(text.exit, kExitDone);
  EXPECT_LT(text.out.find("bbb222"), text.out.find("aaa111"));
  EXPECT_THAT(text.out, HasSubstr("25.0 %"));
  const Outcome document = run({"list", "--json"});
  EXPECT_THAT(document_faults(document.out), IsEmpty()) << document.out;
  EXPECT_EQ(json::parse(document.out)["jobs"][0]["id"], "bbb222");
}

TEST_F(CommandsTest, ListSaysWhyJobsWait) {
  farm_.add_job("aaa111", "lamp", v1::Job::STATE_PAUSED)
      .set_reason("frame 0 failed 3 times\nworker w1: broke");
  farm_.add_job("bbb222", "room", v1::Job::STATE_QUEUED).set_reason("no workers connected");
  farm_.add_job("ccc333", "hall", v1::Job::STATE_FAILED).set_reason(std::string(200, 'x') + "yz");
  farm_.add_job("ddd444", "door", v1::Job::STATE_DONE);
  const std::string text = run({"list"}).out;
  EXPECT_THAT(text, HasSubstr("NAME  REASON\n"));
  EXPECT_THAT(text, HasSubstr("door  -\n"));
  EXPECT_THAT(text, HasSubstr("room  no workers connected\n"));
  EXPECT_THAT(text, HasSubstr("lamp  frame 0 failed 3 times…\n")) << "one line";
  EXPECT_THAT(text, HasSubstr("hall  " + std::string(100, 'x') + "…\n"));
}

TEST_F(CommandsTest, ListLeavesOutColumnsWithoutContent) {
  farm_.add_job("aaa111", "lamp", v1::Job::STATE_QUEUED).set_pool("default");
  EXPECT_THAT(run({"list"}).out, HasSubstr("CPU S  AGE"));
  EXPECT_THAT(run({"list"}).out, Not(HasSubstr("OWNER")));
  v1::Job& room = farm_.add_job("bbb222", "room", v1::Job::STATE_QUEUED);
  room.set_pool("night");
  room.set_owner("ann");
  room.set_project("film");
  room.set_priority(7);
  const std::string text = run({"list"}).out;
  EXPECT_THAT(text, ContainsRegex("PRIORITY +OWNER +PROJECT +POOL +NAME +REASON\n"));
  EXPECT_THAT(text, ContainsRegex("7 +ann +film +night +room +-\n"));
  EXPECT_THAT(text, ContainsRegex("0 +local +- +default +lamp +-\n"));
}

TEST_F(CommandsTest, ListReadsPagesUpToLimit) {
  for (int i = 0; i < 250; ++i) {
    farm_.add_job("job" + std::to_string(i), "name", v1::Job::STATE_DONE);
  }
  const auto count = [this](const std::string& limit) {
    return json::parse(run({"list", "--json", "--limit", limit}).out)["jobs"].size();
  };
  EXPECT_EQ(count("0"), 250u);
  EXPECT_EQ(count("7"), 7u);
  EXPECT_EQ(count("120"), 120u);
  EXPECT_EQ(run({"list", "--limit", "-1"}).exit, kExitBadInput);
}

TEST_F(CommandsTest, StatusPrintsOneJob) {
  farm_.add_job("aaa111", "lamp", v1::Job::STATE_PAUSED).set_reason("paused by the user");
  const Outcome text = run({"status", "lamp"});
  EXPECT_EQ(text.exit, kExitDone);
  EXPECT_THAT(text.out, HasSubstr("paused: paused by the user"));
  EXPECT_THAT(text.out, HasSubstr("0.04250 (estimated)"));
  const Outcome document = run({"status", "last", "--json"});
  EXPECT_THAT(document_faults(document.out), IsEmpty()) << document.out;
}

TEST_F(CommandsTest, StatusOfJobPausedByFailures) {
  v1::Job& job = farm_.add_job("aaa111", "lamp", v1::Job::STATE_PAUSED);
  job.set_reason("job aaa111, frame 0, tile 5, pass 0 failed 3 times\nworker w1: broke");
  job.set_pause_cause(v1::Job::PAUSE_CAUSE_FAILURES);
  job.set_failure_code(static_cast<int>(absl::StatusCode::kInternal));
  job.set_project("film");
  job.add_blocked_worker_ids("w9");
  v1::FailedAttempt& attempt = *job.add_failed_attempts();
  attempt.set_tile(5);
  attempt.set_worker_id("w1");
  attempt.set_message("broke");
  const Outcome text = run({"status", "lamp"});
  EXPECT_THAT(text.out, HasSubstr("paused: units kept failing"));
  EXPECT_THAT(text.out, HasSubstr("frame 0, tile 5, pass 0, worker w1: broke"));
  EXPECT_THAT(text.out, HasSubstr("tessera retry aaa111"));
  EXPECT_THAT(text.out, HasSubstr("w9"));
  const Outcome document = run({"status", "lamp", "--json"});
  EXPECT_THAT(document_faults(document.out), IsEmpty()) << document.out;
  EXPECT_EQ(json::parse(document.out)["paused_by"], "failures");
}

TEST_F(CommandsTest, UnknownJobExitsWithBadInput) {
  for (const char* command :
       {"status", "report", "fetch", "pause", "resume", "cancel", "retry", "remove"}) {
    const Outcome outcome = run({command, "nothing"});
    EXPECT_EQ(outcome.exit, kExitBadInput) << command;
    EXPECT_THAT(outcome.err, HasSubstr("no job \"nothing\"")) << command;
    EXPECT_THAT(outcome.out, IsEmpty()) << command;
  }
}

TEST_F(CommandsTest, MissingServerExitsWithUnreachable) {
  const Outcome outcome =
      run_client({"list", "--server", "unix:" + (farm_.folder() / "none").string()});
  EXPECT_EQ(outcome.exit, kExitUnreachable);
  EXPECT_THAT(outcome.err, HasSubstr("none"));
}

TEST_F(CommandsTest, OlderServerIsNamed) {
  const Outcome outcome = run({"workers", "drain", "w1"});  // FakeFarm lacks DrainWorker
  EXPECT_EQ(outcome.exit, kExitBadInput);
  EXPECT_THAT(outcome.err, HasSubstr("does not offer this call: it is older than this client; "
                                     "upgrade the server"));
}

TEST_F(CommandsTest, WrongUsageExitsWithBadInput) {
  EXPECT_EQ(run({"status"}).exit, kExitBadInput) << "no job";
  EXPECT_EQ(run({"list", "--colour"}).exit, kExitBadInput);
  EXPECT_EQ(run({"extend", "last", "--spp", "0"}).exit, kExitBadInput);
  EXPECT_EQ(run_client({"paint"}).exit, kExitBadInput);
  EXPECT_EQ(run({"report", "last", "--json", "--csv"}).exit, kExitBadInput);
}

TEST_F(CommandsTest, UnknownAcceleratorListsKnownOnes) {
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
           {"inspect", "none.gltf"}, {"bench", "none.gltf", "--reference", "none"}}) {
    std::vector<std::string> words = command;
    words.insert(words.end(), {"--accelerator", "foo"});
    const Outcome outcome = run_client(words);
    EXPECT_EQ(outcome.exit, kExitBadInput);
    EXPECT_THAT(outcome.err, HasSubstr("--accelerator: foo not in {brute-force,bvh2,"));
    EXPECT_THAT(outcome.err, Not(HasSubstr("tessera-worker"))) << "no child was started";
  }
}

TEST_F(CommandsTest, ControlsChangeAndPrintJobState) {
  farm_.add_job("aaa111", "lamp", v1::Job::STATE_RUNNING);
  const std::pair<const char*, v1::Job::State> steps[] = {{"pause", v1::Job::STATE_PAUSED},
                                                          {"resume", v1::Job::STATE_RUNNING},
                                                          {"cancel", v1::Job::STATE_CANCELLED},
                                                          {"retry", v1::Job::STATE_QUEUED}};
  for (const auto& [command, state] : steps) {
    const Outcome document = run({command, "lamp", "--json"});
    EXPECT_EQ(document.exit, kExitDone) << command << document.err;
    EXPECT_THAT(document_faults(document.out), IsEmpty()) << command;
    EXPECT_EQ(farm_.jobs[0].state(), state) << command;
  }
  EXPECT_EQ(run({"pause", "lamp"}).out, "aaa111 paused\n");
}

TEST_F(CommandsTest, ServerRefusalIsPrintedAndReturned) {
  farm_.add_job("aaa111", "lamp", v1::Job::STATE_RUNNING);
  const Outcome outcome = run({"remove", "lamp"});
  EXPECT_EQ(outcome.exit, kExitBadInput);
  EXPECT_THAT(outcome.err, HasSubstr("cancel it first"));
  EXPECT_EQ(farm_.jobs.size(), 1u);
}

TEST_F(CommandsTest, RemoveDeletesEndedJob) {
  farm_.add_job("aaa111", "lamp", v1::Job::STATE_DONE);
  const Outcome document = run({"remove", "lamp", "--json"});
  EXPECT_EQ(document.exit, kExitDone);
  EXPECT_THAT(document_faults(document.out), IsEmpty());
  EXPECT_TRUE(farm_.jobs.empty());
}

TEST_F(CommandsTest, ExtendRaisesSampleCount) {
  farm_.add_job("aaa111", "lamp", v1::Job::STATE_RUNNING);
  const Outcome outcome = run({"extend", "lamp", "--spp", "256"});
  EXPECT_EQ(outcome.exit, kExitDone);
  EXPECT_THAT(outcome.out, HasSubstr("256 samples per pixel"));
  EXPECT_EQ(farm_.jobs[0].settings().sample_count(), 256);
  EXPECT_EQ(run({"extend", "lamp", "--spp", "8"}).exit, kExitBadInput);
}

TEST_F(CommandsTest, ReportPrintsTextJsonAndCurve) {
  farm_.add_job("abc", "scene", v1::Job::STATE_DONE);
  farm_.reports["abc"] = report();
  const Outcome text = run({"report", "last"});
  EXPECT_EQ(text.exit, kExitDone);
  EXPECT_THAT(text.out, HasSubstr("0.0425"));
  EXPECT_THAT(text.out, HasSubstr("2 samples were not finite"));
  EXPECT_THAT(text.out, HasSubstr("100.0 MiB"));
  const Outcome document = run({"report", "last", "--json"});
  EXPECT_THAT(document_faults(document.out), IsEmpty());
  EXPECT_EQ(json::parse(document.out), json::parse(report()));
  EXPECT_EQ(run({"report", "last", "--csv"}).out,
            "frame,cpu_seconds,wall_seconds,samples,relmse,error,error_true\n"
            "1,1.5,1,16384,0.02,0.125,\n"
            "1,12.5,7,131072,0.002,0.042500000000000003,\n");
}

TEST_F(CommandsTest, ReportBeyondMessageLimitIsPrinted) {
  farm_.add_job("abc", "scene", v1::Job::STATE_DONE);
  json large = json::parse(report());
  large["warnings"].push_back(std::string(std::size_t{5} << 20, 'w'));
  farm_.reports["abc"] = large.dump();
  const Outcome outcome = run({"report", "abc", "--json"});
  EXPECT_EQ(outcome.exit, kExitDone) << outcome.err;
  EXPECT_EQ(json::parse(outcome.out), large);
}

TEST_F(CommandsTest, ReportWritesRequestedFiles) {
  farm_.add_job("abc", "scene", v1::Job::STATE_DONE);
  json known = json::parse(report());
  known["frames"][0]["tiles"] = {{"error", {0.5}}, {"spp", {8}}};
  farm_.reports["abc"] = known.dump();
  const std::string curve = farm_.folder() / "curve.svg", tiles = farm_.folder() / "tiles.svg";
  const std::pair<std::vector<std::string>, std::string> cases[] = {
      {{}, ""},
      {{"--json"}, run({"report", "abc", "--json"}).out},
      {{"--csv"}, run({"report", "abc", "--csv"}).out}};
  for (const auto& [prints, text] : cases) {
    std::vector<std::string> words = {"report", "abc", "--svg", curve, "--tiles", tiles};
    words.insert(words.end(), prints.begin(), prints.end());
    const Outcome outcome = run(words);
    EXPECT_EQ(outcome.exit, kExitDone) << outcome.err;
    EXPECT_EQ(outcome.out, text);
    EXPECT_THAT(read_file(curve), HasSubstr("estimated error"));
    EXPECT_THAT(read_file(tiles), HasSubstr("<title>tile 0: 0.5</title>"));
    std::filesystem::remove(curve);
    std::filesystem::remove(tiles);
  }
  // A chart that cannot be drawn is reported, and the others are written.
  farm_.reports["abc"] = report();
  const Outcome outcome = run({"report", "abc", "--tiles", tiles, "--svg", curve, "--json"});
  EXPECT_EQ(outcome.exit, kExitBadInput);
  EXPECT_THAT(outcome.err, HasSubstr("no frame has tile statistics"));
  EXPECT_EQ(json::parse(outcome.out), json::parse(report()));
  EXPECT_TRUE(std::filesystem::exists(curve));
}

TEST_F(CommandsTest, ReportAcceptsFullOrCropReference) {
  const std::string folder = farm_.folder();
  std::vector<float> frame(std::size_t{4} * 64 * 48, 9.0f);
  for (std::size_t y = 10; y < 40; ++y) {
    for (std::size_t i = 4 * (64 * y + 16); i < 4 * (64 * y + 48); ++i) {
      frame[i] = static_cast<float>(i % 7);
    }
  }
  std::vector<float> part;
  for (std::size_t y = 10; y < 40; ++y) {
    const auto row = frame.begin() + static_cast<std::ptrdiff_t>(4 * (64 * y + 16));
    part.insert(part.end(), row, row + 4 * 32);
  }
  write_image(folder + "/frame.exr", 64, 48, 4, frame);
  write_image(folder + "/part.exr", 32, 30, 4, part);
  write_image(folder + "/other.exr", 32, 29, 4, part);
  part[7] = std::numeric_limits<float>::infinity();
  write_image(folder + "/infinite.exr", 32, 30, 4, part);
  farm_.add_job("abc", "scene", v1::Job::STATE_DONE);
  farm_.frames["abc"][1].bytes = read_file(folder + "/part.exr");
  json known = json::parse(report());
  known["settings"] = {{"width", 64}, {"height", 48}, {"crop", {16, 10, 32, 30}}};
  farm_.reports["abc"] = known.dump();
  for (const char* reference : {"/frame.exr", "/part.exr"}) {
    const Outcome outcome = run({"report", "abc", "--json", "--reference", folder + reference});
    EXPECT_EQ(outcome.exit, kExitDone) << outcome.err;
    EXPECT_EQ(json::parse(outcome.out)["frames"][0]["true"]["rmse"], 0.0) << reference;
  }
  const Outcome other = run({"report", "abc", "--reference", folder + "/other.exr"});
  EXPECT_EQ(other.exit, kExitBadInput);
  EXPECT_THAT(other.err,
              HasSubstr("other.exr: the reference is 32x29; expected 64x48 or, cropped, 32x30"));
  const Outcome infinite = run({"report", "abc", "--reference", folder + "/infinite.exr"});
  EXPECT_THAT(infinite.err,
              HasSubstr("infinite.exr: the reference has values that are not finite"));
}

TEST_F(CommandsTest, MalformedReportIsAnError) {
  farm_.add_job("abc", "scene", v1::Job::STATE_DONE);
  farm_.reports["abc"] = "<html>";
  EXPECT_EQ(run({"report", "last"}).exit, kExitUnreachable);
}

TEST_F(CommandsTest, ReportSchemaDetectsMissingKeys) {
  json broken = json::parse(report());
  broken["frames"][0].erase("heavy_tail_share");
  broken["status"] = "FINE";
  EXPECT_EQ(document_faults(broken.dump()).size(), 2u);
}

class FetchTest : public CommandsTest {
 protected:
  FetchTest() {
    v1::Job& job = farm_.add_job("abc", "my scene/1", v1::Job::STATE_RUNNING);
    contract::RenderSettings settings;
    settings.frames = {{1, 3, 1}};
    *job.mutable_settings() = contract::to_message(settings);
    for (int frame = 1; frame <= 3; ++frame) {
      farm_.frames["abc"][frame] = {
          std::string(2500, static_cast<char>('0' + frame)), true, {}, false};
    }
    farm_.reports["abc"] = report();
    output_ = farm_.folder() / "out";
  }
  Outcome fetch(std::vector<std::string> more = {}) const {
    more.insert(more.begin(), {"fetch", "abc", "-o", output_.string()});
    return run(more);
  }

  std::filesystem::path output_;
};

TEST_F(FetchTest, WritesNumberedFramesAndTheReport) {
  const Outcome outcome = fetch({"--json"});
  EXPECT_EQ(outcome.exit, kExitDone) << outcome.err;
  EXPECT_THAT(document_faults(outcome.out), IsEmpty()) << outcome.out;
  EXPECT_EQ(read_file(output_ / "my_scene_1.0002.exr"), std::string(2500, '2'));
  EXPECT_EQ(json::parse(read_file(output_ / "my_scene_1.report.json")), json::parse(report()));
  const auto files = std::distance(std::filesystem::directory_iterator(output_), {});
  EXPECT_EQ(files, 4) << "three frames, the report, no .part";
}

TEST_F(FetchTest, KeepsFilesWithMatchingContent) {
  ASSERT_EQ(fetch().exit, kExitDone);
  const auto before = std::filesystem::last_write_time(output_ / "my_scene_1.0001.exr");
  const Outcome again = fetch({"--json"});
  EXPECT_EQ(again.exit, kExitDone);
  EXPECT_EQ(json::parse(again.out)["frames"][0]["state"], "present");
  EXPECT_EQ(std::filesystem::last_write_time(output_ / "my_scene_1.0001.exr"), before);
}

TEST_F(FetchTest, OverwritesOtherFilesOnlyWithForce) {
  ASSERT_EQ(fetch().exit, kExitDone);
  std::ofstream(output_ / "my_scene_1.0001.exr") << "own line";
  const Outcome refused = fetch();
  EXPECT_EQ(refused.exit, kExitBadInput);
  EXPECT_THAT(refused.err, HasSubstr("--force"));
  EXPECT_EQ(read_file(output_ / "my_scene_1.0001.exr"), "own line");
  EXPECT_EQ(fetch({"--force"}).exit, kExitDone);
  EXPECT_EQ(read_file(output_ / "my_scene_1.0001.exr"), std::string(2500, '1'));
}

TEST_F(FetchTest, RunningJobYieldsFinishedFramesOnly) {
  farm_.frames["abc"][3].finished = false;
  const Outcome outcome = fetch({"--json"});
  EXPECT_EQ(outcome.exit, kExitDone);
  EXPECT_THAT(outcome.err, HasSubstr("frame 3"));
  EXPECT_EQ(json::parse(outcome.out)["frames"][2]["state"], "unfinished");
  EXPECT_FALSE(std::filesystem::exists(output_ / "my_scene_1.0003.exr"));
}

TEST_F(FetchTest, PartialListsMissingTiles) {
  v1::PixelRect hole;
  hole.set_x_px(64);
  hole.set_width_px(64);
  hole.set_height_px(32);
  farm_.frames["abc"][3].finished = false;
  farm_.frames["abc"][3].missing_tiles = {hole, hole};
  const Outcome outcome = fetch({"--partial", "--json"});
  EXPECT_EQ(outcome.exit, kExitDone);
  EXPECT_THAT(document_faults(outcome.out), IsEmpty()) << outcome.out;
  const json tile = {{"x", 64}, {"y", 0}, {"width", 64}, {"height", 32}};
  EXPECT_EQ(json::parse(outcome.out)["frames"][2]["missing_tiles"], json::array({tile, tile}));
  EXPECT_TRUE(std::filesystem::exists(output_ / "my_scene_1.0003.exr"));
}

TEST_F(FetchTest, NoFinishedFrameIsAnError) {
  for (auto& [number, frame] : farm_.frames["abc"]) frame.finished = false;
  EXPECT_EQ(fetch().exit, kExitBadInput);
}

TEST_F(FetchTest, DigestMismatchLeavesNoFile) {
  farm_.frames["abc"][1].has_wrong_bytes = true;
  const Outcome outcome = fetch();
  EXPECT_NE(outcome.exit, kExitDone);
  EXPECT_THAT(outcome.err, HasSubstr("digest"));
  EXPECT_FALSE(std::filesystem::exists(output_ / "my_scene_1.0001.exr"));
  EXPECT_FALSE(std::filesystem::exists(output_ / "my_scene_1.0001.exr.part"));
}

/// Bytes that have arrived are an answer: the limit for the first one no longer applies.
TEST_F(FetchTest, BrokenDownloadStartsAgain) {
  farm_.frames["abc"][1].break_count = 2;
  Connection connection;
  connection.server = farm_.address();
  connection.connect_timeout = std::chrono::seconds(0);
  const auto client = FarmClient::connect(connection).value();
  v1::FetchFrameRequest request;
  request.set_job_id("abc");
  request.set_frame(1);
  int starts = 0;
  std::string bytes;
  FarmClient::FrameSink sink;
  sink.start = [&](const v1::FrameHeader&) {
    ++starts;
    bytes.clear();
    return absl::OkStatus();
  };
  sink.write = [&](std::string_view chunk) {
    bytes += chunk;
    return absl::OkStatus();
  };
  const absl::Status status = client->fetch_frame(request, sink);
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_EQ(starts, 3);
  EXPECT_EQ(bytes, std::string(2500, '1'));
}

TEST_F(FetchTest, ErrorNamesFolderThatCannotBeCreated) {
  std::ofstream(farm_.folder() / "file") << "x";
  const Outcome outcome = run({"fetch", "abc", "-o", (farm_.folder() / "file" / "out").string()});
  EXPECT_EQ(outcome.exit, kExitBadInput);
  EXPECT_THAT(outcome.err, HasSubstr("file/out"));
}

TEST_F(CommandsTest, WorkersPrintsStateAndTraffic) {
  v1::Worker worker;
  worker.set_id("w1");
  worker.set_name("render-7");
  worker.set_host("node7");
  worker.set_state(v1::Worker::STATE_QUARANTINED);
  worker.set_isa("avx2");
  worker.set_thread_count(16);
  worker.add_tags("big");
  worker.set_rss_bytes(3 << 20);
  farm_.workers = {worker};
  const Outcome text = run({"workers"});
  EXPECT_THAT(text.out, HasSubstr("quarantined"));
  EXPECT_THAT(text.out, HasSubstr("3.0 MiB"));
  const Outcome document = run({"workers", "--json"});
  EXPECT_EQ(document.exit, kExitDone);
  EXPECT_THAT(document_faults(document.out), IsEmpty()) << document.out;
}

/// Every command and option, read from the parser.
std::vector<std::string> names_of(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* command : app.get_subcommands(nullptr)) {
    names.push_back(command->get_name());
    for (const CLI::Option* option : command->get_options()) {
      if (option->get_group().empty()) continue;
      for (const std::string& name : option->get_lnames()) names.push_back(name);
    }
  }
  return names;
}

TEST(Completion, EveryShellHasAllCommandsAndOptions) {
  Invocation invocation;
  CLI::App app("test", "tessera");
  add_all_commands(app, invocation);
  const std::vector<std::string> names = names_of(app);
  EXPECT_GT(names.size(), 50u);
  for (const char* shell : {"bash", "zsh", "fish"}) {
    const Outcome outcome = run_client({"completion", shell});
    EXPECT_EQ(outcome.exit, kExitDone);
    for (const std::string& name : names) {
      EXPECT_THAT(outcome.out, HasSubstr(name)) << shell;
    }
  }
  EXPECT_EQ(run_client({"completion", "tcsh"}).exit, kExitBadInput);
}

TEST(Completion, BashCompletesCommandsAndOptions) {
  const ScratchFolder folder;
  const std::string path = folder.path() + "/completion.bash";
  std::ofstream(path) << run_client({"completion", "bash"}).out
                      << "COMP_WORDS=(tessera rep); COMP_CWORD=1; _tessera\n"
                         "echo \"${COMPREPLY[*]}\"\n"
                         "COMP_WORDS=(tessera fetch last --fo); COMP_CWORD=3; _tessera\n"
                         "echo \"${COMPREPLY[*]}\"\n";
  FILE* pipe = ::popen(("bash " + path + " 2>&1").c_str(), "r");
  ASSERT_NE(pipe, nullptr);
  std::string output(1000, '\0');
  output.resize(std::fread(output.data(), 1, output.size(), pipe));
  EXPECT_EQ(::pclose(pipe), 0);
  EXPECT_EQ(output, "report\n--format --force\n");
}

TEST(Help, EveryCommandHasDescriptionAndExample) {
  Invocation invocation;
  CLI::App app("test", "tessera");
  add_all_commands(app, invocation);
  for (const CLI::App* command : app.get_subcommands(nullptr)) {
    EXPECT_FALSE(command->get_description().empty()) << command->get_name();
    EXPECT_THAT(command->get_footer(), HasSubstr("tessera " + command->get_name()))
        << command->get_name();
    const std::string page = man_page(*command, "tessera " + command->get_name());
    for (const char* part : {".SH NAME", ".SH SYNOPSIS", ".SH OPTIONS", ".SH EXIT STATUS"}) {
      EXPECT_THAT(page, HasSubstr(part)) << command->get_name();
    }
  }
}

}  // namespace
}  // namespace tessera::client
