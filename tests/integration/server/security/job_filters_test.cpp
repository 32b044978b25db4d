// Lists of the jobs of several owners.
#include <map>
#include <string>
#include <vector>

#include "tests/integration/server/support/secure_farm.h"

namespace tessera::server {
namespace {

using grpc::StatusCode;
using Names = std::vector<std::string>;

class JobFilters : public SecureFarm {
 protected:
  void SetUp() override {
    SecureFarm::SetUp();
    if (HasFatalFailure()) return;
    for (const char* owner : {"ann", "bob"}) {
      ASSERT_TRUE(upload_scene(owner).ok());
      submit(owner, "film", "");
      submit(owner, "advert", "night");
    }
    submit("ann", "", "");
  }
  /// Creates the job OWNER-PROJECT.
  void submit(const std::string& owner, const std::string& project, const std::string& pool) {
    v1::CreateJobRequest request = request_of(owner + "-" + project);
    request.set_project(project);
    request.set_pool(pool);
    v1::CreateJobResponse response;
    const grpc::Status status = create(owner, request, response);
    EXPECT_TRUE(status.ok()) << status.error_message();
    ids_[request.name()] = response.job().id();
  }
  /// Returns the names in all pages.
  Names list(const std::string& caller, v1::ListJobsRequest request) const {
    Names names;
    do {
      grpc::ClientContext context;
      prepare(context);
      v1::ListJobsResponse page;
      const grpc::Status status = jobs(caller)->ListJobs(&context, request, &page);
      EXPECT_TRUE(status.ok()) << status.error_message();
      for (const v1::Job& job : page.jobs()) names.push_back(job.name());
      request.set_page_token(page.next_page_token());
    } while (!request.page_token().empty());
    return names;
  }
  StatusCode code(const v1::ListJobsRequest& request) const {
    grpc::ClientContext context;
    prepare(context);
    v1::ListJobsResponse page;
    return jobs("root")->ListJobs(&context, request, &page).error_code();
  }
  void cancel(const std::string& owner, const std::string& name) {
    grpc::ClientContext context;
    prepare(context);
    v1::CancelJobRequest request;
    request.set_job_id(ids_[name]);
    v1::CancelJobResponse response;
    EXPECT_TRUE(jobs(owner)->CancelJob(&context, request, &response).ok());
  }

  std::map<std::string, std::string> ids_;
};

TEST_F(JobFilters, JobMatchesOneValueOfEachFilter) {
  v1::ListJobsRequest request;
  request.add_owners("bob");
  EXPECT_EQ(list("root", request), (Names{"bob-advert", "bob-film"}));
  request.add_owners("ann");
  request.add_projects("film");
  EXPECT_EQ(list("root", request), (Names{"bob-film", "ann-film"}));
  request.add_projects("");
  EXPECT_EQ(list("root", request), (Names{"ann-", "bob-film", "ann-film"}));
  request.Clear();
  request.add_pools("default");
  EXPECT_EQ(list("root", request), (Names{"ann-", "bob-film", "ann-film"}));
  cancel("bob", "bob-film");
  request.add_states(v1::Job::STATE_CANCELLED);
  EXPECT_EQ(list("root", request), Names{"bob-film"});
  request.add_states(v1::Job::STATE_QUEUED);
  request.add_owners("nobody");
  EXPECT_EQ(list("root", request), Names{});
}

TEST_F(JobFilters, ClientListsOnlyItsJobsWithFilters) {
  v1::ListJobsRequest request;
  request.add_projects("film");
  EXPECT_EQ(list("ann", request), Names{"ann-film"});
  request.add_owners("bob");
  EXPECT_EQ(list("ann", request), Names{});
}

TEST_F(JobFilters, PagesHoldAllMatches) {
  v1::ListJobsRequest request;
  request.set_page_size(1);
  request.add_owners("ann");
  request.add_owners("bob");
  request.add_pools("night");
  EXPECT_EQ(list("root", request), (Names{"bob-advert", "ann-advert"}));
  request.clear_owners();
  request.clear_pools();
  EXPECT_EQ(list("root", request).size(), 5u);
}

TEST_F(JobFilters, InvalidFiltersAreRefused) {
  v1::ListJobsRequest request;
  request.add_states(v1::Job::STATE_UNSPECIFIED);
  EXPECT_EQ(code(request), StatusCode::INVALID_ARGUMENT);
  request.clear_states();
  for (int i = 0; i < 101; ++i) request.add_owners("ann");
  EXPECT_EQ(code(request), StatusCode::INVALID_ARGUMENT);
}

}  // namespace
}  // namespace tessera::server
