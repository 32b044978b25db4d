// Clients of the simulated server.
#include <algorithm>
#include <fstream>

#include "absl/strings/str_cat.h"
#include "tests/unit/server/simulation/simulated_server.h"
#include "tests/unit/server/simulation/small_jobs.h"

namespace tessera::server {
namespace {

constexpr std::size_t kMaxJobs = 8;

std::string read_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

}  // namespace

/// Called where the server answers; the answer is sent at the end of the step.
void SimulatedServer::answer(std::function<void()> arrive) {
  answers_.push_back({operation(), std::move(arrive)});
}

/// Sends a request about a job; `arrive` is called at the server with its number.
void SimulatedServer::call(ClientJob& job, std::function<void(int request)> arrive) {
  job.is_pending = true;
  job.is_alone = job.stray_count == 0;
  network_.send(now_, [this, &job, number = ++job.request, arrive = std::move(arrive)] {
    fairness_->note_change(small_job(job.kind, 8).owner);
    arrive(number);
  });
}

/// Returns whether the client waits for the answer to this request.
bool SimulatedServer::note_answer(ClientJob& job, int request) {
  const bool is_awaited = job.is_pending && job.request == request;
  if (is_awaited) {
    job.is_pending = false;
  } else {
    --job.stray_count;
  }
  return is_awaited;
}

void SimulatedServer::act_as_client() {
  const std::size_t max_jobs = is_shared_ ? kSharedKinds : kMaxJobs;
  if (jobs_.size() < max_jobs && dice_.one_in(is_shared_ ? 2 : 12)) {
    const std::string request_id = absl::StrCat("request", jobs_.size());
    ClientJob& job = jobs_[request_id];
    job.request_id = request_id;
    job.kind =
        is_shared_ ? kFirstSharedKind + static_cast<int>(jobs_.size()) - 1 : dice_.below(kJobKinds);
    job.sample_counts = {is_shared_ || dice_.one_in(2) ? 8 : 16};
  }
  for (auto& [request_id, job] : jobs_) {
    if (job.is_pending && dice_.one_in(15)) {  // its deadline passes
      ++events_.abandoned_requests;
      ++job.stray_count;
      job.is_pending = false;
    }
    if (job.is_pending || job.is_gone || (is_shared_ && !job.id.empty())) continue;
    if (job.id.empty() ? dice_.one_in(3) : dice_.one_in(25)) request(job);
  }
}

void SimulatedServer::request(ClientJob& job) {
  if (job.id.empty()) return create(job);
  using Change = JobAdmin::Change;
  switch (dice_.below(7)) {
    case 0:
      ++events_.pauses;
      return change(job, Change::pause);
    case 1:
      ++events_.cancels;
      return change(job, Change::cancel);
    case 2:
      ++events_.retries;
      return change(job, Change::retry);
    case 3:
      return extend(job);
    case 4:
      return dice_.one_in(2) ? remove(job) : create(job);
    default:
      return change(job, Change::resume);
  }
}

void SimulatedServer::upload(int kind) {
  if (coordinator_->assets().has_asset(scene_of(kind))) {
    uploaded_.insert(kind);
    return;
  }
  const auto note = [this, kind](const absl::Status& status) {
    if (status.ok()) answer([this, kind] { uploaded_.insert(kind); });
  };
  if (uses_rows_) {
    return coordinator_->assets().add_asset(scene_of(kind), scene_bytes(kind), note);
  }
  const auto path = coordinator_->assets().new_upload_path();
  if (!path.ok()) return;
  std::ofstream(*path, std::ios::binary) << scene_bytes(kind);
  coordinator_->assets().publish_asset(*path, scene_of(kind), note);
}

/// Creates the job, or repeats the request.
void SimulatedServer::create(ClientJob& job) {
  if (uploaded_.count(job.kind) == 0) return upload(job.kind);
  if (job.may_be_gone) return;  // it would create another one
  JobSpec spec = small_job(job.kind, *job.sample_counts.begin());
  spec.request_id = job.request_id;
  call(job, [this, &job, spec](int number) {
    coordinator_->admission().create_job(
        spec, [this, &job, number](const absl::StatusOr<JobAdmission::Created>& created) {
          const std::string id = created.ok() ? created->view.spec->id : "";
          answer([this, &job, number, id, status = created.status()] {
            note_answer(job, number);
            if (status.ok() && !job.id.empty() && id != job.id) violate("a job was created twice");
            if (status.ok()) job.id = id;
            trace(absl::StrCat("create ", job.request_id, ": ", id, " ", status.ToString()));
          });
        });
  });
}

void SimulatedServer::change(ClientJob& job, JobAdmin::Change what) {
  job.must_be.reset();
  job.is_uncertain = true;
  call(job, [this, &job, what](int number) {
    trace(absl::StrCat("change ", static_cast<int>(what), " of ", job.id));
    coordinator_->jobs().change_job(job.id, what, [this, &job, number, what](const auto& view) {
      answer([this, &job, number, what, is_ok = view.ok()] {
        trace(absl::StrCat("change ", static_cast<int>(what), " of ", job.id, ": ",
                           is_ok ? "done" : "refused"));
        if (!note_answer(job, number) || !is_ok || !job.is_alone) return;
        job.is_uncertain = false;
        // Units that were leased before the pause may have completed the job before this answer.
        if (what == JobAdmin::Change::pause && !job.is_done) job.must_be = JobState::paused;
        if (what == JobAdmin::Change::cancel) job.must_be = JobState::cancelled;
      });
    });
  });
}

void SimulatedServer::extend(ClientJob& job) {
  const int before = *job.sample_counts.rbegin();
  const int after = std::min(before * 4, 128);
  job.is_extended = true;
  job.sample_counts.insert(after);
  JobAdmin::Extension extension;
  extension.spp = after;
  call(job, [this, &job, extension, after](int number) {
    trace(absl::StrCat("extend ", job.id));
    coordinator_->jobs().extend_job(job.id, extension,
                                    [this, &job, number, after](const auto& view) {
                                      answer([this, &job, number, after, is_ok = view.ok()] {
                                        // If it is refused, whether an earlier attempt was carried
                                        // out is not known.
                                        if (!note_answer(job, number) || !is_ok || !job.is_alone)
                                          return;
                                        ++events_.extensions;
                                        job.sample_counts = {after};
                                      });
                                    });
  });
}

void SimulatedServer::remove(ClientJob& job) {
  if (job.stray_count > 0) return;  // one of them may create the job again
  const bool may_have_been_gone = job.may_be_gone;
  job.may_be_gone = true;
  call(job, [this, &job, may_have_been_gone](int number) {
    trace(absl::StrCat("remove ", job.id));
    const auto done = [this, &job, number, may_have_been_gone](const auto& status) {
      answer([this, &job, number, may_have_been_gone, code = status.code()] {
        const bool is_awaited = note_answer(job, number);
        const bool is_gone = code == absl::StatusCode::kOk || code == absl::StatusCode::kNotFound;
        if (code == absl::StatusCode::kNotFound && !may_have_been_gone) violate("a job is lost");
        if (is_gone) ++events_.removals;
        if (is_gone) job.is_gone = true;
        if (is_awaited) job.may_be_gone = job.is_gone || may_have_been_gone;
      });
    };
    coordinator_->jobs().remove_job(job.id, done);
  });
}

/// Requests what each job still needs to be done.
void SimulatedServer::finish_requests() {
  for (auto& [request_id, job] : jobs_) {
    if (job.is_pending || job.is_gone) continue;
    if (job.id.empty()) {
      create(job);
      continue;
    }
    const auto view = coordinator_->queries().job(job.id);
    if (!view.ok()) {
      job.is_gone = job.may_be_gone;
      continue;
    }
    if (view->state == JobState::paused) change(job, JobAdmin::Change::resume);
    if (view->state == JobState::cancelled) change(job, JobAdmin::Change::retry);
  }
}

bool SimulatedServer::is_over() const {
  return std::all_of(jobs_.begin(), jobs_.end(), [this](const auto& entry) {
    const ClientJob& job = entry.second;
    if (job.is_gone) return true;
    if (job.id.empty() || job.is_pending) return false;
    const auto view = coordinator_->queries().job(job.id);
    return view.ok() && view->state == JobState::done;
  });
}

/// Compares a job with what its client was told.
void SimulatedServer::check_job(ClientJob& job) {
  if (job.id.empty()) return;
  const auto view = coordinator_->queries().job(job.id);
  if (job.is_gone && view.ok()) violate(absl::StrCat("removed job ", job.id, " is back"));
  if (!view.ok() && !job.may_be_gone) violate(absl::StrCat("job ", job.id, " is lost"));
  if (!view.ok()) return;
  const std::string is = absl::StrCat("job ", job.id, " is ", state_name(view->state));
  if (job.sample_counts.count(view->spec->settings.spp) == 0) {
    violate(absl::StrCat("job ", job.id, " has ", view->spec->settings.spp, " samples per pixel"));
  }
  if (view->state == JobState::failed) violate(absl::StrCat(is, ": ", view->reason));
  if (job.is_done && view->state != JobState::done) violate(is + " and was done");
  // Units that were leased before the pause may complete the job.
  const bool is_completed =
      job.must_be == JobState::paused && view->state == JobState::done && !job.is_done;
  if (job.must_be && view->state != *job.must_be && !is_completed) {
    violate(absl::StrCat(is, " and was ", state_name(*job.must_be)));
  }
  if (is_completed) job.must_be.reset();
  job.is_done = view->state == JobState::done;
}

std::vector<std::string> SimulatedServer::pixels_of(const std::string& job_id) {
  std::vector<std::string> pixels;
  const auto frames = store_->frames().list(job_id);
  const auto folder = store_->frames().output_folder(job_id);
  if (!frames.ok() || !folder.ok()) return {};
  for (const FrameRecord& frame : *frames) {
    const auto image = store_->frames().row_image(job_id, frame.frame);
    if (!image.ok()) return {};
    const std::string bytes =
        image->has_value() ? **image : read_file(absl::StrCat(*folder, "/", frame.file));
    const bool is_intact = contract::sha256(bytes) == frame.file_sha256;
    pixels.push_back(is_intact ? frame.pixels_sha256.hex() : "damaged");
  }
  return pixels;
}

/// Returns what is wrong with a job that is done.
/// Returns whether the job's report says that this frame may contain units of a faulty worker. This
/// happens to a frame that is finished while no other worker is there to audit it.
bool SimulatedServer::is_doubted(const std::string& job_id, int frame) {
  const std::vector<std::string> warnings = coordinator_->queries().report(job_id)->warnings;
  return std::any_of(warnings.begin(), warnings.end(), [&](const std::string& warning) {
    return warning.starts_with(absl::StrCat("frame ", frame, " may contain wrong pixels"));
  });
}

std::string SimulatedServer::check_done(ClientJob& job) {
  const auto view = coordinator_->queries().job(job.id);
  const std::string name = absl::StrCat("job ", job.id, " of kind ", job.kind);
  if (view->committed_unit_count != view->unit_count) return name + " lacks units";
  const double seconds = kUnitSeconds * static_cast<double>(view->unit_count);
  if (!job.is_extended && !is_audited_ && view->cpu_seconds != seconds) {
    return absl::StrCat(name, " has ", view->cpu_seconds, " CPU seconds instead of ", seconds);
  }
  const int sample_count = view->spec->settings.spp;
  const std::vector<std::string> is = pixels_of(job.id);
  const std::vector<std::string> expected = undisturbed_pixels(job.kind, sample_count);
  if (is.size() != expected.size()) return absl::StrCat(name, " has ", is.size(), " frames");
  for (std::size_t i = 0; i < is.size(); ++i) {
    if (is[i] == expected[i]) continue;
    if (is_doubted(job.id, static_cast<int>(i) + 1)) {
      ++events_.doubted_frames;
      continue;
    }
    return absl::StrCat("frame ", i + 1, " of ", name, " with ", sample_count,
                        " samples per pixel has other pixels");
  }
  return "";
}

}  // namespace tessera::server
