#include "worker/agent/worker_id.h"

#include <gtest/gtest.h>
#include <stdlib.h>

#include <filesystem>
#include <fstream>
#include <regex>
#include <string>

namespace tessera::agent {
namespace {

namespace fs = std::filesystem;

class WorkerIdTest : public testing::Test {
 protected:
  WorkerIdTest() {
    std::string name = fs::temp_directory_path() / "tessera-id-XXXXXX";
    folder_ = ::mkdtemp(name.data());
  }
  ~WorkerIdTest() override { fs::remove_all(folder_); }

  WorkerId claim(const std::string& host = "host") { return claim_worker_id(folder_, host); }

  std::string folder_;
};

bool is_id(const std::string& id) {
  return std::regex_match(id, std::regex("w-[0-9a-f]{16}"));
}

TEST_F(WorkerIdTest, RestartedWorkerKeepsItsId) {
  const std::string first = claim().id;
  EXPECT_TRUE(is_id(first)) << first;
  EXPECT_EQ(claim().id, first);
}

TEST_F(WorkerIdTest, WorkersAtTheSameTimeDiffer) {
  WorkerId first = claim();
  const WorkerId second = claim();
  const std::string id = first.id;
  EXPECT_NE(id, second.id);
  first = {};  // it ends, and is started again
  EXPECT_EQ(claim().id, id);
}

TEST_F(WorkerIdTest, HostsWithOneCacheDiffer) {
  EXPECT_NE(claim("one").id, claim("two").id);
  EXPECT_TRUE(is_id(claim("with/slash").id));
}

TEST_F(WorkerIdTest, InvalidFileGetsANewId) {
  std::ofstream(folder_ + "/host-1.id") << "w-../../etc/passwd and more";
  const std::string id = claim().id;
  EXPECT_TRUE(is_id(id)) << id;
  EXPECT_EQ(claim().id, id);
}

TEST_F(WorkerIdTest, WithoutFilesTheIdIsRandom) {
  const WorkerId first = claim_worker_id(folder_ + "/missing", "host");
  EXPECT_TRUE(is_id(first.id));
  EXPECT_FALSE(first.lock);
  EXPECT_NE(claim_worker_id(folder_ + "/missing", "host").id, first.id);
}

}  // namespace
}  // namespace tessera::agent
