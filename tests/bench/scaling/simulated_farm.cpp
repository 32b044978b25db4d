#include "tests/bench/scaling/simulated_farm.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <queue>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "contract/pass_schedule.h"
#include "server/schedule/scheduler/scheduler.h"
#include "tests/bench/scaling/film_threads.h"

namespace tessera::bench {
namespace {

using contract::Unit;
using server::Duration;
using server::Job;
using server::JobState;
using server::Outbox;
using server::Scheduler;
using server::Time;
using server::WorkerKey;

constexpr std::chrono::milliseconds kTick{100};
constexpr std::int32_t kTileEdge = 64;
constexpr std::int32_t kLongestRow = 1000;  // tiles

Duration span_of(double seconds) {
  return std::chrono::duration_cast<Duration>(std::chrono::duration<double>(seconds));
}

/// Returns a number that depends on the unit's tile alone (the finaliser of SplitMix64, Steele et
/// al. 2014).
std::uint64_t scramble(const Unit& unit) {
  std::uint64_t x =
      (static_cast<std::uint64_t>(unit.frame) << 32) ^ static_cast<std::uint64_t>(unit.tile);
  x += 0x9e3779b97f4a7c15;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9;
  x = (x ^ (x >> 27)) * 0x94d049bb133111eb;
  return x ^ (x >> 31);
}

/// A resource that serves requests one after the other.
class Queue {
 public:
  /// Returns when a request that arrives `now` is served.
  Time serve(Time now, double seconds) {
    free_ = std::max(free_, now) + span_of(seconds);
    busy_ += seconds;
    return free_;
  }
  double busy() const { return busy_; }

 private:
  Time free_{};
  double busy_ = 0;
};

class SimulatedFarm {
 public:
  SimulatedFarm(const MeasuredUnits& measured, const FarmPlan& farm, const JobPlanned& planned)
      : measured_(measured),
        farm_(farm),
        scheduler_({"store", "key", 1}, policy(), {}, now_),
        job_(scheduler_.changes().add_job(1, spec_of(planned), JobState::queued)),
        film_(farm.film_threads) {}

  Simulated run() {
    connect_workers();
    push(now_ + kTick, 0, Kind::tick, {});
    if (farm_.death_seconds) push(Time{} + span_of(*farm_.death_seconds), 1, Kind::death, {});
    while (!is_over() && !events_.empty()) {
      const Event event = events_.top();
      events_.pop();
      now_ = event.at;
      handle(event);
      deliver_mail();
    }
    Simulated result;
    const Time end = std::max(now_, film_.finish());
    result.wall_seconds = server::seconds(end - Time{});
    result.unit_seconds = unit_seconds_;
    result.tail_seconds = first_idle_ ? server::seconds(end - *first_idle_) : 0;
    result.film_busy = server::seconds(film_.busy()) / (result.wall_seconds * farm_.film_threads);
    result.ingest_busy = std::max(line_.busy(), store_.busy()) / result.wall_seconds;
    result.units = job_.plan->counts().committed;
    result.copies = leased_ - result.units;
    return result;
  }

 private:
  enum class Kind : std::uint8_t { tick, lease, revoke, finish, committed, credit, death };
  struct Event {
    Time at;
    std::int64_t number = 0;  // at equal times the event created first comes first
    Kind kind = Kind::tick;
    WorkerKey worker = 0;
    Unit unit;
    bool operator<(const Event& other) const {
      return std::tie(other.at, other.number) < std::tie(at, number);
    }
  };
  struct Worker {
    std::deque<Unit> waiting;
    bool is_busy = false, is_dead = false;
  };

  static server::SchedulePolicy policy() {
    server::SchedulePolicy policy;
    policy.audit_fraction = 0;
    return policy;
  }

  std::shared_ptr<const server::JobSpec> spec_of(const JobPlanned& planned) {
    auto spec = std::make_shared<server::JobSpec>();
    spec->id = "job";
    const std::int32_t row = std::min(planned.tiles, kLongestRow);
    spec->settings.width = kTileEdge * row;
    spec->settings.height = kTileEdge * ((planned.tiles + row - 1) / row);
    spec->settings.tile = kTileEdge;
    spec->settings.frames = {{0, planned.frames - 1, 1}};
    spec->settings.spp = planned.spp;
    return spec;
  }

  void push(Time at, WorkerKey worker, Kind kind, const Unit& unit) {
    events_.push({at, ++event_count_, kind, worker, unit});
  }

  void connect_workers() {
    // As in worker/agent/units/unit_queue.cpp: units being rendered, waiting, and being sent.
    double sum = 0;
    for (const double seconds : measured_.sample_seconds) sum += seconds;
    const contract::Pass longest = contract::schedule(job_.spec->settings).back();
    const double mean =
        sum * longest.sample_count / static_cast<double>(measured_.sample_seconds.size());
    const double trip = farm_.round_trip_seconds + farm_.durable_after_seconds;
    credits_ = 2 + static_cast<std::int32_t>(std::ceil(trip / mean));
    for (std::int32_t i = 0; i < farm_.workers; ++i) connect_worker();
    deliver_mail();
  }

  void connect_worker() {
    server::Hello hello;
    hello.worker_id = "w" + std::to_string(workers_.size());
    hello.host = hello.worker_id;
    hello.credit_count = credits_;
    workers_[scheduler_.connections().connect(hello, now_)];
  }

  bool is_over() const {
    return job_.plan && job_.plan->counts().committed == job_.plan->counts().planned;
  }

  void handle(const Event& event) {
    const bool is_sent = event.kind == Kind::tick || event.kind == Kind::committed;
    if (!is_sent && workers_[event.worker].is_dead) return;
    switch (event.kind) {
      case Kind::tick:
        for (const auto& [key, worker] : workers_) {
          if (!worker.is_dead) scheduler_.connections().record_contact(key, now_);
        }
        scheduler_.tick(now_, kTick);
        push(now_ + kTick, 0, Kind::tick, {});
        break;
      case Kind::lease:
        workers_[event.worker].waiting.push_back(event.unit);
        start_next(event.worker);
        break;
      case Kind::revoke:
        revoke(event.worker, event.unit);
        break;
      case Kind::finish:
        finish(event.worker, event.unit);
        break;
      case Kind::committed:
        commit(event.worker, event.unit);
        break;
      case Kind::credit:
        scheduler_.connections().grant_credits(event.worker, 1, now_);
        break;
      case Kind::death:
        workers_[event.worker].is_dead = true;
        connect_worker();
        break;
    }
  }

  double seconds_of(const Unit& unit) const {
    const std::vector<double>& tiles = measured_.sample_seconds;
    const contract::Pass& pass = job_.plan->shape().passes[static_cast<std::size_t>(unit.pass)];
    return tiles[scramble(unit) % tiles.size()] * pass.sample_count;
  }

  void start_next(WorkerKey key) {
    Worker& worker = workers_[key];
    if (worker.is_busy || worker.waiting.empty()) return;
    const Unit unit = worker.waiting.front();
    worker.waiting.pop_front();
    worker.is_busy = true;
    scheduler_.connections().heartbeat(key, {{"job", unit}}, 0, now_);
    push(now_ + span_of(seconds_of(unit)), key, Kind::finish, unit);
  }

  void finish(WorkerKey key, const Unit& unit) {
    workers_[key].is_busy = false;
    const double trip = farm_.round_trip_seconds / 2;
    const Time arrived =
        line_.serve(now_ + span_of(trip), measured_.block_bytes / farm_.bytes_per_second);
    const Time durable = store_.serve(arrived, measured_.block_bytes / farm_.durable_per_second) +
                         span_of(farm_.durable_after_seconds);
    push(durable, key, Kind::committed, unit);
    start_next(key);
    if (!workers_[key].is_busy && job_.plan->counts().waiting == 0 && !first_idle_) {
      first_idle_ = now_;
    }
  }

  void commit(WorkerKey key, const Unit& unit) {
    const std::string& id = scheduler_.workers().find(key)->id;
    if (job_.plan->is_committed(unit)) {
      scheduler_.results().release_duplicate(job_, unit, id);
    } else {
      scheduler_.results().commit(job_, unit, id, seconds_of(unit));
      unit_seconds_ += seconds_of(unit);
      film_.post(now_, unit.frame, span_of(measured_.merge_seconds), false);
      if (job_.plan->is_complete(unit.frame)) {
        film_.post(now_, unit.frame, span_of(measured_.image_seconds), true);
      }
    }
    // The worker gets the acknowledgement and grants the credit again.
    push(now_ + span_of(farm_.round_trip_seconds), key, Kind::credit, unit);
  }

  void deliver_mail() {
    const Time there = now_ + span_of(farm_.round_trip_seconds / 2);
    const server::Effects effects = scheduler_.take_effects();
    for (const WorkerKey key : effects.to_close) scheduler_.connections().disconnect(key);
    for (const WorkerKey key : effects.to_wake) {
      server::Worker* worker = scheduler_.workers().find(key);
      if (worker == nullptr) continue;  // it has died
      const Outbox outbox = std::exchange(worker->outbox, Outbox{});
      for (const server::UnitName& name : outbox.revoked) push(there, key, Kind::revoke, name.unit);
      for (const server::Lease& lease : outbox.leases) {
        leased_ += lease.tile_count;
        for (std::int32_t i = 0; i < lease.tile_count; ++i) {
          push(there, key, Kind::lease, {lease.frame, lease.first_tile + i, lease.pass});
        }
      }
    }
  }

  /// Unstarted units are returned at once; started ones are rendered for nothing.
  void revoke(WorkerKey key, const Unit& unit) {
    Worker& worker = workers_[key];
    const auto found = std::find(worker.waiting.begin(), worker.waiting.end(), unit);
    if (found == worker.waiting.end()) return;
    worker.waiting.erase(found);
    --leased_;
    scheduler_.connections().return_units(key, {{"job", unit}}, now_);
    push(now_ + span_of(farm_.round_trip_seconds), key, Kind::credit, unit);
  }

  const MeasuredUnits& measured_;
  const FarmPlan farm_;
  Time now_{};
  Scheduler scheduler_;
  Job& job_;
  std::map<WorkerKey, Worker> workers_;
  std::priority_queue<Event> events_;
  std::int64_t event_count_ = 0, leased_ = 0;
  std::int32_t credits_ = 0;
  Queue line_, store_;
  FilmThreads film_;
  std::optional<Time> first_idle_;
  double unit_seconds_ = 0;
};

}  // namespace

Simulated simulate(const MeasuredUnits& measured, const FarmPlan& farm, const JobPlanned& job) {
  return SimulatedFarm(measured, farm, job).run();
}

}  // namespace tessera::bench
