#include "tests/integration/server/fuzz/job_model.h"

#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

using grpc::StatusCode;

constexpr int kMaxClientPriority = 50;  // of RunningCoordinator

bool can_be_rendered(v1::Job::State state) {
  return state == v1::Job::STATE_QUEUED || state == v1::Job::STATE_RUNNING;
}

bool has_ended(v1::Job::State state) {
  return state == v1::Job::STATE_DONE || state == v1::Job::STATE_FAILED ||
         state == v1::Job::STATE_CANCELLED;
}

std::string describe(const std::string& id, const JobModel::Job& job) {
  return absl::StrCat(id, " of ", job.owner, ": ", v1::Job::State_Name(job.state), " priority ",
                      job.priority, ", ", job.sample_count, " samples, ", job.name);
}

JobModel::Job job_of(const v1::Job& message) {
  return {message.owner(), message.name(), message.state(), message.priority(),
          message.settings().sample_count()};
}

bool are_equal(const JobModel::Job& a, const JobModel::Job& b) {
  const bool same_state =
      a.state == b.state || (can_be_rendered(a.state) && can_be_rendered(b.state));
  return same_state && a.owner == b.owner && a.name == b.name && a.priority == b.priority &&
         a.sample_count == b.sample_count;
}

}  // namespace

const char* order_name(Order order) {
  switch (order) {
    case Order::pause:
      return "pause";
    case Order::resume:
      return "resume";
    case Order::cancel:
      return "cancel";
    case Order::retry:
      return "retry";
    case Order::remove:
      return "remove";
    case Order::extend:
      return "extend";
    case Order::raise_priority:
      return "raise priority of";
  }
  return "";
}

bool JobModel::sees(const Person& person, const std::string& id) const {
  const auto found = jobs_.find(id);
  return found != jobs_.end() && (person.is_admin || found->second.owner == person.name);
}

std::vector<std::string> JobModel::visible(const Person& person) const {
  std::vector<std::string> ids;
  for (const auto& [id, job] : jobs_) {
    if (sees(person, id)) ids.push_back(id);
  }
  return ids;
}

StatusCode JobModel::give(const Person& person, Order order, const std::string& id, int value) {
  if (!person.is_client && !person.is_admin) return StatusCode::PERMISSION_DENIED;
  if (!sees(person, id)) return StatusCode::NOT_FOUND;
  Job& job = jobs_.at(id);
  if (order != Order::remove) return apply(person, order, job, value);
  if (!has_ended(job.state)) return StatusCode::FAILED_PRECONDITION;
  jobs_.erase(id);
  return StatusCode::OK;
}

StatusCode JobModel::apply(const Person& person, Order order, Job& job, int value) {
  const bool is_ended = has_ended(job.state);
  const bool is_done = job.state == v1::Job::STATE_DONE;
  switch (order) {
    case Order::pause:
      if (is_ended) return StatusCode::FAILED_PRECONDITION;
      job.state = v1::Job::STATE_PAUSED;
      return StatusCode::OK;
    case Order::resume:
      if (is_ended) return StatusCode::FAILED_PRECONDITION;
      job.state = v1::Job::STATE_RUNNING;
      return StatusCode::OK;
    case Order::cancel:
      if (is_done || job.state == v1::Job::STATE_FAILED) return StatusCode::FAILED_PRECONDITION;
      job.state = v1::Job::STATE_CANCELLED;
      return StatusCode::OK;
    case Order::retry:
      if (is_done || job.state == v1::Job::STATE_PAUSED) return StatusCode::FAILED_PRECONDITION;
      if (is_ended) job.state = v1::Job::STATE_RUNNING;
      return StatusCode::OK;
    case Order::extend:
      if (is_done) return StatusCode::FAILED_PRECONDITION;
      if (value < job.sample_count) return StatusCode::INVALID_ARGUMENT;
      job.sample_count = value;
      return StatusCode::OK;
    case Order::raise_priority:
      if (value > 100) return StatusCode::INVALID_ARGUMENT;
      if (!person.is_admin && value > kMaxClientPriority) return StatusCode::PERMISSION_DENIED;
      if (is_done) return StatusCode::FAILED_PRECONDITION;
      job.priority = value;
      return StatusCode::OK;
    case Order::remove:
      break;
  }
  return StatusCode::UNKNOWN;
}

std::string JobModel::difference(const std::vector<v1::Job>& farm) const {
  std::string text;
  std::map<std::string, Job> found;
  for (const v1::Job& job : farm) found[job.id()] = job_of(job);
  for (const auto& [id, job] : jobs_) {
    const auto theirs = found.find(id);
    if (theirs == found.end()) {
      absl::StrAppend(&text, "missing: ", describe(id, job), "\n");
    } else if (!are_equal(job, theirs->second)) {
      absl::StrAppend(&text, "expected ", describe(id, job), "\nfound    ",
                      describe(id, theirs->second), "\n");
    }
  }
  for (const auto& [id, job] : found) {
    if (jobs_.count(id) == 0) absl::StrAppend(&text, "unexpected: ", describe(id, job), "\n");
  }
  return text;
}

std::string JobModel::take_over(const std::vector<v1::Job>& farm, const std::string& owner) {
  const auto is_theirs = [&](const auto& entry) {
    return owner.empty() || entry.second.owner == owner;
  };
  std::erase_if(jobs_, is_theirs);
  for (const v1::Job& job : farm) {
    if (owner.empty() || job.owner() == owner) jobs_[job.id()] = job_of(job);
  }
  return difference(farm);
}

}  // namespace tessera::server
