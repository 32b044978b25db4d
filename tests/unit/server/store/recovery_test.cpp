// recover_store() keeps every row that is not on a damaged page.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "server/store/maintenance/recover.h"
#include "server/store/sqlite/database.h"
#include "tests/unit/server/store/store_fixture.h"

namespace tessera::server {
namespace {

constexpr std::size_t kPageBytes = 4096;

class RecoveryTest : public StoreFixture {
 protected:
  /// Closes the store and reads its database.
  void close() {
    store_.reset();
    std::ifstream file(database(), std::ios::binary);
    bytes_.assign(std::istreambuf_iterator<char>(file), {});
  }
  std::string database() const { return path() + "/store.db"; }
  std::size_t page_count() const { return bytes_.size() / kPageBytes; }

  /// Restores the database that close() has read, except for pages of garbage.
  void damage(const std::vector<std::size_t>& pages) {
    std::string damaged = bytes_;
    for (const std::size_t page : pages) {
      std::fill_n(damaged.begin() + static_cast<std::ptrdiff_t>(page * kPageBytes), kPageBytes,
                  '\xee');
    }
    for (const char* suffix : {"-wal", "-shm", ".damaged"}) {
      std::filesystem::remove(database() + suffix);
    }
    write_file(database(), damaged);
  }

  /// Pages on which `text` stands.
  std::vector<std::size_t> pages_with(const std::string& text) const {
    std::vector<std::size_t> pages;
    for (std::size_t page = 0; page < page_count(); ++page) {
      const std::string_view bytes = std::string_view(bytes_).substr(page * kPageBytes, kPageBytes);
      if (bytes.find(text) != std::string_view::npos) pages.push_back(page);
    }
    return pages;
  }
  std::size_t page_with(const std::string& text) const {
    const std::vector<std::size_t> pages = pages_with(text);
    EXPECT_EQ(pages.size(), 1U) << text;
    return pages.empty() ? 0 : pages.front();
  }

  std::int64_t count(const std::string& table) const {
    std::int64_t rows = -1;
    const auto opened = Database::open(database(), "", Database::Mode::reader);
    EXPECT_TRUE(opened.ok()) << opened.status();
    const absl::Status read = (*opened)->each(absl::StrCat("SELECT COUNT(*) FROM ", table), {},
                                              [&](const SqlRow& row) { rows = row.integer(0); });
    EXPECT_TRUE(read.ok()) << read;
    return rows;
  }

  static int gaps(const Recovery& recovery, const std::string& table) {
    for (const Recovery::Table& known : recovery.tables) {
      if (known.name == table) return known.gaps;
    }
    return -1;
  }

  /// Jobs with blocks and images in rows and in files, one of them done.
  void fill() {
    for (const char* id : {"small", "large"}) add_job(id);
    commit("small", 0, 30, 300);
    commit("large", 0, 60, 20'000);
    finish_frame("small", 7, std::string(9000, 'i'));
    finish_frame("large", 7, std::string(200'000, 'i'));
    ASSERT_TRUE(store().units().close_job("small").ok());
    commit("small", 1, 30, 300);
    upload("a small scene");
    upload(std::string(9000, 's'));
    upload(std::string(200'000, 's'));
    ASSERT_TRUE(store().workers().add_worker("w-one", "one").ok());
    ASSERT_TRUE(store().workers().ban_worker("w-bad").ok());
  }

  std::string bytes_;
};

TEST_F(RecoveryTest, EveryPageInTurn) {
  uses_rows_ = true;
  open();
  fill();
  close();
  int recovered = 0, unreadable = 0;
  for (std::size_t page = 0; page < page_count(); ++page) {
    SCOPED_TRACE(absl::StrCat("page ", page, " of ", page_count()));
    damage({page});
    const auto recovery = recover_store(path(), real_filesystem());
    if (absl::IsDataLoss(recovery.status())) {
      ++unreadable;
      EXPECT_FALSE(std::filesystem::exists(database() + ".part"));
      continue;
    }
    ASSERT_TRUE(recovery.ok()) << recovery.status();
    ++recovered;
    const auto findings = check_store(path(), real_filesystem());
    ASSERT_TRUE(findings.ok()) << findings.status();
    EXPECT_EQ(findings->faults, std::vector<std::string>());
    // Opening would delete the files that only other pages refer to.
    EXPECT_TRUE(std::filesystem::exists(database() + ".damaged"));
  }
  EXPECT_GT(recovered, 30);
  EXPECT_LE(unreadable, 5) << "only the header and the list of tables";
}

TEST_F(RecoveryTest, KeepsAllJobsBesideDamagedPages) {
  const auto request_of = [](int job) {
    return absl::StrCat("request<", job, ">", std::string(700, 'r'));
  };
  constexpr int kJobs = 500;
  for (int i = 0; i < kJobs; ++i) {
    JobRecord job;
    job.id = absl::StrCat("job-", i);
    job.request = request_of(i);
    ASSERT_TRUE(store().jobs().add(job).ok());
  }
  close();
  const std::vector<std::size_t> pages = {page_with("request<3>"), page_with("request<250>"),
                                          page_with("request<499>")};
  std::set<std::string> kept;
  for (int i = 0; i < kJobs; ++i) {
    const std::size_t page = page_with(absl::StrCat("request<", i, ">"));
    if (std::count(pages.begin(), pages.end(), page) == 0) kept.insert(absl::StrCat("job-", i));
  }
  damage(pages);
  const auto recovery = recover_store(path(), real_filesystem());
  ASSERT_TRUE(recovery.ok()) << recovery.status();
  EXPECT_EQ(gaps(*recovery, "jobs"), 3);
  open();
  const auto jobs = store().jobs().list();
  ASSERT_TRUE(jobs.ok()) << jobs.status();
  std::set<std::string> found;
  for (const JobRecord& job : *jobs) found.insert(job.id);
  EXPECT_EQ(found, kept);
  EXPECT_GT(kept.size(), 470U);
}

TEST_F(RecoveryTest, KeepsAllUnitsBesideADamagedPage) {
  constexpr int kTiles = 3000;
  for (const char* id : {"first", "second", "third"}) {
    add_job(id);
    commit(id, 0, kTiles, 1);
  }
  close();
  // All blocks of one letter have the same digest, of which the leaves of the table are full.
  const std::string digest(contract::sha256("m").binary());
  const std::vector<std::size_t> pages = pages_with(digest);
  ASSERT_GT(pages.size(), 100U);
  damage({pages[pages.size() / 2]});
  const auto recovery = recover_store(path(), real_filesystem());
  ASSERT_TRUE(recovery.ok()) << recovery.status();
  EXPECT_EQ(gaps(*recovery, "units"), 1);
  const std::int64_t lost = 3 * kTiles - count("units");
  EXPECT_GT(lost, 0);
  EXPECT_LT(lost, 60) << "a page has about 40 rows";
  expect_consistent();
}

TEST_F(RecoveryTest, StoreRowAndEventsAreReplaced) {
  fill();
  Event event;
  event.sequence = (std::int64_t{5} << 40) + 3;
  event.text = "an event of the fifth process";
  ASSERT_TRUE(store().events().add({event}).ok());
  const std::string id = store().id();
  close();
  damage({page_with(id)});
  const auto recovery = recover_store(path(), real_filesystem());
  ASSERT_TRUE(recovery.ok()) << recovery.status();
  EXPECT_EQ(gaps(*recovery, "store"), 1);
  open();
  EXPECT_NE(store().id(), id);
  EXPECT_GT(store().boot_count(), 5) << "sequences of events must not be used twice";
}

TEST_F(RecoveryTest, Refusals) {
  fill();
  EXPECT_TRUE(absl::IsFailedPrecondition(recover_store(path(), real_filesystem()).status()))
      << "the store is open";
  close();
  const auto sound = recover_store(path(), real_filesystem());
  EXPECT_TRUE(absl::IsFailedPrecondition(sound.status())) << sound.status();
  EXPECT_TRUE(absl::StrContains(sound.status().message(), "not damaged")) << sound.status();
  EXPECT_TRUE(absl::IsNotFound(recover_store(path() + "-2", real_filesystem()).status()));
  damage({page_with("w-bad")});
  write_file(database() + ".damaged", "of an earlier recovery");
  EXPECT_TRUE(absl::IsAlreadyExists(recover_store(path(), real_filesystem()).status()));
}

}  // namespace
}  // namespace tessera::server
