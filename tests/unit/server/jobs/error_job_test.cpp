#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <utility>

#include "server/report/report.h"
#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

/// A job with a target error whose tiles have increasing noise.
class ErrorJobTest : public CoordinatorFixture {
 protected:
  ErrorJobTest() { noise = 0.3; }
  std::string create_error_job(const std::string& name, double error, std::int32_t max_spp = 4096,
                               std::int32_t last_frame = 0) {
    JobSpec spec = spec_of(name, max_spp);
    spec.settings.error = error;
    spec.settings.width = 40;  // 3 x 2 tiles; enough pixels for a bound
    spec.settings.height = 24;
    spec.settings.tile = 16;
    spec.settings.frames = {{0, last_frame, 1}};
    const auto created = create(spec);
    EXPECT_TRUE(created.ok()) << created.status();
    return created.ok() ? created->view.spec->id : "";
  }
  nlohmann::json report_of(const std::string& job_id) {
    return nlohmann::json::parse(report_json(coordinator->queries().report(job_id).value()));
  }
};

TEST_F(ErrorJobTest, EndsWhenBoundIsMet) {
  const std::string job = create_error_job("a", 0.1);
  auto worker = join("w1");
  finish_job(worker, job);
  const JobView ended = view(job);
  ASSERT_EQ(ended.state, JobState::done);
  EXPECT_EQ(ended.certainty, Certainty::converged);
  EXPECT_EQ(ended.unit_count, ended.committed_unit_count);
  EXPECT_EQ(ended.sample_count, ended.committed_sample_count);
  const nlohmann::json report = report_of(job), frame = report["frames"][0];
  EXPECT_EQ(report["status"], "CONVERGED");
  EXPECT_EQ(frame["status"], "CONVERGED");
  EXPECT_LE(frame["estimated"]["error_upper95"], 0.1);
  EXPECT_EQ(frame["samples"], ended.committed_sample_count);
  EXPECT_LT(frame["spp_mean"], frame["spp_max"]) << "tiles with less noise have fewer samples";
  EXPECT_EQ(frame["curve"].back()["samples"], ended.committed_sample_count);
}

TEST_F(ErrorJobTest, EstimateOfDoneJobSurvivesRestart) {
  const std::string job = create_error_job("a", 0.1);
  auto worker = join("w1");
  finish_job(worker, job);
  const std::optional<double> estimate = view(job).estimated_error;
  ASSERT_TRUE(estimate);
  start();
  EXPECT_EQ(view(job).estimated_error, estimate);
}

TEST_F(ErrorJobTest, SampleLimitWithoutBoundIsCapped) {
  const std::string job = create_error_job("a", 0.001, 512);
  auto worker = join("w1");
  finish_job(worker, job);
  EXPECT_EQ(view(job).certainty, Certainty::capped);
  const nlohmann::json report = report_of(job);
  EXPECT_EQ(report["status"], "CAPPED");
  EXPECT_NE(report["reasons"][0].get<std::string>().find("--max-spp"), std::string::npos);
}

TEST_F(ErrorJobTest, RestartsAndOrderKeepPixels) {
  const std::string calm = create_error_job("calm", 0.1, 4096, 1);
  auto worker = join("w1");
  finish_job(worker, calm);
  const nlohmann::json expected = report_of(calm)["frames"];

  const std::string job = create_error_job("stormy", 0.1, 4096, 1);
  std::mt19937 rng(5);
  for (int round = 0; round < 400 && !has_ended(view(job).state); ++round) {
    if (round % 7 == 6) {
      start();
      worker = join("w1");
    }
    collect(worker);
    std::shuffle(worker.units.begin(), worker.units.end(), rng);
    for (int i = 0; i < 5 && !worker.units.empty(); ++i) {
      const Leased unit = worker.units.back();
      worker.units.pop_back();
      deliver(worker, unit, bytes_of(unit));
      coordinator->workers().grant_credits(worker.session, 1);
    }
    now += std::chrono::seconds(1);
    coordinator->tick();
    pump();
  }
  ASSERT_EQ(view(job).state, JobState::done);
  const nlohmann::json frames = report_of(job)["frames"];
  ASSERT_EQ(frames.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    for (const char* key : {"pixels_sha256", "samples", "status", "estimated"}) {
      EXPECT_EQ(frames[i][key], expected[i][key]) << key << " of frame " << i;
    }
  }
  EXPECT_EQ(view(job).unit_count, view(job).committed_unit_count);
}

TEST_F(ErrorJobTest, LoweringErrorLaterKeepsPixels) {
  const std::string strict = create_error_job("strict", 0.05);
  auto worker = join("w1");
  finish_job(worker, strict);

  const std::string job = create_error_job("lax", 0.2);
  for (int round = 0; round < 3; ++round) {  // not to the end, which deletes the blocks
    collect(worker);
    for (int i = 0; i < 4 && !worker.units.empty(); ++i) {
      deliver(worker, worker.units.back(), bytes_of(worker.units.back()));
      worker.units.pop_back();
    }
    pump();
  }
  absl::StatusOr<JobView> extended = absl::UnknownError("");
  coordinator->jobs().extend_job(job, {{}, 0.05}, [&](const auto& view) { extended = view; });
  pump();
  ASSERT_TRUE(extended.ok()) << extended.status();
  EXPECT_GT(extended->committed_unit_count, 0);
  coordinator->jobs().extend_job(job, {{}, 0.1}, [&](const auto& view) { extended = view; });
  pump();
  EXPECT_TRUE(absl::IsInvalidArgument(extended.status())) << "more error than at present";
  bool was_asked = false;  // same error: `done` is called without a lock
  coordinator->jobs().extend_job(job, {{}, 0.05}, [&](const auto& /*view*/) {
    was_asked = coordinator->queries().job(job).ok();
  });
  pump();
  EXPECT_TRUE(was_asked);
  coordinator->workers().disconnect(worker.session);
  auto again = join("w1");
  finish_job(again, job);
  ASSERT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(pixels_of(job), pixels_of(strict));
}

TEST_F(ErrorJobTest, DamagedBlockIsRenderedAgain) {
  const std::string calm = create_error_job("calm", 0.1);
  auto worker = join("w1");
  finish_job(worker, calm);

  const std::string job = create_error_job("hurt", 0.1);
  for (int round = 0; round < 2; ++round) {
    collect(worker);
    for (const Leased& unit : std::exchange(worker.units, {})) {
      deliver(worker, unit, bytes_of(unit));
      coordinator->workers().grant_credits(worker.session, 1);
    }
    pump();
  }
  store.units().damage({0, 4, 1});
  start();  // reads the blocks again to decide
  pump();
  auto again = join("w1");
  finish_job(again, job);
  ASSERT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(report_of(job)["units"]["redone"], 1);
  EXPECT_EQ(pixels_of(job), pixels_of(calm));
}

TEST_F(ErrorJobTest, BlackFrameIsUncertain) {
  const std::string job = create_error_job("black", 0.1);
  auto worker = join("w1");
  for (int round = 0; round < 20 && !has_ended(view(job).state); ++round) {
    collect(worker);
    for (const Leased& unit : std::exchange(worker.units, {})) {
      deliver(worker, unit, contract::encode(contract::FilmBlock::zeros(shape_of(unit))));
      coordinator->workers().grant_credits(worker.session, 1);
    }
    pump();
  }
  EXPECT_EQ(view(job).certainty, Certainty::uncertain);
  EXPECT_NE(report_of(job)["reasons"][0].get<std::string>().find("black"), std::string::npos);
}

}  // namespace
}  // namespace tessera::server
