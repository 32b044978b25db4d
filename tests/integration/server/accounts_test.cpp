// Shares, budgets, accounts and orders to workers as messages.
#include <cmath>
#include <functional>
#include <memory>

#include "tests/integration/server/support/test_farm.h"

namespace tessera::server {
namespace {

class AccountsService : public TestFarm {
 protected:
  std::unique_ptr<v1::FarmService::Stub> farm() {
    return v1::FarmService::NewStub(server_->channel());
  }
  grpc::Status set(const v1::Budget& budget, v1::Budget* answer = nullptr) {
    grpc::ClientContext context;
    prepare(context);
    v1::SetBudgetRequest request;
    *request.mutable_budget() = budget;
    v1::SetBudgetResponse response;
    grpc::Status status = farm()->SetBudget(&context, request, &response);
    if (answer != nullptr) *answer = response.budget();
    return status;
  }
  grpc::Status usage(const v1::ListUsageRequest& request, v1::ListUsageResponse& response) {
    grpc::ClientContext context;
    prepare(context);
    response.Clear();
    return farm()->ListUsage(&context, request, &response);
  }
  /// Renders a job of one owner and returns its ID.
  std::string render(const std::string& name, const std::string& project) {
    EXPECT_TRUE(upload(id_of(kScene), kScene).ok());
    v1::CreateJobRequest request = request_of(name);
    request.set_project(project);
    v1::CreateJobResponse response;
    EXPECT_TRUE(create(request, response).ok());
    EXPECT_EQ(response.job().project(), project);
    TestWorker worker(server_->channel(), "w");  // another one would be asked to audit
    EXPECT_TRUE(worker.open());
    worker.work();
    EXPECT_EQ(watch(response.job().id()).back().state(), v1::Job::STATE_DONE);
    return response.job().id();
  }
};

v1::Budget budget_of(const std::string& name) {
  v1::Budget budget;
  budget.set_scope(v1::Budget::SCOPE_PROJECT);
  budget.set_name(name);
  budget.set_cpu_seconds(1000);
  budget.set_period(v1::Budget::PERIOD_MONTH);
  budget.set_action(v1::Budget::ACTION_WARN);
  budget.set_warning_fraction(0.5);
  return budget;
}

TEST_F(AccountsService, CallQuotasNeedCertificates) {
  create_job("a");
  grpc::ClientContext context;
  prepare(context);
  v1::ListQuotasResponse response;
  ASSERT_TRUE(farm()->ListQuotas(&context, {}, &response).ok());
  ASSERT_EQ(response.clients_size(), 1);
  EXPECT_EQ(response.clients(0).client(), "local");
  for (const v1::QuotaUse& use : response.clients(0).quotas()) {
    EXPECT_EQ(use.limit(), 0) << use.quota();
    if (use.quota() == "jobs") {
      EXPECT_EQ(use.used(), 1);
    }
  }
}

TEST_F(AccountsService, SharesAreCheckedAndListed) {
  const auto set = [&](const std::string& client, double weight) {
    grpc::ClientContext context;
    prepare(context);
    v1::SetShareRequest request;
    request.set_client(client);
    request.set_weight(weight);
    v1::SetShareResponse response;
    return farm()->SetShare(&context, request, &response).error_code();
  };
  const auto reset = [&](const std::string& client, v1::ClientShare& share) {
    grpc::ClientContext context;
    prepare(context);
    v1::ResetShareRequest request;
    request.set_client(client);
    v1::ResetShareResponse response;
    const grpc::Status status = farm()->ResetShare(&context, request, &response);
    share = response.share();
    return status.error_code();
  };
  for (const double wrong : {0.0, -1.0, 0.0009, 1000.1, std::nan("")}) {
    EXPECT_EQ(set("ann", wrong), grpc::StatusCode::INVALID_ARGUMENT) << wrong;
  }
  EXPECT_EQ(set("a b", 1), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(set("ann", 0.001), grpc::StatusCode::OK);
  EXPECT_EQ(set("ann", 1000), grpc::StatusCode::OK);
  restart();
  grpc::ClientContext context;
  prepare(context);
  v1::ListSharesResponse listed;
  ASSERT_TRUE(farm()->ListShares(&context, {}, &listed).ok());
  ASSERT_EQ(listed.shares_size(), 1);
  EXPECT_EQ(listed.shares(0).client(), "ann");
  EXPECT_EQ(listed.shares(0).weight(), 1000);
  EXPECT_EQ(listed.shares(0).source(), v1::ClientShare::SOURCE_SET);
  v1::ClientShare share;
  EXPECT_EQ(reset("ann", share), grpc::StatusCode::OK);
  EXPECT_EQ(share.weight(), 1);
  EXPECT_EQ(share.source(), v1::ClientShare::SOURCE_DEFAULT);
  EXPECT_EQ(reset("ann", share), grpc::StatusCode::NOT_FOUND);
}

TEST_F(AccountsService, BudgetsAreCheckedAndListed) {
  const auto is_refused = [&](const std::function<void(v1::Budget&)>& spoil) {
    v1::Budget budget = budget_of("film");
    spoil(budget);
    return set(budget).error_code() == grpc::StatusCode::INVALID_ARGUMENT;
  };
  EXPECT_TRUE(is_refused([](auto& b) { b.set_name("a b"); }));
  EXPECT_TRUE(is_refused([](auto& b) { b.set_scope(v1::Budget::SCOPE_UNSPECIFIED); }));
  EXPECT_TRUE(is_refused([](auto& b) { b.set_cpu_seconds(0); }));
  EXPECT_TRUE(is_refused([](auto& b) { b.set_cpu_seconds(std::nan("")); }));
  EXPECT_TRUE(is_refused([](auto& b) { b.set_period(v1::Budget::PERIOD_UNSPECIFIED); }));
  EXPECT_TRUE(is_refused([](auto& b) { b.set_action(v1::Budget::ACTION_UNSPECIFIED); }));
  EXPECT_TRUE(is_refused([](auto& b) { b.set_warning_fraction(0); }));
  v1::Budget answer;
  ASSERT_TRUE(set(budget_of("film"), &answer).ok());
  EXPECT_TRUE(answer.has_period_start_time());
  restart();
  grpc::ClientContext context, removing, repeating;
  for (grpc::ClientContext* each : {&context, &removing, &repeating}) prepare(*each);
  v1::ListBudgetsResponse listed;
  ASSERT_TRUE(farm()->ListBudgets(&context, {}, &listed).ok());
  ASSERT_EQ(listed.budgets_size(), 1);
  EXPECT_EQ(listed.budgets(0).SerializeAsString(), answer.SerializeAsString());
  v1::RemoveBudgetRequest request;
  request.set_scope(v1::Budget::SCOPE_PROJECT);
  request.set_name("film");
  v1::RemoveBudgetResponse response;
  EXPECT_TRUE(farm()->RemoveBudget(&removing, request, &response).ok());
  EXPECT_EQ(farm()->RemoveBudget(&repeating, request, &response).error_code(),
            grpc::StatusCode::NOT_FOUND);
}

TEST_F(AccountsService, UsageComesInPages) {
  const std::string first = render("a", "film"), second = render("b", "film");
  const std::string third = render("c", "");
  v1::ListUsageRequest request;
  request.add_group_by(v1::ListUsageRequest::GROUP_PROJECT);
  request.add_group_by(v1::ListUsageRequest::GROUP_JOB);
  request.set_page_size(1);
  std::vector<std::string> jobs;
  v1::ListUsageResponse response;
  do {
    ASSERT_TRUE(usage(request, response).ok());
    ASSERT_EQ(response.usage_size(), 1);
    jobs.push_back(response.usage(0).job_id());
    EXPECT_GT(response.usage(0).unit_count(), 0);
    request.set_page_token(response.next_page_token());
  } while (!request.page_token().empty());
  EXPECT_EQ(jobs, (std::vector<std::string>{third, first, second})) << "by project, then age";
  request = {};
  request.set_project("film");
  ASSERT_TRUE(usage(request, response).ok());
  ASSERT_EQ(response.usage_size(), 1);
  EXPECT_EQ(response.usage(0).job_id(), "");
  request.set_page_token("nonsense");
  EXPECT_EQ(usage(request, response).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  request.clear_page_token();
  request.set_page_size(-1);
  EXPECT_EQ(usage(request, response).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(AccountsService, ProjectAndBlocksAreChecked) {
  EXPECT_TRUE(upload(id_of(kScene), kScene).ok());
  v1::CreateJobResponse response;
  v1::CreateJobRequest request = request_of("a");
  request.set_project("a b");
  EXPECT_EQ(create(request, response).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  request = request_of("a");
  request.add_blocked_worker_ids("no such/worker");
  EXPECT_EQ(create(request, response).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  request.set_blocked_worker_ids(0, "w1");
  ASSERT_TRUE(create(request, response).ok());
  EXPECT_EQ(response.job().blocked_worker_ids(0), "w1");
  v1::UpdateJobRequest update;
  update.set_job_id(response.job().id());
  update.add_unblock_worker_ids("w1");
  update.add_block_worker_ids("w2");
  grpc::ClientContext context;
  prepare(context);
  v1::UpdateJobResponse updated;
  ASSERT_TRUE(jobs_->UpdateJob(&context, update, &updated).ok());
  ASSERT_EQ(updated.job().blocked_worker_ids_size(), 1);
  EXPECT_EQ(updated.job().blocked_worker_ids(0), "w2");
}

TEST_F(AccountsService, ReasonOfWorkerSetAsideIsChecked) {
  const auto workers = v1::WorkerService::NewStub(server_->channel());
  v1::SetAsideWorkerRequest request;
  v1::SetAsideWorkerResponse response;
  request.set_worker_id("nobody");
  grpc::ClientContext unknown, too_long;
  for (grpc::ClientContext* each : {&unknown, &too_long}) prepare(*each);
  EXPECT_EQ(workers->SetAsideWorker(&unknown, request, &response).error_code(),
            grpc::StatusCode::NOT_FOUND);
  request.set_reason(std::string(201, 'x'));
  EXPECT_EQ(workers->SetAsideWorker(&too_long, request, &response).error_code(),
            grpc::StatusCode::INVALID_ARGUMENT);
}

}  // namespace
}  // namespace tessera::server
