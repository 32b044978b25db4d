#include "tests/integration/server/fuzz/service_fuzzer.h"

#include <algorithm>
#include <chrono>

#include "absl/strings/str_cat.h"
#include "tessera/v1/farm_service.grpc.pb.h"

namespace tessera::server {
namespace {

using grpc::StatusCode;

template <typename Request, typename Response, typename Stub, typename Method>
grpc::Status order_job(Stub& stub, Method method, Request request, const std::string& id) {
  grpc::ClientContext context;
  contract::prepare_call(context, "", std::chrono::seconds(20));
  request.set_job_id(id);
  Response response;
  return (stub.*method)(&context, request, &response);
}

}  // namespace

const std::vector<Person>& ServiceFuzzer::people() {
  static const std::vector<Person> people = {{"ann", true, false},
                                             {"bob", true, false},
                                             {"root", false, true},
                                             {"w1", false, false},
                                             {"w2", false, false}};
  return people;
}

const Person& ServiceFuzzer::anybody() {
  return people()[static_cast<std::size_t>(dice_.below(static_cast<int>(people().size())))];
}

std::shared_ptr<grpc::Channel> ServiceFuzzer::open(const Person& person) {
  std::shared_ptr<grpc::Channel>& open = channels_[person.name];
  if (!open) open = channel(person.name);
  return open;
}

/// Returns the ID of a job, of one that was removed, or no ID.
std::string ServiceFuzzer::any_job() {
  if (owners_.empty() || dice_.one_in(12)) return dice_.one_in(2) ? "" : "nosuchjb";
  const auto skip = dice_.below(static_cast<int>(owners_.size()));
  return std::next(owners_.begin(), skip)->first;
}

std::string ServiceFuzzer::run(int steps) {
  SetUp();
  std::string wrong;
  for (int i = 0; i < steps && wrong.empty(); ++i) {
    wrong = step();
    if (wrong.empty()) wrong = model_.difference(all_jobs());
    if (!wrong.empty()) wrong = absl::StrCat("step ", i, ": ", wrong);
  }
  workers_.clear();
  channels_.clear();
  TearDown();
  return wrong;
}

std::string ServiceFuzzer::step() {
  const int choice = dice_.below(100);
  if (choice < 16 || owners_.size() < 2) return submit();
  if (choice < 46) return order();
  if (choice < 70) return look();
  if (choice < 74) return join_worker();
  if (choice < 75) return restart_server();
  return call_raw();
}

std::string ServiceFuzzer::compare(const char* what, const Person& person, StatusCode expected,
                                   const grpc::Status& status) {
  if (status.error_code() != StatusCode::OK) ++counts_.refused;
  if (status.error_code() != expected) {
    return absl::StrCat(what, " by ", person.name, ": expected status ", expected, ", got ",
                        status.error_code(), " ", status.error_message());
  }
  return leak(person, status.error_message());
}

/// Returns what these bytes, which `person` receives, tell about other clients; empty: nothing.
std::string ServiceFuzzer::leak(const Person& person, const std::string& bytes) const {
  if (person.is_admin) return {};
  for (const char* owner : {"ann", "bob"}) {
    if (person.name == owner || bytes.find(secret_of(owner)) == std::string::npos) continue;
    return absl::StrCat(person.name, " received what ", owner, " named: ", bytes);
  }
  return {};
}

std::vector<v1::Job> ServiceFuzzer::all_jobs() {
  std::vector<v1::Job> jobs;
  v1::ListJobsRequest request;
  const auto root = stub<v1::JobService>(people()[2]);
  do {
    grpc::ClientContext context;
    prepare(context);
    v1::ListJobsResponse response;
    const grpc::Status status = root->ListJobs(&context, request, &response);
    EXPECT_TRUE(status.ok()) << status.error_message();
    jobs.insert(jobs.end(), response.jobs().begin(), response.jobs().end());
    request.set_page_token(response.next_page_token());
  } while (!request.page_token().empty());
  return jobs;
}

// Steps that the model predicts -------------------------------------------------------------------

std::string ServiceFuzzer::submit() {
  const Person& person = dice_.one_in(8) ? anybody() : any_client();
  const bool is_worker = !person.is_client && !person.is_admin;
  if (!is_worker) {
    const grpc::Status uploaded = upload_scene(person.name);
    if (!uploaded.ok()) return "upload: " + uploaded.error_message();
  }
  v1::CreateJobRequest request =
      request_of(absl::StrCat(secret_of(person.name), "-", ++last_number_));
  request.set_project(secret_of(person.name));
  request.set_priority(dice_.below(120) - 10);
  StatusCode expected = StatusCode::OK;
  if (request.priority() > 100)
    expected = StatusCode::INVALID_ARGUMENT;
  else if (request.priority() > 50 && !person.is_admin)
    expected = StatusCode::PERMISSION_DENIED;
  const std::string before = any_job();
  if (dice_.one_in(3)) {  // it waits for another job
    v1::JobDependency& dependency = *request.add_dependencies();
    dependency.set_job_id(before);
    dependency.set_kind(v1::JobDependency::KIND_END);
    if (before.empty()) expected = StatusCode::INVALID_ARGUMENT;
    if (expected == StatusCode::OK && !model_.sees(person, before))
      expected = StatusCode::NOT_FOUND;
  }
  if (is_worker) expected = StatusCode::PERMISSION_DENIED;
  grpc::ClientContext context;
  prepare(context);
  v1::CreateJobResponse response;
  const grpc::Status status = stub<v1::JobService>(person)->CreateJob(&context, request, &response);
  std::string wrong = compare("CreateJob", person, expected, status);
  if (!wrong.empty() || !status.ok()) return wrong;
  ++counts_.jobs;
  owners_[response.job().id()] = person.name;
  model_.add(response.job().id(), {person.name, request.name(), v1::Job::STATE_QUEUED,
                                   request.priority(), request.settings().sample_count()});
  // The same request by somebody else must not reveal the job.
  const Person& other = any_client();
  if (other.name == person.name) return {};
  grpc::ClientContext again;
  prepare(again);
  v1::CreateJobResponse foreign;
  request.set_priority(0);
  request.clear_dependencies();
  const grpc::Status repeated = stub<v1::JobService>(other)->CreateJob(&again, request, &foreign);
  if (foreign.has_job()) return "another client's request ID reveals its job";
  return compare("repeated CreateJob", other, StatusCode::ALREADY_EXISTS, repeated);
}

grpc::Status ServiceFuzzer::give(const Person& person, Order order, const std::string& id,
                                 int value) {
  using Stub = v1::JobService::Stub;
  const auto jobs = stub<v1::JobService>(person);
  switch (order) {
    case Order::pause:
      return order_job<v1::PauseJobRequest, v1::PauseJobResponse>(*jobs, &Stub::PauseJob, {}, id);
    case Order::resume:
      return order_job<v1::ResumeJobRequest, v1::ResumeJobResponse>(*jobs, &Stub::ResumeJob, {},
                                                                    id);
    case Order::cancel:
      return order_job<v1::CancelJobRequest, v1::CancelJobResponse>(*jobs, &Stub::CancelJob, {},
                                                                    id);
    case Order::retry:
      return order_job<v1::RetryJobRequest, v1::RetryJobResponse>(*jobs, &Stub::RetryJob, {}, id);
    case Order::remove:
      return order_job<v1::RemoveJobRequest, v1::RemoveJobResponse>(*jobs, &Stub::RemoveJob, {},
                                                                    id);
    case Order::extend: {
      v1::ExtendJobRequest request;
      request.set_sample_count(value);
      return order_job<v1::ExtendJobRequest, v1::ExtendJobResponse>(*jobs, &Stub::ExtendJob,
                                                                    request, id);
    }
    case Order::raise_priority: {
      v1::UpdateJobRequest request;
      request.set_priority(value);
      return order_job<v1::UpdateJobRequest, v1::UpdateJobResponse>(*jobs, &Stub::UpdateJob,
                                                                    request, id);
    }
  }
  return grpc::Status::OK;
}

std::string ServiceFuzzer::order() {
  ++counts_.orders;
  const Person& person = anybody();
  const std::string id = any_job();
  const auto order = static_cast<Order>(dice_.below(kOrderCount));
  const int value = order == Order::extend ? 16 + 8 * dice_.below(4) : dice_.below(110);
  const StatusCode expected = model_.give(person, order, id, value);
  return compare(order_name(order), person, expected, give(person, order, id, value));
}

std::string ServiceFuzzer::look() {
  ++counts_.looks;
  switch (dice_.below(5)) {
    case 0:
      return look_at_list();
    case 1:
      return look_at_events();
    case 2:
      return look_at_frame();
    case 3:
      return look_at_usage();
    default:
      return look_at_asset();
  }
}

/// ListJobs in small pages, and GetJob.
std::string ServiceFuzzer::look_at_list() {
  const Person& person = any_client();
  const auto jobs = stub<v1::JobService>(person);
  std::vector<std::string> ids;
  v1::ListJobsRequest request;
  request.set_page_size(1 + dice_.below(5));
  do {
    grpc::ClientContext context;
    prepare(context);
    v1::ListJobsResponse response;
    std::string wrong =
        compare("ListJobs", person, StatusCode::OK, jobs->ListJobs(&context, request, &response));
    if (wrong.empty()) wrong = leak(person, response.SerializeAsString());
    if (!wrong.empty()) return wrong;
    for (const v1::Job& job : response.jobs()) ids.push_back(job.id());
    request.set_page_token(response.next_page_token());
  } while (!request.page_token().empty());
  std::sort(ids.begin(), ids.end());
  if (ids != model_.visible(person))
    return "ListJobs shows other jobs than those of " + person.name;
  const std::string id = any_job();
  grpc::ClientContext context;
  prepare(context);
  v1::GetJobRequest one;
  one.set_job(id);
  v1::GetJobResponse response;
  return compare("GetJob", person, model_.sees(person, id) ? StatusCode::OK : StatusCode::NOT_FOUND,
                 jobs->GetJob(&context, one, &response));
}

std::string ServiceFuzzer::look_at_events() {
  const Person& person = any_client();
  const std::string id = dice_.one_in(2) ? any_job() : "";
  grpc::ClientContext context;
  prepare(context);
  v1::WatchEventsRequest request;
  request.set_job_id(id);
  const auto jobs = stub<v1::JobService>(person);
  const auto stream = jobs->WatchEvents(&context, request);
  std::string wrong;
  for (v1::WatchEventsResponse response; stream->Read(&response);) {
    for (const v1::Event& event : response.events()) {
      if (event.job_id().empty()) continue;  // about a worker, which all clients may see
      const auto owner = owners_.find(event.job_id());
      if (owner != owners_.end() && owner->second == person.name) continue;
      wrong = absl::StrCat(person.name, " received the event ", event.ShortDebugString());
    }
    if (wrong.empty()) wrong = leak(person, response.SerializeAsString());
  }
  const StatusCode expected =
      id.empty() || model_.sees(person, id) ? StatusCode::OK : StatusCode::NOT_FOUND;
  const grpc::Status status = stream->Finish();
  return wrong.empty() ? compare("WatchEvents", person, expected, status) : wrong;
}

/// FetchFrame and GetJobReport.
std::string ServiceFuzzer::look_at_frame() {
  const Person& person = anybody();
  const bool is_worker = !person.is_client && !person.is_admin;
  const std::string id = any_job();
  const auto jobs = stub<v1::JobService>(person);
  grpc::ClientContext context, report_context;
  prepare(context);
  prepare(report_context);
  v1::FetchFrameRequest request;
  request.set_job_id(id);
  const auto stream = jobs->FetchFrame(&context, request);
  for (v1::FetchFrameResponse response; stream->Read(&response);) {
  }
  const StatusCode hidden = is_worker ? StatusCode::PERMISSION_DENIED : StatusCode::NOT_FOUND;
  const bool sees = !is_worker && model_.sees(person, id);
  std::string wrong = compare("FetchFrame", person, sees ? StatusCode::FAILED_PRECONDITION : hidden,
                              stream->Finish());
  if (!wrong.empty()) return wrong;
  v1::GetJobReportRequest report_request;
  report_request.set_job_id(id);
  const auto report = jobs->GetJobReport(&report_context, report_request);
  std::string text;
  for (v1::GetJobReportResponse response; report->Read(&response);) text += response.report_json();
  wrong = compare("GetJobReport", person, sees ? StatusCode::OK : hidden, report->Finish());
  return wrong.empty() ? leak(person, text) : wrong;
}

/// ListUsage, ListBudgets, ListQuotas and ListShares, after an admin has set a share.
std::string ServiceFuzzer::look_at_usage() {
  const Person& person = any_client();
  const auto farm = stub<v1::FarmService>(person);
  const auto check = [&](const char* what, const grpc::Status& status, const std::string& bytes) {
    std::string wrong = compare(what, person, StatusCode::OK, status);
    return wrong.empty() ? leak(person, bytes) : wrong;
  };
  grpc::ClientContext one, two, three, four, five;
  for (grpc::ClientContext* context : {&one, &two, &three, &four, &five}) prepare(*context);
  v1::ListUsageRequest request;
  request.add_group_by(v1::ListUsageRequest::GROUP_JOB);
  if (dice_.one_in(2)) request.set_owner(any_client().name);
  v1::ListUsageResponse usage;
  v1::ListBudgetsResponse budgets;
  v1::ListQuotasResponse quotas;
  std::string wrong =
      check("ListUsage", farm->ListUsage(&one, request, &usage), usage.SerializeAsString());
  if (wrong.empty()) {
    wrong =
        check("ListBudgets", farm->ListBudgets(&two, {}, &budgets), budgets.SerializeAsString());
  }
  for (const v1::Budget& budget : budgets.budgets()) {
    if (budget.name() != person.name) wrong = "a budget of " + budget.name();
  }
  if (wrong.empty()) {
    wrong = check("ListQuotas", farm->ListQuotas(&three, {}, &quotas), quotas.SerializeAsString());
  }
  for (const v1::ClientQuotas& quota : quotas.clients()) {
    if (quota.client() != person.name) wrong = "quotas of " + quota.client();
  }
  v1::SetShareRequest share;
  share.set_client(any_client().name);
  share.set_weight(2);
  v1::SetShareResponse set;
  if (wrong.empty()) {
    wrong = compare("SetShare", people()[2], StatusCode::OK,
                    stub<v1::FarmService>(people()[2])->SetShare(&five, share, &set));
  }
  v1::ListSharesResponse shares;
  if (wrong.empty()) {
    wrong = check("ListShares", farm->ListShares(&four, {}, &shares), shares.SerializeAsString());
  }
  for (const v1::ClientShare& listed : shares.shares()) {
    if (listed.client() != person.name) wrong = "the share of " + listed.client();
  }
  return wrong;
}

/// DownloadAsset and DescribeJob by the worker that has never joined.
std::string ServiceFuzzer::look_at_asset() {
  const Person& stranger = people()[4];
  std::string wrong =
      compare("DownloadAsset", stranger, StatusCode::NOT_FOUND, download_scene(stranger.name));
  if (!wrong.empty()) return wrong;
  grpc::ClientContext context;
  prepare(context);
  v1::DescribeJobRequest request;
  request.set_job_id(any_job());
  v1::DescribeJobResponse response;
  return compare("DescribeJob", stranger, StatusCode::NOT_FOUND,
                 stub<v1::WorkerService>(stranger)->DescribeJob(&context, request, &response));
}

/// A worker joins, takes units and never delivers any, or is refused.
std::string ServiceFuzzer::join_worker() {
  ++counts_.workers;
  const bool has_token = dice_.one_in(2);
  auto joining = worker("w1", absl::StrCat("id-", dice_.below(3)), has_token ? token() : "");
  const bool is_welcome = joining->open();
  if (is_welcome != has_token) return "Work with and without a token";
  if (is_welcome) {
    workers_.push_back(std::move(joining));
    return {};
  }
  return compare("Work", people()[3], StatusCode::UNAUTHENTICATED, joining->close());
}

std::string ServiceFuzzer::restart_server() {
  ++counts_.restarts;
  workers_.clear();
  channels_.clear();
  restart();
  return {};
}

}  // namespace tessera::server
