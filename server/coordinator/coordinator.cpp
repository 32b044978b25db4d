#include "server/coordinator/coordinator.h"

#include <chrono>
#include <utility>

#include "server/coordinator/farm_loader.h"

namespace tessera::server {
namespace {

constexpr std::chrono::seconds kWriteRunningEvery{20}, kCheckWriterEvery{2};

}  // namespace

Coordinator::Coordinator(Store& store, FarmOptions options, const std::vector<std::string>& roster)
    : store_(store),
      farm_(store, std::move(options), roster),
      health_(farm_.options().clock),
      budget_(farm_.options().ingest_bytes),
      pipeline_(farm_, store),
      budgets_(farm_, store, pipeline_),
      finisher_(farm_, store, pipeline_, budgets_),
      images_(farm_, store, finisher_),
      audits_(farm_, store, pipeline_, finisher_),
      intake_({farm_, store, pipeline_, budget_, finisher_, audits_, budgets_}),
      workers_(farm_, store, pipeline_),
      assets_(farm_, store, pipeline_),
      settings_(farm_, store, pipeline_),
      shares_(farm_, store, pipeline_),
      service_time_(farm_, store, pipeline_),
      admission_(farm_, store, pipeline_, assets_),
      jobs_({farm_, store, pipeline_, finisher_, assets_}),
      queries_({farm_, store, pipeline_, finisher_, budget_, intake_.deliveries(), budgets_,
                [this](const std::string& owner) { return assets_.bytes_of(owner); }}) {
  farm_.add_handler(workers_);
  farm_.add_handler(audits_);
  farm_.add_handler(finisher_);
  farm_.add_handler(pipeline_);
}

absl::StatusOr<std::unique_ptr<Coordinator>> Coordinator::open(Store& store, FarmOptions options) {
  const auto roster = store.workers().roster();
  if (!roster.ok()) return roster.status();
  std::unique_ptr<Coordinator> opened(new Coordinator(store, std::move(options), *roster));
  auto events = store.events().newest(EventLog::kMaxEvents);
  if (!events.ok()) return events.status();
  opened->farm_.events().load(*std::move(events), store.events().last_dropped());
  {
    FarmChange change(opened->farm_);
    absl::Status loaded = opened->settings_.load(change);
    loaded.Update(opened->shares_.load(change));
    loaded.Update(opened->service_time_.load(change));
    loaded.Update(opened->budgets_.load(change));
    if (!loaded.ok()) return loaded;
  }
  FarmLoader loader({opened->farm_, store, opened->pipeline_, opened->finisher_, opened->assets_});
  if (absl::Status loaded = loader.load(); !loaded.ok()) return loaded;
  return opened;
}

void Coordinator::tick() {
  FarmChange change(farm_);
  change.scheduler().tick(change.now(), farm_.options().tick_period);
  jobs_.tick(change);
  budgets_.tick(change);
  health_.note_timer();
  if (change.now() - last_writer_check_ >= kCheckWriterEvery) {
    last_writer_check_ = change.now();
    audits_.tick();
    pipeline_.post([this, has_waiting = jobs_.has_waiting()] {
      health_.note_writer();
      health_.note_disk(store_.free_bytes(), has_waiting);
    });
  }
  if (change.now() - last_running_write_ < kWriteRunningEvery) return;
  last_running_write_ = change.now();
  pipeline_.write_running(change);
  shares_.write_use(change);
  service_time_.write(change);
}

Coordinator::MemoryUse Coordinator::memory_use() const {
  const FarmView view(farm_);
  return {.ingest_bytes = budget_.used_bytes(),
          .film_bytes = finisher_.films().cache().used_bytes(),
          .connections = workers_.connection_count(view),
          .blocks = intake_.block_count(),
          .writes = pipeline_.waiting_count(),
          .film_tasks = finisher_.tasks().size()};
}

void Coordinator::stop() {
  {
    FarmChange change(farm_);
    pipeline_.write_running(change);
    shares_.write_use(change);
    service_time_.write(change);
  }
  budget_.stop();
  pipeline_.stop();
  finisher_.tasks().stop();
}

}  // namespace tessera::server
