#pragma once

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "contract/pass_schedule.h"
#include "server/coordinator/coordinator.h"
#include "tests/support/memory_store/memory_store.h"
#include "tests/support/scratch_folder.h"

namespace tessera::server {

/// A worker's connection that only records messages.
class RecordingConnection final : public WorkerConnection {
 public:
  void wake() override { ++wake_count; }
  void close(const absl::Status& reason) override { closed = reason; }
  std::atomic<int> wake_count = 0;
  absl::Status closed;
};

/// A coordinator over a store in memory; the test controls its clock and runs its threads.
class CoordinatorFixture : public ::testing::Test {
 protected:
  void SetUp() override { start(); }
  void TearDown() override { coordinator.reset(); }

  /// Starts a coordinator on what the store holds, as after a crash.
  void start() {
    coordinator.reset();
    store.controls().reboot();
    now += std::chrono::hours(1);
    options.clock = [this] { return now; };
    options.wall_us = [this] { return wall_us; };
    options.random = [this] {
      return random_ = random_ * 6364136223846793005u + 1442695040888963407u;
    };
    options.read_spec = [this](const JobRecord& record) -> absl::StatusOr<JobSpec> {
      JobSpec spec = specs_.at(record.request);
      spec.id = record.id;
      return spec;
    };
    options.write_request = [this](const JobSpec& spec) {
      JobSpec longer = spec;
      longer.request = spec.request + "+" + std::to_string(spec.settings.spp) + "," +
                       std::to_string(spec.settings.error.value_or(0));
      specs_[longer.request] = longer;
      return longer.request;
    };
    auto opened = Coordinator::open(store, options);
    ASSERT_TRUE(opened.ok()) << opened.status();
    coordinator = *std::move(opened);
  }

  /// Writes what is pending and answers, in one round.
  bool write_round() {
    const bool wrote = coordinator->run_writer(false);
    return coordinator->run_answers(false) || wrote;
  }
  /// Writes and answers until nothing is left to do.
  void write_all() {
    while (write_round()) {
    }
  }
  /// Runs writer, answers and film thread until nothing is left to do.
  void pump() {
    while (write_round() || coordinator->run_film(false)) {
    }
  }

  JobSpec spec_of(const std::string& name, std::int32_t spp = 8) {
    JobSpec spec;
    spec.name = name;
    spec.owner = "ann";
    spec.request_id = spec.request = "request-" + name;
    spec.settings.width = 20;  // 3 x 2 tiles, those at the borders smaller
    spec.settings.height = 12;
    spec.settings.tile = 8;
    spec.settings.spp = spp;
    return spec;
  }
  /// Returns the spec of a request that the coordinator may read from the store.
  JobSpec remember(const JobSpec& spec) {
    specs_[spec.request] = spec;
    return spec;
  }
  absl::StatusOr<JobAdmission::Created> create(const JobSpec& spec) {
    remember(spec);
    absl::StatusOr<JobAdmission::Created> result = absl::UnknownError("no answer");
    coordinator->admission().create_job(spec, [&](const auto& created) { result = created; });
    pump();
    return result;
  }
  std::string create_job(const std::string& name, std::int32_t spp = 8) {
    const auto created = create(spec_of(name, spp));
    EXPECT_TRUE(created.ok()) << created.status();
    return created.ok() ? created->view.spec->id : "";
  }
  absl::StatusOr<JobView> change(const std::string& job_id, JobAdmin::Change change) {
    absl::StatusOr<JobView> result = absl::UnknownError("no answer");
    coordinator->jobs().change_job(job_id, change, [&](const auto& view) { result = view; });
    pump();
    return result;
  }
  absl::Status remove(const std::string& job_id) {
    absl::Status result = absl::UnknownError("no answer");
    coordinator->jobs().remove_job(job_id, [&](const absl::Status& status) { result = status; });
    pump();
    return result;
  }
  JobView view(const std::string& job_id) { return coordinator->queries().job(job_id).value(); }

  /// A unit with the lease that covers it.
  struct Leased {
    UnitName name;
    Lease lease;
  };
  struct TestWorker {
    std::string id;
    Session session;
    std::shared_ptr<RecordingConnection> link;
    std::vector<Leased> units;  // leased but not delivered
    std::vector<Acknowledgement> acknowledgements;
    std::vector<std::string> ended;
  };
  TestWorker join(const std::string& id, std::int32_t credits = 64,
                  const std::string& certificate = {}) {
    Hello hello;
    hello.worker_id = hello.name = id;
    hello.certificate = certificate;
    hello.thread_count = 2;
    hello.credit_count = credits;
    TestWorker worker{id, {}, std::make_shared<RecordingConnection>(), {}, {}, {}};
    worker.session = coordinator->workers().join(hello, worker.link).session;
    collect(worker);
    return worker;
  }
  /// Reads the worker's messages.
  void collect(TestWorker& worker) {
    Outbox outbox = coordinator->workers().take_outbox(worker.session);
    for (const Lease& lease : outbox.leases) {
      for (std::int32_t i = 0; i < lease.tile_count; ++i) {
        worker.units.push_back(
            {{lease.job_id, {lease.frame, lease.first_tile + i, lease.pass}}, lease});
      }
    }
    for (auto& acknowledgement : outbox.acknowledgements)
      worker.acknowledgements.push_back(std::move(acknowledgement));
    for (auto& job : outbox.ended_jobs) worker.ended.push_back(std::move(job));
  }

  /// The unit's block: a function of the unit alone.
  contract::FilmBlock block_of(const Leased& unit, const contract::FilmBlockShape& shape) const {
    contract::FilmBlock block = contract::FilmBlock::zeros(shape);
    if (noise > 0) return noisy_block(unit, std::move(block));
    for (std::size_t i = 0; i < block.rgb.size(); ++i) {
      block.rgb[i] =
          static_cast<float>(unit.lease.sample_count) *
          (0.25f + 0.01f * static_cast<float>(
                               (i + static_cast<std::size_t>(7 * unit.name.unit.tile)) % 13)) /
          contract::kReplicates;
    }
    for (float& alpha : block.alpha) alpha = static_cast<float>(unit.lease.sample_count);
    return block;
  }
  /// Radiance 0.5 with noise of standard deviation `noise` · (tile + 1) a sample.
  contract::FilmBlock noisy_block(const Leased& unit, contract::FilmBlock block) const {
    const contract::Unit& name = unit.name.unit;
    std::mt19937 rng(static_cast<std::uint32_t>(name.frame * 7919 + name.tile * 101 + name.pass));
    std::normal_distribution<double> normal;
    const double count = unit.lease.sample_count / static_cast<double>(contract::kReplicates);
    for (float& sum : block.rgb) {
      sum = static_cast<float>(0.5 * count +
                               noise * (name.tile + 1) * std::sqrt(count) * normal(rng));
    }
    for (float& alpha : block.alpha) alpha = static_cast<float>(unit.lease.sample_count);
    return block;
  }
  BlockHeader header_of(const Leased& unit, const std::string& bytes) const {
    return {unit.lease,
            unit.name.unit.tile,
            static_cast<std::int64_t>(bytes.size()),
            contract::sha256(bytes),
            0.5,
            {}};
  }
  contract::FilmBlockShape shape_of(const Leased& unit) {
    const contract::TileGrid grid(view(unit.name.job_id).spec->settings);
    const contract::PixelRect rect = grid.rect(unit.name.unit.tile);
    return {rect.width, rect.height, 0, unit.name.unit.pass == 0};
  }
  std::string bytes_of(const Leased& unit) {
    return contract::encode(block_of(unit, shape_of(unit)));
  }
  /// Delivers `bytes` as the unit's block; returns whether it was admitted.
  bool deliver(const TestWorker& worker, const Leased& unit, const std::string& bytes) {
    const BlockHeader header = header_of(unit, bytes);
    const auto admission = coordinator->intake().admit(worker.id, header);
    if (admission) coordinator->intake().deliver(worker.id, header, *admission, bytes);
    return admission.has_value();
  }
  void deliver_all(TestWorker& worker) {
    collect(worker);
    for (const Leased& unit : std::exchange(worker.units, {})) {
      deliver(worker, unit, bytes_of(unit));
    }
  }
  /// Renders as this worker until the job has ended.
  void finish_job(TestWorker& worker, const std::string& job_id) {
    for (int round = 0; round < 100 && !has_ended(view(job_id).state); ++round) {
      const std::size_t before = worker.acknowledgements.size();
      deliver_all(worker);
      pump();
      collect(worker);
      coordinator->workers().grant_credits(
          worker.session, static_cast<std::int32_t>(worker.acknowledgements.size() - before));
    }
  }
  std::string pixels_of(const std::string& job_id) {
    const auto frames = store.frames().list(job_id);
    return frames->empty() ? "" : frames->front().pixels_sha256.hex();
  }

  ScratchFolder folder;
  MemoryStore store{folder.path()};
  Time now{};
  std::int64_t wall_us = 1'700'000'000'000'000;
  FarmOptions options;
  double noise = 0;
  std::unique_ptr<Coordinator> coordinator;

 private:
  std::uint64_t random_ = 42;
  std::map<std::string, JobSpec> specs_;
};

}  // namespace tessera::server
