#include "server/settings/farm_settings.h"

#include <map>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

absl::Status no_such_limit(const std::string& name) {
  return absl::NotFoundError(absl::StrCat("no limit \"", name, "\""));
}

absl::Status no_such_worker(const std::string& worker_id) {
  return absl::NotFoundError(absl::StrCat("no worker \"", worker_id, "\""));
}

Settings limit_rows(const Limits& limits) {
  Settings rows;
  for (const auto& [name, limit] : limits.all()) {
    if (limit.units) rows[name] = absl::StrCat(*limit.units);
  }
  return rows;
}

}  // namespace

absl::Status FarmSettings::load(FarmChange& change) {
  const auto limits = store_.settings().read(SettingKind::limit);
  if (!limits.ok()) return limits.status();
  for (const auto& [name, value] : *limits) {
    std::int64_t units = 0;
    if (absl::SimpleAtoi(value, &units))
      change.scheduler().limits().set_limit(name, units, change.now());
  }
  const auto pools = store_.settings().read(SettingKind::pool);
  if (!pools.ok()) return pools.status();
  for (const auto& [worker, pool] : *pools)
    change.scheduler().orders().move(worker, pool, change.now());
  const auto aside = store_.settings().read(SettingKind::aside);
  if (!aside.ok()) return aside.status();
  for (const auto& [worker, reason] : *aside) {
    change.scheduler().orders().set_aside(worker, reason, change.now());
  }
  return absl::OkStatus();
}

// Limits -----------------------------------------------------------------------------------------

std::vector<LimitView> FarmSettings::limits() const {
  const FarmView view(farm_);
  std::vector<LimitView> limits;
  for (const auto& [name, limit] : view.scheduler().limits().table().all()) {
    if (limit.units) limits.push_back({name, *limit.units, limit.used});
  }
  return limits;
}

void FarmSettings::set_limit(const std::string& name, std::int64_t units,
                             std::function<void(absl::StatusOr<LimitView>)> done) {
  pipeline_.post([this, name, units, done = std::move(done)] { done(set_limit_now(name, units)); });
}

absl::StatusOr<LimitView> FarmSettings::set_limit_now(const std::string& name, std::int64_t units) {
  Settings rows;
  {
    const FarmView view(farm_);
    rows = limit_rows(view.scheduler().limits().table());
  }
  rows[name] = absl::StrCat(units);
  if (rows.size() > kMaxLimits) {
    return absl::ResourceExhaustedError(absl::StrCat("there are ", kMaxLimits, " limits already"));
  }
  if (absl::Status saved = store_.settings().save(SettingKind::limit, rows); !saved.ok()) {
    return saved;
  }
  FarmChange change(farm_);
  change.scheduler().limits().set_limit(name, units, change.now());
  change.log(LogLevel::info, absl::StrCat("limit ", name, " has ", units, " units"));
  return LimitView{name, units, change.scheduler().limits().table().all().at(name).used};
}

void FarmSettings::remove_limit(const std::string& name, std::function<void(absl::Status)> done) {
  pipeline_.post([this, name, done = std::move(done)] { done(remove_limit_now(name)); });
}

absl::Status FarmSettings::remove_limit_now(const std::string& name) {
  Settings rows;
  {
    const FarmView view(farm_);
    rows = limit_rows(view.scheduler().limits().table());
  }
  if (rows.erase(name) == 0) return no_such_limit(name);
  if (absl::Status saved = store_.settings().save(SettingKind::limit, rows); !saved.ok()) {
    return saved;
  }
  FarmChange change(farm_);
  change.scheduler().limits().remove_limit(name, change.now());
  change.log(LogLevel::info, absl::StrCat("limit ", name, " is removed"));
  return absl::OkStatus();
}

// Workers ----------------------------------------------------------------------------------------

void FarmSettings::move_worker(const std::string& worker_id, const std::string& pool,
                               std::function<void(absl::Status)> done) {
  pipeline_.post(
      [this, worker_id, pool, done = std::move(done)] { done(move_now(worker_id, pool)); });
}

absl::Status FarmSettings::move_now(const std::string& worker_id, const std::string& pool) {
  Settings rows;
  {
    FarmChange change(farm_);
    rows = change.scheduler().orders().placement().moved();
    if (change.scheduler().workers().find(worker_id) == nullptr && rows.count(worker_id) == 0) {
      return no_such_worker(worker_id);
    }
  }
  if (pool.empty()) {
    rows.erase(worker_id);
  } else {
    rows[worker_id] = pool;
  }
  absl::Status saved =
      pipeline_.write_and_tell([&] { return store_.settings().save(SettingKind::pool, rows); },
                               {0, 0, EventKind::worker_moved, "", "", worker_id,
                                pool.empty() ? "its own pool" : absl::StrCat("pool ", pool)});
  if (!saved.ok()) return saved;
  FarmChange change(farm_);
  change.scheduler().orders().move(worker_id, pool, change.now());
  const Worker* worker = change.scheduler().workers().find(worker_id);
  const std::string now_in = worker != nullptr ? worker->pool : pool;
  change.log(LogLevel::info, absl::StrCat("worker ", worker_id, " is in pool ", now_in));
  return absl::OkStatus();
}

void FarmSettings::set_aside(const std::string& worker_id, const std::string& reason,
                             std::function<void(absl::Status)> done) {
  pipeline_.post([this, worker_id, reason, done = std::move(done)] {
    done(set_aside_now(worker_id, reason));
  });
}

absl::Status FarmSettings::set_aside_now(const std::string& worker_id, const std::string& reason) {
  Settings rows;
  {
    FarmChange change(farm_);
    rows = change.scheduler().orders().placement().aside();
    if (change.scheduler().workers().find(worker_id) == nullptr && rows.count(worker_id) == 0) {
      return no_such_worker(worker_id);
    }
  }
  rows[worker_id] = reason;
  absl::Status saved =
      pipeline_.write_and_tell([&] { return store_.settings().save(SettingKind::aside, rows); },
                               {0, 0, EventKind::worker_set_aside, "", "", worker_id, reason});
  if (!saved.ok()) return saved;
  FarmChange change(farm_);
  change.scheduler().orders().set_aside(worker_id, reason, change.now());
  change.log(LogLevel::info, absl::StrCat("worker ", worker_id, " is set aside",
                                          reason.empty() ? "" : ": ", reason));
  return absl::OkStatus();
}

void FarmSettings::bring_back(const std::string& worker_id,
                              std::function<void(absl::Status)> done) {
  pipeline_.post([this, worker_id, done = std::move(done)] { done(bring_back_now(worker_id)); });
}

absl::Status FarmSettings::bring_back_now(const std::string& worker_id) {
  Settings rows;
  {
    FarmChange change(farm_);
    rows = change.scheduler().orders().placement().aside();
    if (rows.count(worker_id) == 0) {
      const bool is_known = change.scheduler().workers().find(worker_id) != nullptr;
      return is_known ? absl::OkStatus() : no_such_worker(worker_id);
    }
  }
  rows.erase(worker_id);
  absl::Status saved =
      pipeline_.write_and_tell([&] { return store_.settings().save(SettingKind::aside, rows); },
                               {0, 0, EventKind::worker_brought_back, "", "", worker_id, ""});
  if (!saved.ok()) return saved;
  FarmChange change(farm_);
  change.scheduler().orders().bring_back(worker_id, change.now());
  change.log(LogLevel::info, absl::StrCat("worker ", worker_id, " is back"));
  return absl::OkStatus();
}

}  // namespace tessera::server
