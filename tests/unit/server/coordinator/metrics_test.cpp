// The exported metrics count what happened.

#include <prometheus/text_serializer.h>

#include <functional>
#include <map>
#include <sstream>
#include <string>
#include <utility>

#include "contract/digest.h"
#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

class MetricsTest : public CoordinatorFixture {
 protected:
  /// Lines of the text, name and labels → value.
  std::map<std::string, double> scrape() {
    std::map<std::string, double> values;
    std::istringstream text(
        prometheus::TextSerializer().Serialize(coordinator->queries().metrics()));
    for (std::string line; std::getline(text, line);) {
      if (line.starts_with("#")) continue;
      const std::size_t space = line.rfind(' ');
      values[line.substr(0, space)] = std::stod(line.substr(space + 1));
    }
    return values;
  }
};

TEST_F(MetricsTest, CancelledJobKeepsNoFilm) {
  TestWorker worker = join("w", 4);
  const std::string job = create_job("a");
  deliver_all(worker);
  pump();
  ASSERT_GT(scrape().at("tessera_film_bytes"), 0);
  ASSERT_TRUE(change(job, JobAdmin::Change::cancel).ok());
  EXPECT_EQ(scrape().at("tessera_film_bytes"), 0);
}

TEST_F(MetricsTest, UnitsAreCountedByState) {
  TestWorker worker = join("w", 4);
  const std::string job = create_job("a");  // 20 × 12 pixels, 6 tiles
  const auto total = static_cast<double>(view(job).unit_count);
  ASSERT_GT(total, 4);
  auto values = scrape();
  EXPECT_EQ(values.at(R"(tessera_jobs{state="running"})"), 1);
  EXPECT_EQ(values.at(R"(tessera_units{state="leased"})"), 4);
  EXPECT_EQ(values.at(R"(tessera_units{state="waiting"})"), total - 4);
  EXPECT_EQ(values.at(R"(tessera_workers{state="working"})"), 1);
  EXPECT_EQ(values.at("tessera_worker_threads"), 2);

  now += std::chrono::seconds(3);
  deliver_all(worker);
  EXPECT_GT(scrape().at("tessera_ingest_bytes"), 0);
  pump();
  values = scrape();
  EXPECT_EQ(values.at(R"(tessera_units{state="committed"})"), 4);
  EXPECT_EQ(values.at("tessera_units_committed_total"), 4);
  EXPECT_EQ(values.at("tessera_cpu_seconds_total"), 2);
  EXPECT_EQ(values.at("tessera_unit_turnaround_seconds_count"), 4);
  EXPECT_EQ(values.at("tessera_unit_turnaround_seconds_sum"), 12);
  EXPECT_EQ(values.at("tessera_commit_seconds_count"), 1);
  EXPECT_EQ(values.at(R"(tessera_film_blocks_total{source="delivered"})"), 4);
  EXPECT_EQ(values.at("tessera_merge_seconds_count"), 4);
  EXPECT_EQ(values.at("tessera_ingest_bytes"), 0);
  EXPECT_GT(values.at("tessera_film_bytes"), 0);

  ASSERT_TRUE(change(job, JobAdmin::Change::pause).ok());
  values = scrape();
  EXPECT_EQ(values.at(R"(tessera_units{state="waiting"})"), 0);
  EXPECT_EQ(values.at(R"(tessera_units{state="paused"})"), total - 4);
  EXPECT_EQ(values.at(R"(tessera_jobs{state="paused"})"), 1);

  ASSERT_TRUE(change(job, JobAdmin::Change::resume).ok());
  coordinator->workers().grant_credits(worker.session, 64);
  finish_job(worker, job);
  values = scrape();
  EXPECT_EQ(values.at(R"(tessera_jobs{state="done"})"), 1);
  EXPECT_EQ(values.at(R"(tessera_units{state="committed"})"), 0);  // counts unfinished jobs only
  EXPECT_EQ(values.at("tessera_units_committed_total"), total);
  EXPECT_EQ(values.at("tessera_samples_total"), 20 * 12 * 8);
  EXPECT_EQ(values.at(R"(tessera_acknowledgements_total{status="committed"})"), total);
  EXPECT_EQ(values.at("tessera_frame_write_duration_seconds_count"), 1);
}

TEST_F(MetricsTest, ErrorsAreCountedByKind) {
  TestWorker worker = join("w", 2);
  const std::string job = create_job("a");
  collect(worker);
  const Leased unit = worker.units.at(0);
  coordinator->workers().fail_unit(worker.session, unit.lease, unit.name.unit.tile,
                                   {"w", "burnt", ""}, absl::StatusCode::kInternal);
  const Leased other = worker.units.at(1);
  deliver(worker, other, bytes_of(other).substr(1));
  pump();
  auto values = scrape();
  EXPECT_EQ(values.at(R"(tessera_errors_total{kind="unit_failed"})"), 1);
  EXPECT_EQ(values.at(R"(tessera_errors_total{kind="block_rejected"})"), 1);
  EXPECT_EQ(values.at(R"(tessera_acknowledgements_total{status="rejected"})"), 1);
  EXPECT_EQ(values.at(R"(tessera_errors_total{kind="worker_lost"})"), 0);

  for (int i = 0; i < 60; ++i) {
    now += std::chrono::milliseconds(100);
    coordinator->tick();
  }
  values = scrape();
  EXPECT_EQ(values.at(R"(tessera_errors_total{kind="worker_lost"})"), 1);
  EXPECT_EQ(values.at(R"(tessera_workers{state="lost"})"), 1);
  EXPECT_EQ(values.at(R"(tessera_workers{state="working"})"), 0);
}

TEST_F(MetricsTest, AuditsAndQuarantinesAreCounted) {
  options.policy.audit_fraction = 1;
  start();
  TestWorker ann = join("ann"), bob = join("bob"), faulty = join("faulty");
  const std::string job = create_job("a");
  for (int round = 0; round < 200 && !has_ended(view(job).state); ++round) {
    for (TestWorker* worker : {&ann, &bob, &faulty}) {
      collect(*worker);
      for (const Leased& unit : std::exchange(worker->units, {})) {
        std::string bytes = bytes_of(unit);
        if (worker == &faulty) bytes[2] = static_cast<char>(bytes[2] ^ 0x20);
        deliver(*worker, unit, bytes);
      }
      pump();
      coordinator->workers().grant_credits(worker->session, 4);
      coordinator->workers().record_contact(worker->session);
    }
    now += std::chrono::milliseconds(100);
    coordinator->tick();
    pump();
  }
  const JobReport report = coordinator->queries().report(job).value();
  ASSERT_EQ(report.view.state, JobState::done);
  const auto values = scrape();
  EXPECT_EQ(values.at("tessera_workers_quarantined_total"), 1);
  EXPECT_EQ(values.at(R"(tessera_workers{state="quarantined"})"), 1);
  EXPECT_GE(report.counters.mismatched, 1);
  EXPECT_EQ(values.at("tessera_results_mismatched_total"),
            static_cast<double>(report.counters.mismatched));
  EXPECT_GE(report.counters.audited, report.view.unit_count);
  EXPECT_EQ(values.at("tessera_audits_total"), static_cast<double>(report.counters.audited));
}

TEST_F(MetricsTest, UnitsForNewWorkersAreThoseTheyCouldTake) {
  const auto units = [&](const std::string& pool, const std::string& tag) {
    const auto values = scrape();
    const auto found = values.find("tessera_pool_units_for_new_workers{pool=\"" + pool +
                                   "\",tag=\"" + tag + "\"}");
    return found == values.end() ? -1 : found->second;
  };
  const auto add = [&](const std::string& name, const std::function<void(JobSpec&)>& change) {
    JobSpec spec = spec_of(name);  // 6 units
    change(spec);
    const auto created = create(spec);
    EXPECT_TRUE(created.ok()) << created.status();
    return created->view.spec->id;
  };
  EXPECT_EQ(units("default", ""), 0) << "an autoscaler needs a value";
  EXPECT_EQ(units("night", ""), -1);
  const std::string plain = add("plain", [](JobSpec&) {});
  EXPECT_EQ(units("default", ""), 6);
  add("night", [](JobSpec& spec) { spec.pool = "night"; });
  add("gpu", [](JobSpec& spec) { spec.required_tag = "gpu"; });
  EXPECT_EQ(units("default", ""), 6) << "neither another pool's nor those that need a tag";
  EXPECT_EQ(units("night", ""), 6);
  EXPECT_EQ(units("default", "gpu"), 6);
  add("later", [&](JobSpec& spec) { spec.after = {{plain, Dependency::Kind::success}}; });
  EXPECT_EQ(units("default", ""), 6) << "blocked by another job";

  coordinator->settings().set_limit("licence", 8, [](const auto&) {});
  pump();
  for (const char* name : {"one", "two", "three"}) {
    add(name, [](JobSpec& spec) { spec.limits = {{"licence", 1}}; });
  }
  EXPECT_EQ(units("default", ""), 6 + 8) << "the three jobs share the limit";
  coordinator->settings().set_limit("licence", 0, [](const auto&) {});
  pump();
  EXPECT_EQ(units("default", ""), 6);

  ASSERT_TRUE(change(plain, JobAdmin::Change::pause).ok());
  const std::string alone = add("alone", [](JobSpec& spec) {
    spec.max_workers = 1;
    spec.settings.tile = 1;
  });
  ASSERT_GT(view(alone).unit_count, 2 * 32);
  EXPECT_EQ(units("default", ""), 32) << "a second worker could take none";
  join("w", 2);
  EXPECT_EQ(view(alone).state, JobState::running);
  EXPECT_EQ(units("default", ""), 0);
  EXPECT_EQ(scrape().at(R"(tessera_pool_units_waiting{pool="default"})"),
            static_cast<double>(view(alone).unit_count - 2 + 6))
      << "this worker can take them; those that need a tag count as well";
}

TEST_F(MetricsTest, UnitsWithLostSceneNeedNoNewWorkers) {
  const contract::Digest scene = contract::sha256("scene");
  ASSERT_TRUE(store.assets().add(scene, "scene").ok());
  JobSpec spec = spec_of("a");
  spec.assets = {{"scene.glb", scene, 5}};
  ASSERT_TRUE(create(spec).ok());
  EXPECT_EQ(scrape().at(R"(tessera_pool_units_for_new_workers{pool="default",tag=""})"), 6);
  store.assets().lose(scene);
  coordinator->assets().note_lost(scene);
  pump();
  EXPECT_EQ(scrape().at(R"(tessera_pool_units_for_new_workers{pool="default",tag=""})"), 0);
}

TEST_F(MetricsTest, PoolsAndLimitsAreShown) {
  coordinator->settings().set_limit("licence", 2, [](const auto&) {});
  pump();
  JobSpec spec = spec_of("a");
  spec.limits = {{"licence", 1}};
  ASSERT_TRUE(create(spec).ok());
  JobSpec late = spec_of("b");
  late.pool = "night";
  const auto night = create(late);
  ASSERT_TRUE(night.ok());
  JobSpec blocked = spec_of("c");
  blocked.after = {{night->view.spec->id, Dependency::Kind::success}};
  ASSERT_TRUE(create(blocked).ok());
  now += std::chrono::seconds(90);
  auto values = scrape();
  EXPECT_EQ(values.at(R"(tessera_pool_units_waiting{pool="default"})"), 6);
  EXPECT_EQ(values.at(R"(tessera_pool_units_waiting{pool="night"})"), 6);
  EXPECT_EQ(values.at(R"(tessera_pool_worker_threads{pool="night"})"), 0);
  EXPECT_GE(values.at(R"(tessera_pool_oldest_wait_seconds{pool="night"})"), 90);
  EXPECT_EQ(values.at(R"(tessera_units{state="waiting"})"), 12);
  EXPECT_EQ(values.at(R"(tessera_units{state="blocked"})"), 6);

  join("w");
  values = scrape();
  EXPECT_EQ(values.at(R"(tessera_limit_units{limit="licence"})"), 2);
  EXPECT_EQ(values.at(R"(tessera_limit_used_units{limit="licence"})"), 2);
  EXPECT_EQ(values.at(R"(tessera_pool_units_waiting{pool="default"})"), 0)
      << "the limit is reached";
  EXPECT_EQ(values.at(R"(tessera_pool_worker_threads{pool="default"})"), 2);

  ASSERT_TRUE(change(night->view.spec->id, JobAdmin::Change::cancel).ok());
  EXPECT_EQ(scrape().count(R"(tessera_pool_units_waiting{pool="night"})"), 0u)
      << "nothing is in it";
}

}  // namespace
}  // namespace tessera::server
