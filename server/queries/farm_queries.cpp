#include "server/queries/farm_queries.h"

#include <iterator>
#include <map>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

constexpr std::size_t kMaxMatches = 16;  // named in a message

absl::Status no_such_job(const std::string& text) {
  return absl::NotFoundError(absl::StrCat("no job \"", text, "\""));
}

/// Returns whether `job` belongs to `owner`; an empty `owner` stands for all owners.
bool is_visible_to(const Job& job, const std::string& owner) {
  return owner.empty() || job.spec->owner == owner;
}

/// Returns the newest of the owner's jobs, or 0.
JobKey newest(const FarmView& farm, const std::string& owner) {
  if (owner.empty()) {
    const auto& jobs = farm.scheduler().jobs().all();
    return jobs.empty() ? 0 : jobs.rbegin()->first;
  }
  const std::set<JobKey>& theirs = farm.index().of_owner(owner);
  return theirs.empty() ? 0 : *theirs.rbegin();
}

/// Returns whether `value` is among `wanted`; an empty set stands for all values.
template <typename T>
bool is_among(const std::set<T>& wanted, const T& value) {
  return wanted.empty() || wanted.count(value) > 0;
}

bool matches(const JobFilter& filter, const Job& job) {
  const JobSpec& spec = *job.spec;
  return is_visible_to(job, filter.visible_owner) && is_among(filter.owners, spec.owner) &&
         is_among(filter.states, job.state) && is_among(filter.projects, spec.project) &&
         is_among(filter.pools, spec.pool.empty() ? kDefaultPool : spec.pool);
}

/// Returns the owner of all jobs that can match, whose jobs the index finds; empty: several may.
std::string single_owner(const JobFilter& filter) {
  if (!filter.visible_owner.empty()) return filter.visible_owner;
  return filter.owners.size() == 1 ? *filter.owners.begin() : "";
}

absl::Status ambiguous(const FarmView& farm, const std::string& text,
                       const std::vector<JobKey>& matches) {
  std::string message = absl::StrCat("\"", text, "\" matches several jobs:");
  for (const JobKey key : matches) {
    absl::StrAppend(&message, " ", farm.scheduler().jobs().at(key).spec->id);
  }
  if (matches.size() == kMaxMatches) absl::StrAppend(&message, " ...");
  return absl::InvalidArgumentError(message);
}

}  // namespace

absl::StatusOr<JobView> FarmQueries::job(const std::string& job_id) const {
  const FarmView view(parts_.farm);
  const Job* job = view.find_job(job_id);
  if (job == nullptr) return no_such_job(job_id);
  return view.view(*job);
}

absl::Status FarmQueries::check_owner(const std::string& job_id, const std::string& owner) const {
  const FarmView view(parts_.farm);
  const Job* job = view.find_job(job_id);
  return job != nullptr && is_visible_to(*job, owner) ? absl::OkStatus() : no_such_job(job_id);
}

absl::StatusOr<JobView> FarmQueries::find_job(const std::string& text,
                                              const std::string& owner) const {
  if (text.empty()) return no_such_job(text);
  const FarmView view(parts_.farm);
  const auto& jobs = view.scheduler().jobs().all();
  JobKey key = text == "last" ? newest(view, owner) : view.index().with_id(text);
  if (key != 0 && !is_visible_to(jobs.at(key), owner)) key = 0;
  if (key == 0) {
    const std::vector<JobKey> matches = view.index().with_prefix(text, owner, kMaxMatches);
    key = matches.size() == 1 ? matches.front() : view.index().newest_named(text, owner);
    if (key == 0 && matches.size() > 1) return ambiguous(view, text, matches);
  }
  if (key == 0) return no_such_job(text);
  return view.view(jobs.at(key));
}

JobPage FarmQueries::list_jobs(JobKey before, std::int32_t limit, const JobFilter& filter) const {
  const FarmView view(parts_.farm);
  const auto& jobs = view.scheduler().jobs().all();
  JobPage page;
  const auto list = [&](const auto& keys, const auto& job_of) {
    auto it = before > 0 ? std::make_reverse_iterator(keys.lower_bound(before)) : keys.rbegin();
    for (std::int32_t visited = 0; it != keys.rend(); ++it, ++visited) {
      if (visited == kMaxVisitedJobs || static_cast<std::int32_t>(page.jobs.size()) == limit) {
        page.before = job_of(*std::prev(it)).key;
        return;
      }
      const Job& job = job_of(*it);
      if (matches(filter, job)) page.jobs.push_back(view.view(job));
    }
  };
  const std::string owner = single_owner(filter);
  if (owner.empty()) {
    list(jobs, [](const auto& entry) -> const Job& { return entry.second; });
  } else {
    list(view.index().of_owner(owner), [&](JobKey key) -> const Job& { return jobs.at(key); });
  }
  return page;
}

std::shared_ptr<const JobSpec> FarmQueries::describe_job(const std::string& job_id,
                                                         const std::string& certificate) const {
  const FarmView view(parts_.farm);
  const Job* job = view.find_job(job_id);
  if (job == nullptr) return nullptr;
  const auto is_this = [key = job->key](JobKey leased) { return leased == key; };
  if (certificate.empty() || view.scheduler().workers().has_leased(certificate, is_this)) {
    return job->spec;
  }
  return nullptr;
}

absl::StatusOr<JobReport> FarmQueries::report(const std::string& job_id) const {
  JobReport report;
  std::map<std::int32_t, FrameRecord> finished;
  {
    const FarmView view(parts_.farm);
    const Job* job = view.find_job(job_id);
    if (job == nullptr) return no_such_job(job_id);
    report.view = view.view(*job);
    report.counters = job->counters;
    report.contributions = job->contributions;
    report.warnings = view.film(*job).warnings;
    for (const auto& [key, worker] : view.scheduler().workers().all()) {
      if (report.contributions.count(worker.id) == 0) continue;
      report.machines[worker.id] = {worker.isa, worker.thread_count};
    }
    finished = view.film(*job).finished;
  }
  const auto frames = parts_.store.frames().list(job_id);
  if (!frames.ok()) return frames.status();
  for (const FrameRecord& frame : *frames) {
    // Frames that were finished under other settings or just now are not in this report.
    if (finished.count(frame.frame) > 0) report.frames.push_back(frame);
  }
  return report;
}

std::map<std::string, OwnerUse> FarmQueries::quota_use(const std::set<std::string>& clients) const {
  std::map<std::string, OwnerUse> uses;
  {
    const FarmView view(parts_.farm);
    for (const std::string& client : clients) uses[client] = view.owner_use(client);
    for (const std::string& owner : view.index().owners()) uses[owner] = view.owner_use(owner);
  }
  for (auto& [client, use] : uses) {
    use.kept_bytes += static_cast<double>(parts_.asset_bytes(client));
  }
  return uses;
}

absl::StatusOr<std::vector<Delivery>> FarmQueries::deliveries(const std::string& job_id,
                                                              std::int64_t after,
                                                              std::size_t limit) const {
  JobKey key = 0;
  {
    const FarmView view(parts_.farm);
    const Job* job = view.find_job(job_id);
    if (job == nullptr) return no_such_job(job_id);
    key = job->key;
  }
  return parts_.deliveries.read(key, after, limit);
}

}  // namespace tessera::server
