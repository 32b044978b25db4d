#include "tests/integration/client/fake_farm.h"

#include <grpcpp/server_builder.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdlib>

#include "client/commands/commands.h"
#include "contract/digest.h"
#include "rpc/settings_message.h"

namespace tessera::client {
namespace {

grpc::Status not_found(const std::string& id) {
  return {grpc::StatusCode::NOT_FOUND, "no job \"" + id + "\""};
}

}  // namespace

class FakeFarm::Workers final : public v1::WorkerService::Service {
 public:
  explicit Workers(const std::vector<v1::Worker>& workers) : workers_(workers) {}

 private:
  /// One worker per page; the token is an index.
  grpc::Status ListWorkers(grpc::ServerContext*, const v1::ListWorkersRequest* request,
                           v1::ListWorkersResponse* response) override {
    const std::string& token = request->page_token();
    const std::size_t index = token.empty() ? 0 : std::stoul(token);
    if (index < workers_.size()) *response->add_workers() = workers_[index];
    if (index + 1 < workers_.size()) response->set_next_page_token(std::to_string(index + 1));
    return grpc::Status::OK;
  }

  const std::vector<v1::Worker>& workers_;
};

FakeFarm::FakeFarm() {
  std::string pattern = (std::filesystem::temp_directory_path() / "tessera_farm_XXXXXX").string();
  folder_ = ::mkdtemp(pattern.data());
  worker_service_ = std::make_unique<Workers>(workers);
  grpc::ServerBuilder builder;
  builder.AddListeningPort(address(), grpc::InsecureServerCredentials());
  builder.RegisterService(static_cast<v1::JobService::Service*>(this));
  builder.RegisterService(worker_service_.get());
  server_ = builder.BuildAndStart();
  EXPECT_NE(server_, nullptr);
}

FakeFarm::~FakeFarm() {
  if (server_ != nullptr) server_->Shutdown();
  std::error_code ignored;
  std::filesystem::remove_all(folder_, ignored);
}

v1::Job& FakeFarm::add_job(const std::string& id, const std::string& name, v1::Job::State state) {
  v1::Job job;
  job.set_id(id);
  job.set_name(name);
  job.set_owner("local");
  job.set_state(state);
  job.mutable_create_time()->set_seconds(1'700'000'000);
  *job.mutable_settings() = contract::to_message(contract::RenderSettings{});
  v1::JobProgress& progress = *job.mutable_progress();
  progress.set_unit_count(200);
  progress.set_committed_unit_count(50);
  progress.set_frame_count(1);
  progress.set_sample_count(6400);
  progress.set_committed_sample_count(1600);
  progress.set_cpu_seconds(12.5);
  progress.set_estimated_error(0.0425);
  jobs.push_back(job);
  return jobs.back();
}

v1::Job* FakeFarm::find(const std::string& id) {
  if (id == "last") return jobs.empty() ? nullptr : &jobs.back();
  const auto found = std::find_if(jobs.begin(), jobs.end(), [&id](const v1::Job& job) {
    return job.id() == id || job.name() == id;
  });
  return found == jobs.end() ? nullptr : &*found;
}

grpc::Status FakeFarm::change(const std::string& id, v1::Job::State state, v1::Job* reply) {
  const std::lock_guard lock(mutex_);
  v1::Job* job = find(id);
  if (job == nullptr) return not_found(id);
  if (job->state() == v1::Job::STATE_DONE) {
    return {grpc::StatusCode::FAILED_PRECONDITION, "the job is done"};
  }
  job->set_state(state);
  *reply = *job;
  return grpc::Status::OK;
}

grpc::Status FakeFarm::GetJob(grpc::ServerContext*, const v1::GetJobRequest* request,
                              v1::GetJobResponse* response) {
  const std::lock_guard lock(mutex_);
  const v1::Job* job = find(request->job());
  if (job == nullptr) return not_found(request->job());
  *response->mutable_job() = *job;
  return grpc::Status::OK;
}

grpc::Status FakeFarm::ListJobs(grpc::ServerContext*, const v1::ListJobsRequest* request,
                                v1::ListJobsResponse* response) {
  const std::lock_guard lock(mutex_);
  std::size_t next = request->page_token().empty() ? 0 : std::stoul(request->page_token());
  const auto size = static_cast<std::size_t>(request->page_size());
  for (; next < jobs.size() && static_cast<std::size_t>(response->jobs_size()) < size; ++next) {
    *response->add_jobs() = jobs[jobs.size() - 1 - next];
  }
  if (next < jobs.size()) response->set_next_page_token(std::to_string(next));
  return grpc::Status::OK;
}

grpc::Status FakeFarm::PauseJob(grpc::ServerContext*, const v1::PauseJobRequest* request,
                                v1::PauseJobResponse* response) {
  return change(request->job_id(), v1::Job::STATE_PAUSED, response->mutable_job());
}

grpc::Status FakeFarm::ResumeJob(grpc::ServerContext*, const v1::ResumeJobRequest* request,
                                 v1::ResumeJobResponse* response) {
  return change(request->job_id(), v1::Job::STATE_RUNNING, response->mutable_job());
}

grpc::Status FakeFarm::CancelJob(grpc::ServerContext*, const v1::CancelJobRequest* request,
                                 v1::CancelJobResponse* response) {
  return change(request->job_id(), v1::Job::STATE_CANCELLED, response->mutable_job());
}

grpc::Status FakeFarm::RetryJob(grpc::ServerContext*, const v1::RetryJobRequest* request,
                                v1::RetryJobResponse* response) {
  return change(request->job_id(), v1::Job::STATE_QUEUED, response->mutable_job());
}

grpc::Status FakeFarm::RemoveJob(grpc::ServerContext*, const v1::RemoveJobRequest* request,
                                 v1::RemoveJobResponse*) {
  const std::lock_guard lock(mutex_);
  const v1::Job* job = find(request->job_id());
  if (job == nullptr) return not_found(request->job_id());
  if (job->state() == v1::Job::STATE_RUNNING) {
    return {grpc::StatusCode::FAILED_PRECONDITION, "the job has not ended; cancel it first"};
  }
  jobs.erase(jobs.begin() + (job - jobs.data()));
  return grpc::Status::OK;
}

grpc::Status FakeFarm::ExtendJob(grpc::ServerContext*, const v1::ExtendJobRequest* request,
                                 v1::ExtendJobResponse* response) {
  const std::lock_guard lock(mutex_);
  v1::Job* job = find(request->job_id());
  if (job == nullptr) return not_found(request->job_id());
  if (request->sample_count() <= job->settings().sample_count()) {
    return {grpc::StatusCode::INVALID_ARGUMENT, "not above the present count"};
  }
  job->mutable_settings()->set_sample_count(request->sample_count());
  *response->mutable_job() = *job;
  return grpc::Status::OK;
}

grpc::Status FakeFarm::GetJobReport(grpc::ServerContext*, const v1::GetJobReportRequest* request,
                                    grpc::ServerWriter<v1::GetJobReportResponse>* writer) {
  const auto found = reports.find(request->job_id());
  const std::string report = found == reports.end() ? "{}" : found->second;
  v1::GetJobReportResponse part;
  for (std::size_t at = 0; at < report.size(); at += 1 << 20) {
    part.set_report_json(report.substr(at, 1 << 20));
    writer->Write(part);
  }
  return grpc::Status::OK;
}

grpc::Status FakeFarm::FetchFrame(grpc::ServerContext*, const v1::FetchFrameRequest* request,
                                  grpc::ServerWriter<v1::FetchFrameResponse>* writer) {
  auto& of_job = frames[request->job_id()];
  const auto found = of_job.find(request->frame());
  if (found == of_job.end()) return {grpc::StatusCode::NOT_FOUND, "no such frame"};
  Frame& frame = found->second;
  if (!frame.finished && !request->allow_partial()) {
    return {grpc::StatusCode::FAILED_PRECONDITION, "the frame is not finished"};
  }
  v1::FetchFrameResponse header;
  header.mutable_header()->set_size_bytes(static_cast<std::int64_t>(frame.bytes.size()));
  header.mutable_header()->set_file_sha256(contract::sha256(frame.bytes).binary());
  // The second and later tiles arrive after the header, as in a long list.
  v1::FetchFrameResponse more;
  for (const v1::PixelRect& rect : frame.missing_tiles) {
    const bool is_first = header.header().missing_tiles().empty();
    *(is_first ? header.mutable_header()->add_missing_tiles()
               : more.mutable_more_missing_tiles()->add_tiles()) = rect;
  }
  writer->Write(header);
  if (more.has_more_missing_tiles()) writer->Write(more);
  for (std::size_t at = 0; at < frame.bytes.size(); at += 1000) {
    v1::FetchFrameResponse chunk;
    chunk.set_chunk(frame.bytes.substr(at, 1000));
    if (frame.has_wrong_bytes) chunk.set_chunk(std::string(chunk.chunk().size(), '!'));
    writer->Write(chunk);
    if (frame.break_count > 0) {
      --frame.break_count;
      return {grpc::StatusCode::UNAVAILABLE, "the connection broke"};
    }
  }
  return grpc::Status::OK;
}

Outcome run_client(const std::vector<std::string>& arguments) {
  Outcome outcome;
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  Invocation invocation;
  CLI::App app("test", "tessera");
  app.require_subcommand(1);
  add_all_commands(app, invocation);
  try {
    app.parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));
    outcome.exit = invocation.run();
  } catch (const CLI::ParseError& error) {
    outcome.exit = app.exit(error) == 0 ? kExitDone : kExitBadInput;
  }
  outcome.out = testing::internal::GetCapturedStdout();
  outcome.err = testing::internal::GetCapturedStderr();
  return outcome;
}

}  // namespace tessera::client
