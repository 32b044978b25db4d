#include "server/workers/worker_registry.h"

#include <map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace tessera::server {
namespace {

constexpr std::size_t kManyWorkers = 1000;  // above which heartbeats are halved

absl::Status no_such_worker(const std::string& worker_id) {
  return absl::NotFoundError(absl::StrCat("no worker \"", worker_id, "\""));
}

/// Notes a unit's failure with the end of the renderer's log.
void note_failure(FarmChange& change, const Job& job, const std::string& worker_id,
                  const std::string& unit, const Failure& failure) {
  change.note(EventKind::unit_failed, job, worker_id,
              absl::StrCat(unit, " failed: ", failure.message));
  for (const absl::string_view line : absl::StrSplit(failure.log_tail, '\n', absl::SkipEmpty())) {
    change.note(EventKind::log_line, job, worker_id, absl::StrCat("renderer: ", std::string(line)));
  }
}

}  // namespace

// Connections ------------------------------------------------------------------------------------

WorkerRegistry::Joined WorkerRegistry::join(const Hello& hello,
                                            std::shared_ptr<WorkerConnection> connection) {
  FarmChange change(farm_);
  const WorkerKey key = change.scheduler().connections().connect(hello, change.now());
  OpenConnection& connected = connections_[key];
  if (connected.connection) {
    change.after_unlocking([old = connected.connection] {
      old->close(absl::AbortedError("replaced by a newer stream of this worker"));
    });
  }
  connected = {++last_session_, std::move(connection)};
  const std::string who =
      absl::StrCat(hello.name, " on ", hello.host, ", ", hello.isa, ", ", hello.thread_count,
                   hello.thread_count == 1 ? " thread" : " threads");
  change.note(EventKind::worker_joined, hello.worker_id, who);
  change.log(LogLevel::info, absl::StrCat("worker ", hello.worker_id, " connected: ", who));
  return {{key, connected.session},
          store_.id(),
          connections_.size() > kManyWorkers ? 2000 : 1000,
          static_cast<std::int32_t>(seconds(farm_.options().policy.worker_timeout) * 1000)};
}

bool WorkerRegistry::is_open(const FarmView& /*farm*/, Session session) const {
  const auto connected = connections_.find(session.worker);
  return connected != connections_.end() && connected->second.session == session.number;
}

/// Returns the worker of an open session, after noting the contact, else nullptr.
Worker* WorkerRegistry::session_worker(FarmChange& change, Session session) {
  if (!is_open(change, session)) return nullptr;
  Worker* worker = change.scheduler().workers().find(session.worker);
  if (worker != nullptr)
    change.scheduler().connections().record_contact(session.worker, change.now());
  return worker;
}

void WorkerRegistry::disconnect(Session session) {
  FarmChange change(farm_);
  if (!is_open(change, session)) return;
  const auto connected = connections_.find(session.worker);
  // The connection may own the caller: it is destroyed after unlocking.
  change.after_unlocking([connection = std::move(connected->second.connection)] {});
  connections_.erase(connected);
  change.scheduler().connections().disconnect(session.worker);
}

void WorkerRegistry::carry_out(FarmChange& change, const Effects& effects) {
  for (const WorkerKey key : effects.to_wake) {
    const auto connected = connections_.find(key);
    if (connected == connections_.end()) continue;
    change.after_unlocking([connection = connected->second.connection] { connection->wake(); });
  }
  for (const WorkerKey key : effects.to_close) close_lost(change, key);
  for (const WorkerKey key : effects.left) note_left(change, key);
  for (const WorkerKey key : effects.to_close_unread) close_unread(change, key);
}

/// Closes the stream of a worker that the scheduler has disconnected already.
void WorkerRegistry::close_unread(FarmChange& change, WorkerKey key) {
  const auto connected = connections_.find(key);
  if (connected == connections_.end()) return;
  change.after_unlocking([connection = connected->second.connection] {
    connection->close(
        absl::ResourceExhaustedError("too many unread messages for this worker; reconnect"));
  });
  connections_.erase(connected);
}

void WorkerRegistry::close_lost(FarmChange& change, WorkerKey key) {
  farm_.metrics().errors.worker_lost.Increment();
  if (const Worker* worker = change.scheduler().workers().find(key)) {
    change.note(EventKind::worker_lost, worker->id, "");
    change.log(LogLevel::warn, absl::StrCat("worker ", worker->id, " is lost"));
  }
  const auto connected = connections_.find(key);
  if (connected == connections_.end()) return;
  change.after_unlocking([connection = connected->second.connection] {
    connection->close(absl::UnavailableError("heartbeat timeout; reconnect"));
  });
  connections_.erase(connected);
  change.scheduler().connections().disconnect(key);
}

/// A drained worker has disconnected.
void WorkerRegistry::note_left(FarmChange& change, WorkerKey key) {
  const Worker* worker = change.scheduler().workers().find(key);
  if (worker == nullptr) return;
  change.note(EventKind::worker_drained, worker->id, "");
  change.log(LogLevel::info, absl::StrCat("worker ", worker->id, " has drained and left"));
}

// Reports ----------------------------------------------------------------------------------------

void WorkerRegistry::record_contact(Session session) {
  FarmChange change(farm_);
  session_worker(change, session);
}

void WorkerRegistry::heartbeat(Session session, const std::vector<UnitName>& started,
                               std::int64_t rss_bytes) {
  FarmChange change(farm_);
  if (session_worker(change, session) == nullptr) return;
  change.scheduler().connections().heartbeat(session.worker, started, rss_bytes, change.now());
}

void WorkerRegistry::grant_credits(Session session, std::int32_t count) {
  FarmChange change(farm_);
  if (session_worker(change, session) == nullptr) return;
  change.scheduler().connections().grant_credits(session.worker, count, change.now());
}

void WorkerRegistry::begin_draining(Session session) {
  FarmChange change(farm_);
  const Worker* worker = session_worker(change, session);
  if (worker == nullptr) return;
  // After an order the worker confirms what is known already.
  if (!change.scheduler().connections().begin_draining(session.worker)) return;
  change.note(EventKind::worker_draining, worker->id, "stopped at the worker");
  change.log(LogLevel::info, absl::StrCat("worker ", worker->id, " is draining"));
}

void WorkerRegistry::return_units(Session session, const std::vector<UnitName>& units,
                                  bool lacks_files) {
  FarmChange change(farm_);
  if (session_worker(change, session) == nullptr) return;
  change.scheduler().connections().return_units(session.worker, units, change.now(), lacks_files);
}

void WorkerRegistry::fail_unit(Session session, const Lease& lease, std::int32_t tile,
                               Failure failure, absl::StatusCode code) {
  FarmChange change(farm_);
  const Worker* worker = session_worker(change, session);
  if (worker == nullptr) return;
  farm_.metrics().errors.unit_failed.Increment();
  const std::string unit =
      absl::StrCat("frame ", lease.frame, ", tile ", tile, ", pass ", lease.pass);
  const Job* job = change.find_job(lease.job_id);
  if (job != nullptr && job->ever_leased_to.count(worker->key) > 0) {
    note_failure(change, *job, worker->id, unit, failure);
  }
  change.log(LogLevel::warn, absl::StrCat("worker ", worker->id, ": job ", lease.job_id, ", ", unit,
                                          " failed: ", failure.message));
  change.scheduler().failures().fail_unit(session.worker, lease, tile, std::move(failure), code,
                                          change.now());
}

void WorkerRegistry::scene_loaded(Session session, const std::string& job_id,
                                  const SceneLoad& load) {
  FarmChange change(farm_);
  if (session_worker(change, session) == nullptr) return;
  change.scheduler().connections().scene_loaded(session.worker, job_id, load);
}

void WorkerRegistry::take_log_lines(Session session, const std::vector<LogLine>& lines) {
  FarmChange change(farm_);
  const Worker* worker = session_worker(change, session);
  if (worker == nullptr) return;
  for (const LogLine& line : lines) {
    const Job* job = change.find_job(line.job_id);
    if (job == nullptr) continue;
    // Also for a job that has ended: its last lines arrive late.
    const bool took_part =
        job->ever_leased_to.count(worker->key) + job->contributions.count(worker->id) > 0;
    if (took_part) change.note(EventKind::log_line, *job, worker->id, line.text);
  }
}

Outbox WorkerRegistry::take_outbox(Session session) {
  FarmChange change(farm_);
  if (!is_open(change, session)) return {};
  Worker* worker = change.scheduler().workers().find(session.worker);
  return worker == nullptr ? Outbox{} : std::exchange(worker->outbox, Outbox{});
}

std::vector<WorkerRegistry::Listed> WorkerRegistry::list() const {
  const FarmView view(farm_);
  std::vector<Listed> workers;
  const WorkerTable& present = view.scheduler().workers();
  for (const auto& [key, worker] : present.all()) {
    workers.emplace_back(worker, seconds(view.now() - worker.last_contact));
  }
  std::map<std::string, Worker> absent;
  const auto add = [&](const std::string& id) -> Worker& {
    Worker& worker = absent[id];
    worker.id = id;
    worker.thread_count = 0;
    worker.lost = true;
    return worker;
  };
  for (const std::string& name : view.scheduler().quarantine().banned()) {
    if (present.find(name) == nullptr && !present.has_witness(name)) add(name).quarantined = true;
  }
  for (const auto& [id, reason] : view.scheduler().orders().placement().aside()) {
    if (present.find(id) != nullptr) continue;
    Worker& worker = add(id);
    worker.set_aside = true;
    worker.note = reason;
  }
  for (auto& [id, worker] : absent) workers.emplace_back(std::move(worker), std::nullopt);
  return workers;
}

// Orders -----------------------------------------------------------------------------------------

absl::Status WorkerRegistry::drain_worker(const std::string& worker_id) {
  FarmChange change(farm_);
  if (!change.scheduler().orders().drain(worker_id)) return no_such_worker(worker_id);
  change.note(EventKind::worker_draining, worker_id, "requested by an operator");
  change.log(LogLevel::info, absl::StrCat("worker ", worker_id, " is draining"));
  return absl::OkStatus();
}

void WorkerRegistry::ban_worker(const std::string& worker_id, OnBanned done) {
  pipeline_.post([this, worker_id, done = std::move(done)] { done(ban_now(worker_id)); });
}

absl::StatusOr<std::vector<std::string>> WorkerRegistry::ban_now(const std::string& worker_id) {
  std::vector<std::string> names;
  {
    FarmChange change(farm_);
    if (change.scheduler().workers().find(worker_id) == nullptr) return no_such_worker(worker_id);
    names = change.scheduler().quarantine().names_to_ban(worker_id);
  }
  const auto write = [&] {
    absl::Status status;
    for (const std::string& name : names) status.Update(store_.workers().ban_worker(name));
    return status;
  };
  absl::Status written =
      pipeline_.write_and_tell(write, {0, 0, EventKind::worker_banned, "", "", worker_id, ""});
  if (!written.ok()) return written;
  FarmChange change(farm_);
  change.scheduler().quarantine().ban(worker_id);
  change.scheduler().dispatcher().dispatch_all(change.now());
  const WorkerTable& workers = change.scheduler().workers();
  std::vector<std::string> banned;
  for (const WorkerKey key : workers.of_witness(workers.witness_of(worker_id))) {
    banned.push_back(workers.at(key).id);
    change.log(LogLevel::warn,
               absl::StrCat("worker ", banned.back(), " is banned",
                            banned.back() == worker_id ? "" : ": it has the certificate of worker ",
                            banned.back() == worker_id ? "" : worker_id));
  }
  return banned;
}

void WorkerRegistry::allow_worker(const std::string& worker_id,
                                  std::function<void(absl::Status)> done) {
  pipeline_.post([this, worker_id, done = std::move(done)] { done(allow_now(worker_id)); });
}

absl::Status WorkerRegistry::allow_now(const std::string& worker_id) {
  std::vector<std::string> names;
  {
    const FarmView view(farm_);
    names = view.scheduler().quarantine().names_to_ban(worker_id);
  }
  for (const std::string& name : names) {
    if (absl::Status status = store_.workers().allow_worker(name); !status.ok()) return status;
  }
  FarmChange change(farm_);
  if (!change.scheduler().orders().allow(worker_id, change.now())) return no_such_worker(worker_id);
  change.note(EventKind::worker_allowed, worker_id, "");
  return absl::OkStatus();
}

void WorkerRegistry::record_join(Join join, std::int64_t max_joins,
                                 std::function<void(absl::Status)> done) {
  pipeline_.post([this, join = std::move(join), max_joins, done = std::move(done)] {
    done(store_.workers().record_join(join, max_joins));
  });
}

std::string WorkerRegistry::session_key(const std::string& worker_id,
                                        const std::string& certificate) const {
  // Neither name contains the separator.
  return contract::hmac_sha256(store_.key(),
                               absl::StrCat("session\n", worker_id, "\n", certificate))
      .hex();
}

}  // namespace tessera::server
