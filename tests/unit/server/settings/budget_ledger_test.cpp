#include "server/settings/budget_ledger.h"

#include <gtest/gtest.h>

#include "absl/time/civil_time.h"
#include "absl/time/time.h"

namespace tessera::server {
namespace {

const Account ann{AccountScope::owner, "ann"}, film{AccountScope::project, "film"};

std::int64_t utc(int year, int month, int day, int hour = 0) {
  return absl::ToUnixMicros(
      absl::FromCivil(absl::CivilSecond(year, month, day, hour), absl::UTCTimeZone()));
}

BudgetState state_of(double cpu_seconds, BudgetPeriod period = BudgetPeriod::ever,
                     BudgetAction action = BudgetAction::stop) {
  return {{cpu_seconds, period, action, 0.8}, period_start_us(period, utc(2026, 11, 25)), 0, {}};
}

TEST(BudgetPeriod, StartsAreThoseOfTheCalendar) {
  const std::int64_t now = utc(2026, 11, 25, 13);  // a Wednesday
  EXPECT_EQ(period_start_us(BudgetPeriod::ever, now), 0);
  EXPECT_EQ(period_start_us(BudgetPeriod::day, now), utc(2026, 11, 25));
  EXPECT_EQ(period_start_us(BudgetPeriod::week, now), utc(2026, 11, 23));
  EXPECT_EQ(period_start_us(BudgetPeriod::month, now), utc(2026, 11, 1));
  EXPECT_EQ(period_start_us(BudgetPeriod::week, utc(2026, 11, 23)), utc(2026, 11, 23));
  EXPECT_EQ(period_start_us(BudgetPeriod::week, utc(2026, 11, 23) - 1), utc(2026, 11, 16));
  EXPECT_EQ(period_start_us(BudgetPeriod::month, utc(2024, 2, 29, 23)), utc(2024, 2, 1));
}

TEST(BudgetLedger, ChargesOwnerAndProject) {
  BudgetLedger ledger;
  ledger.set(ann, state_of(10));
  ledger.set(film, state_of(100));
  ledger.charge("ann", "film", 3);
  ledger.charge("ann", "", 2);
  ledger.charge("ben", "film", 4);
  ledger.charge("ben", "ann", 1);  // a project of the same name
  EXPECT_EQ(ledger.find(ann)->used_cpu_seconds, 5);
  EXPECT_EQ(ledger.find(film)->used_cpu_seconds, 7);
}

TEST(BudgetLedger, EachLevelIsTakenOncePerPeriod) {
  BudgetLedger ledger;
  ledger.set(ann, state_of(10, BudgetPeriod::day));
  ledger.charge("ann", "", 7.9);
  EXPECT_FALSE(ledger.has_untold("ann", ""));
  ledger.charge("ann", "", 0.1);
  EXPECT_TRUE(ledger.has_untold("ann", ""));
  EXPECT_FALSE(ledger.has_untold("ben", ""));
  EXPECT_EQ(ledger.take_untold(), std::vector<Account>{ann});
  EXPECT_EQ(ledger.find(ann)->level(), BudgetLevel::warning);
  EXPECT_TRUE(ledger.take_untold().empty());
  EXPECT_TRUE(ledger.stop_reasons().empty());
  ledger.charge("ann", "", 2);
  EXPECT_EQ(ledger.take_untold(), std::vector<Account>{ann});
  EXPECT_EQ(ledger.find(ann)->level(), BudgetLevel::used_up);
  EXPECT_EQ(ledger.stop_reasons().count(ann), 1u);
  ledger.charge("ann", "", 50);
  EXPECT_TRUE(ledger.take_untold().empty());
  EXPECT_FALSE(ledger.advance(utc(2026, 11, 25, 23)));
  EXPECT_FALSE(ledger.advance(utc(2026, 11, 24))) << "the clock was set back";
  EXPECT_TRUE(ledger.advance(utc(2026, 11, 26)));
  EXPECT_EQ(ledger.find(ann)->used_cpu_seconds, 0);
  EXPECT_TRUE(ledger.stop_reasons().empty());
  ledger.charge("ann", "", 9);
  EXPECT_EQ(ledger.take_untold(), std::vector<Account>{ann});
}

TEST(BudgetLedger, WarningBudgetStopsNothing) {
  BudgetLedger ledger;
  ledger.set(ann, state_of(10, BudgetPeriod::ever, BudgetAction::warn));
  ledger.charge("ann", "", 20);
  EXPECT_EQ(ledger.find(ann)->level(), BudgetLevel::used_up);
  EXPECT_TRUE(ledger.stop_reasons().empty());
}

TEST(BudgetLedger, RowsKeepEverythingButUse) {
  BudgetState state = state_of(12345.678, BudgetPeriod::week, BudgetAction::warn);
  state.budget.warning_fraction = 0.1;
  state.told = BudgetLevel::warning;
  state.used_cpu_seconds = 5;
  const auto read = read_budget(write_budget(state));
  ASSERT_TRUE(read);
  EXPECT_EQ(read->budget.cpu_seconds, 12345.678);
  EXPECT_EQ(read->budget.period, BudgetPeriod::week);
  EXPECT_EQ(read->budget.action, BudgetAction::warn);
  EXPECT_EQ(read->budget.warning_fraction, 0.1);
  EXPECT_EQ(read->period_start_us, state.period_start_us);
  EXPECT_EQ(read->told, BudgetLevel::warning);
  EXPECT_EQ(read->used_cpu_seconds, 0);
  EXPECT_FALSE(read_budget("nonsense"));
}

}  // namespace
}  // namespace tessera::server
