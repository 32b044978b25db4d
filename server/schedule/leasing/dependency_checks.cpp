#include "server/schedule/leasing/dependency_checks.h"

#include <algorithm>

#include "absl/strings/str_cat.h"

namespace tessera::server {

namespace {

constexpr auto kFrames = Dependency::Kind::frames;

bool has_frame_dependency(const JobSpec& spec) {
  return std::any_of(spec.after.begin(), spec.after.end(),
                     [](const Dependency& dependency) { return dependency.kind == kFrames; });
}

}  // namespace

DependencyState DependencyChecks::state_of(const Dependency& dependency) const {
  if (const Job* other = jobs_.find(dependency.job_id)) {
    if (other->spec->is_unreadable) return DependencyState::waiting;  // how it ended is not known
    return server::state_of(dependency.kind, other->state, false);
  }
  const auto removed = dependencies_.removed_state(dependency.job_id);
  if (!removed) return DependencyState::waiting;
  return server::state_of(dependency.kind, *removed, true);
}

bool DependencyChecks::is_frame_blocked(const Job& job, std::int32_t frame) const {
  return std::any_of(job.spec->after.begin(), job.spec->after.end(),
                     [&](const Dependency& dependency) {
                       if (dependency.kind != kFrames) return false;
                       const Job* other = jobs_.find(dependency.job_id);
                       if (other == nullptr || other->spec->is_unreadable) {
                         return state_of(dependency) != DependencyState::met;
                       }
                       if (other->state == JobState::done) return false;
                       return !other->plan || !other->plan->is_finished(frame);
                     });
}

void DependencyChecks::check_dependencies(Job& job) {
  job.is_blocked = std::any_of(
      job.spec->after.begin(), job.spec->after.end(),
      [this](const Dependency& each) { return state_of(each) != DependencyState::met; });
  if (!has_frame_dependency(*job.spec)) {
    const std::set<std::int32_t> blocked = job.blocked_frames;
    for (const std::int32_t frame : blocked) job.block_frame(frame, false);
    return;
  }
  for (const std::int32_t frame : contract::frame_list(job.spec->settings.frames)) {
    const bool is_blocked = is_frame_blocked(job, frame);
    if (is_blocked != (job.blocked_frames.count(frame) > 0)) job.block_frame(frame, is_blocked);
  }
}

void DependencyChecks::check_dependents(const Job& job) {
  for (const JobKey key : dependencies_.dependents(job.spec->id)) {
    Job& dependent = jobs_.at(key);
    check_dependencies(dependent);
    ready_.refresh(dependent);
  }
}

void DependencyChecks::check_dependents(const Job& job, std::int32_t frame) {
  for (const JobKey key : dependencies_.dependents(job.spec->id)) {
    Job& dependent = jobs_.at(key);
    if (dependent.blocked_frames.count(frame) == 0 || is_frame_blocked(dependent, frame)) continue;
    dependent.block_frame(frame, false);
    ready_.refresh(dependent);
  }
}

absl::Status DependencyChecks::check_possible(const Job& job) const {
  for (const Dependency& dependency : job.spec->after) {
    if (state_of(dependency) != DependencyState::impossible) continue;
    return absl::FailedPreconditionError(absl::StrCat(
        "job ", dependency.job_id, ", which had to be done before job ", job.spec->id,
        ", was removed; `tessera set ", job.spec->id, " --no-after` drops the dependency, then `",
        "tessera retry ", job.spec->id, "` starts the job"));
  }
  return absl::OkStatus();
}

std::string DependencyChecks::dependency_text(const Job& job) const {
  for (const Dependency& dependency : job.spec->after) {
    const Job* other = jobs_.find(dependency.job_id);
    const bool is_frames = dependency.kind == kFrames;
    if (is_frames ? job.blocked_frames.empty() : state_of(dependency) == DependencyState::met) {
      continue;
    }
    const std::string name = absl::StrCat("job ", dependency.job_id);
    if (other == nullptr || other->spec->is_unreadable) {
      return absl::StrCat("waits for ", name, ", which the server cannot read");
    }
    if (is_frames && other->state == JobState::done) continue;  // other frames wait for another job
    if (has_ended(other->state)) {
      return absl::StrCat("waits for ", name, ", which is ", state_name(other->state),
                          ": `tessera retry ", dependency.job_id, "` resumes it, `tessera set ",
                          job.spec->id, " --no-after` drops the dependency");
    }
    const char* progress = is_frames                                  ? "to finish frames"
                           : dependency.kind == Dependency::Kind::end ? "to end"
                                                                      : "to be done";
    return absl::StrCat("waits for ", name, " ", progress, "; it is ", state_name(other->state));
  }
  return "";
}

}  // namespace tessera::server
