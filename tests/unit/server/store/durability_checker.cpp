#include "tests/unit/server/store/durability_checker.h"

#include <algorithm>
#include <climits>
#include <fstream>
#include <iterator>
#include <optional>
#include <set>
#include <utility>

namespace tessera::server {
namespace {

std::string name(const contract::Unit& unit) {
  return "(" + std::to_string(unit.frame) + ", " + std::to_string(unit.tile) + ", " +
         std::to_string(unit.pass) + ")";
}

std::optional<UnitRecord> find_unit(Store& store, const std::string& job_id, contract::Unit unit) {
  std::optional<UnitRecord> found;
  const absl::Status status = store.units().for_each(job_id, [&](const UnitRecord& record) {
    if (record.unit == unit) found = record;
  });
  return status.ok() ? found : std::nullopt;
}

std::vector<JobRecord> all_jobs(Store& store) {
  auto jobs = store.jobs().list();
  return jobs.ok() ? *std::move(jobs) : std::vector<JobRecord>();
}

std::string check_units(Store& store, const std::string& job_id) {
  std::vector<UnitRecord> records;
  const absl::Status status =
      store.units().for_each(job_id, [&](const UnitRecord& record) { records.push_back(record); });
  if (!status.ok()) return status.ToString();
  for (const UnitRecord& record : records) {
    const auto block = store.units().read_block(job_id, record);
    if (!block.ok() && !absl::IsNotFound(block.status())) return block.status().ToString();
  }
  return "";
}

std::string check_frames(Store& store, const std::string& job_id) {
  const auto frames = store.frames().list(job_id);
  const auto folder = store.frames().output_folder(job_id);
  if (!frames.ok() || !folder.ok()) return "frames of " + job_id + " cannot be listed";
  for (const FrameRecord& frame : *frames) {
    if (contract::sha256(read_file(*folder + "/" + frame.file)) != frame.file_sha256) {
      return "frame " + frame.file + " of " + job_id + " has a row but not its bytes";
    }
  }
  return "";
}

}  // namespace

std::string read_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::string read_asset(Store& store, const contract::Digest& digest) {
  const auto asset = store.assets().open(digest);
  if (!asset.ok()) return "";
  std::string bytes(static_cast<std::size_t>(asset->size()), '\0');
  return asset->read_at(0, bytes).ok() ? bytes : "";
}

std::string asset_file(const std::string& folder, const contract::Digest& digest) {
  const std::string hex = digest.hex();
  return folder + "/assets/" + hex.substr(0, 2) + "/" + hex.substr(2);
}

void DurabilityChecker::make(const std::string& key, int step, Test test) {
  confirmations_.push_back({key, step, INT_MAX, std::move(test)});
}

void DurabilityChecker::end(const std::string& key, int step) {
  for (Confirmation& confirmation : confirmations_) {
    if (confirmation.key == key) confirmation.until = std::min(confirmation.until, step);
  }
}

void DurabilityChecker::end_all(const std::string& prefix, int step) {
  for (Confirmation& confirmation : confirmations_) {
    if (confirmation.key.compare(0, prefix.size(), prefix) == 0) {
      confirmation.until = std::min(confirmation.until, step);
    }
  }
}

std::string DurabilityChecker::check(Store& store, int step) const {
  for (const Confirmation& confirmation : confirmations_) {
    if (step < confirmation.from || step > confirmation.until) continue;
    const std::string wrong = confirmation.test(store);
    if (!wrong.empty()) return confirmation.key + ": " + wrong;
  }
  return "";
}

std::vector<int> DurabilityChecker::steps() const {
  std::set<int> steps;
  for (const Confirmation& confirmation : confirmations_) steps.insert(confirmation.from);
  return {steps.begin(), steps.end()};
}

Commit make_commit(const std::string& job_id, contract::Unit unit, std::string bytes) {
  Commit commit;
  commit.job_id = job_id;
  commit.record.unit = unit;
  commit.record.sha256 = contract::sha256(bytes);
  commit.record.worker_id = "worker";
  commit.record.cpu_seconds = 0.25;
  commit.block = std::move(bytes);
  return commit;
}

DurabilityChecker::Test has_job(const JobRecord& job) {
  return [job](Store& store) -> std::string {
    for (const JobRecord& found : all_jobs(store)) {
      if (found.id != job.id) continue;
      const bool same = found.sequence == job.sequence && found.request_id == job.request_id &&
                        found.request == job.request && found.state == job.state &&
                        found.reason == job.reason && found.wall_seconds == job.wall_seconds &&
                        found.render_contract == job.render_contract &&
                        found.failure_code == job.failure_code;
      return same ? "" : "is not as it was acknowledged";
    }
    return "is lost";
  };
}

DurabilityChecker::Test id_is_taken(const std::string& job_id) {
  return [job_id](Store& store) -> std::string {
    JobRecord again;
    again.id = job_id;
    const absl::Status status = store.jobs().add(again);
    return absl::IsAlreadyExists(status) ? "" : "was given out again: " + status.ToString();
  };
}

DurabilityChecker::Test has_unit(const std::string& job_id, contract::Unit unit,
                                 std::string bytes) {
  return [job_id, unit, bytes = std::move(bytes)](Store& store) -> std::string {
    const auto record = find_unit(store, job_id, unit);
    if (!record.has_value()) return "is lost";
    if (record->worker_id != "worker" || record->cpu_seconds != 0.25) return "has other figures";
    const auto block = store.units().read_block(job_id, *record);
    if (!block.ok()) return block.status().ToString();
    return *block == bytes ? "" : "has other bytes";
  };
}

DurabilityChecker::Test counts_units(const std::string& job_id, std::int64_t units) {
  return [job_id, units](Store& store) -> std::string {
    std::int64_t count = 0;
    double cpu_seconds = 0;
    const absl::Status status = store.units().for_each(job_id, [&](const UnitRecord& unit) {
      ++count;
      cpu_seconds += unit.cpu_seconds;
    });
    const auto totals = store.units().totals(job_id);
    if (!status.ok() || !totals.ok()) return "cannot be read";
    for (const UnitTotals& total : *totals) {
      count += total.units;
      cpu_seconds += total.cpu_seconds;
    }
    const auto account = store.usage().read({.by_job = true}, 1000);
    if (!account.ok()) return account.status().ToString();
    std::int64_t charged = 0;
    for (const UsageSum& sum : *account) charged += sum.job_id == job_id ? sum.units : 0;
    if (charged != units) {
      return std::to_string(charged) + " units are charged, not " + std::to_string(units);
    }
    if (count != units)
      return "is " + std::to_string(count) + " units, was " + std::to_string(units);
    return cpu_seconds == 0.25 * static_cast<double>(count) ? "" : "has other figures";
  };
}

DurabilityChecker::Test worker_has_joined(const std::string& worker_id) {
  return [worker_id](Store& store) -> std::string {
    const absl::Status status = store.workers().record_join({worker_id, "token", "thief"}, 0);
    return absl::IsPermissionDenied(status) ? "" : "is forgotten: " + status.ToString();
  };
}

DurabilityChecker::Test has_frame(const std::string& job_id, const FrameRecord& frame,
                                  std::string bytes) {
  return [job_id, frame, bytes = std::move(bytes)](Store& store) -> std::string {
    const auto frames = store.frames().list(job_id);
    const auto folder = store.frames().output_folder(job_id);
    if (!frames.ok() || !folder.ok()) return "cannot be listed";
    for (const FrameRecord& found : *frames) {
      if (found.frame != frame.frame) continue;
      if (found.file != frame.file || found.pixels_sha256 != frame.pixels_sha256 ||
          found.statistics_json != frame.statistics_json) {
        return "is not as it was acknowledged";
      }
      return read_file(*folder + "/" + found.file) == bytes ? "" : "has other bytes";
    }
    return "is lost";
  };
}

DurabilityChecker::Test has_asset(std::string bytes) {
  return [bytes = std::move(bytes)](Store& store) -> std::string {
    const contract::Digest digest = contract::sha256(bytes);
    if (!store.assets().has(digest)) return "is lost";
    return read_asset(store, digest) == bytes ? "" : "has other bytes";
  };
}

DurabilityChecker::Test worker_is_known(const std::string& worker_id) {
  return [worker_id](Store& store) -> std::string {
    const auto roster = store.workers().roster();
    if (!roster.ok()) return roster.status().ToString();
    return std::count(roster->begin(), roster->end(), worker_id) == 1 ? "" : "is forgotten";
  };
}

DurabilityChecker::Test booted_before(std::int64_t boot_count, const std::string& id,
                                      const std::string& key) {
  return [=](Store& store) -> std::string {
    if (store.id() != id || store.key() != key) return "this is another store";
    return store.boot_count() > boot_count ? "" : "a boot count came twice";
  };
}

DurabilityChecker::Test sequence_was_used(std::int64_t sequence) {
  return [sequence](Store& store) -> std::string {
    JobRecord next;
    next.id = "next-" + std::to_string(sequence);
    if (absl::Status status = store.jobs().add(next); !status.ok()) return status.ToString();
    return next.sequence > sequence ? "" : "sequence " + std::to_string(sequence) + " came twice";
  };
}

std::string check_store(Store& store, const std::string& folder,
                        const std::vector<std::string>& asset_bytes) {
  std::int64_t sequence = 0;
  for (const JobRecord& job : all_jobs(store)) {
    if (job.sequence <= sequence) return "jobs are out of order";
    sequence = job.sequence;
    if (std::string wrong = check_units(store, job.id); !wrong.empty()) return wrong;
    if (std::string wrong = check_frames(store, job.id); !wrong.empty()) return wrong;
  }
  for (const std::string& bytes : asset_bytes) {
    const contract::Digest digest = contract::sha256(bytes);
    const bool is_whole = store.assets().has(digest)
                              ? read_asset(store, digest) == bytes
                              : read_file(asset_file(folder, digest)).empty();
    if (!is_whole) {
      return "asset " + digest.hex() + " is not whole";
    }
  }
  return "";
}

std::vector<std::string> facts(Store& store) {
  std::vector<std::string> lines = {"id " + store.id()};
  for (const JobRecord& job : all_jobs(store)) {
    lines.push_back("job " + job.id + " " + std::to_string(job.sequence) + " " +
                    std::to_string(job.state) + " " + job.reason);
    const absl::Status status = store.units().for_each(job.id, [&](const UnitRecord& unit) {
      lines.push_back("unit " + job.id + name(unit.unit) + unit.sha256.hex());
    });
    if (!status.ok()) lines.push_back(status.ToString());
    const auto totals = store.units().totals(job.id);
    if (!totals.ok()) continue;
    for (const UnitTotals& total : *totals) {
      lines.push_back("totals " + job.id + " " + total.worker_id + std::to_string(total.units));
    }
    const auto frames = store.frames().list(job.id);
    if (!frames.ok()) continue;
    for (const FrameRecord& frame : *frames) {
      lines.push_back("frame " + job.id + " " + frame.file + " " + frame.file_sha256.hex());
    }
  }
  const auto account = store.usage().read({.by_owner = true, .by_job = true}, 1000);
  if (account.ok()) {
    for (const UsageSum& sum : *account) {
      lines.push_back("used " + sum.owner + " " + sum.job_id + " " + std::to_string(sum.units));
    }
  }
  const auto events = store.events().newest(1000);
  if (events.ok()) {
    for (const Event& event : *events) {
      lines.push_back("event " + std::to_string(event.sequence) + " " + event.text);
    }
  }
  const auto roster = store.workers().roster();
  if (roster.ok()) lines.insert(lines.end(), roster->begin(), roster->end());
  return lines;
}

}  // namespace tessera::server
