#include "server/schedule/workers/farm_census.h"

#include <gtest/gtest.h>

#include <string>
#include <utility>

namespace tessera::server {
namespace {

Worker worker_of(std::string witness, std::int32_t threads) {
  Worker worker;
  worker.thread_count = threads;
  worker.host = "host of " + witness;
  worker.witness = std::move(witness);
  worker.serves = {"gpu"};
  return worker;
}

TEST(FarmCensus, WorkersAreCountedByTagUntilRemoved) {
  FarmCensus census;
  const Worker ann = worker_of("ann", 4), bob = worker_of("bob", 8);
  census.add(ann);
  census.add(bob);
  EXPECT_EQ(census.threads("gpu"), 12);
  EXPECT_EQ(census.threads(""), 12);
  census.remove(ann);
  EXPECT_EQ(census.threads("gpu"), 8);
  EXPECT_EQ(census.find("gpu")->hosts.size(), 1u);
  census.remove(bob);
  EXPECT_EQ(census.find("gpu"), nullptr);
  EXPECT_EQ(census.find(""), nullptr);
  EXPECT_EQ(census.threads("gpu"), 1);
}

TEST(FarmCensus, WitnessBeyondAskedOnesIsAPresentWorker) {
  FarmCensus census;
  EXPECT_FALSE(census.has_witness_beyond("gpu", {})) << "no worker has the tag";
  census.add(worker_of("ann", 1));
  EXPECT_TRUE(census.has_witness_beyond("gpu", {}));
  EXPECT_TRUE(census.has_witness_beyond("gpu", {"bob"})) << "bob has left";
  EXPECT_FALSE(census.has_witness_beyond("gpu", {"ann"}));
  EXPECT_FALSE(census.has_witness_beyond("cpu", {}));
}

}  // namespace
}  // namespace tessera::server
