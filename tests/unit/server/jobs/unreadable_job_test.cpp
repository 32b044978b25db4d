// A job whose row cannot be read does not keep the server from starting.
#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

using UnreadableJob = CoordinatorFixture;

TEST_F(UnreadableJob, StartGoesOnWithoutIt) {
  const std::string lost = create_job("lost"), kept = create_job("kept");
  std::vector<std::string> errors;
  FarmOptions broken = options;
  broken.read_spec = [read = options.read_spec,
                      lost](const JobRecord& record) -> absl::StatusOr<JobSpec> {
    if (record.id == lost) return absl::DataLossError("cannot parse its request");
    return read(record);
  };
  broken.log = [&](LogLevel level, const std::string& line) {
    if (level == LogLevel::error) errors.push_back(line);
  };
  coordinator.reset();
  auto opened = Coordinator::open(store, broken);
  ASSERT_TRUE(opened.ok()) << opened.status();
  coordinator = *std::move(opened);
  EXPECT_TRUE(absl::IsNotFound(coordinator->queries().job(lost).status()));
  EXPECT_EQ(view(kept).state, JobState::queued);
  ASSERT_EQ(errors.size(), 1u);
  EXPECT_NE(errors[0].find(lost), std::string::npos) << errors[0];
  start();
  EXPECT_EQ(view(lost).state, JobState::queued) << "its row is untouched";
}

}  // namespace
}  // namespace tessera::server
