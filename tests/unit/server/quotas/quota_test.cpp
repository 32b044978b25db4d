#include <gtest/gtest.h>

#include <set>
#include <string>

#include "server/state/client_quota.h"

namespace tessera::server {
namespace {

TEST(ClientQuotas, OverrideAppliesToOneClient) {
  ClientQuotas quotas;
  quotas.defaults.streams = 4;
  quotas.by_client["ann"].streams = 9;
  EXPECT_EQ(quotas.of("ann").streams, 9);
  EXPECT_EQ(quotas.of("bob").streams, 4);
  EXPECT_EQ(quotas.largest(&ClientQuota::streams), 9);
  quotas.by_client["carl"].streams = 0;
  EXPECT_EQ(quotas.largest(&ClientQuota::streams), 0) << "unlimited";
}

TEST(ClientQuotas, EveryKindHasItsMember) {
  std::set<std::string> names;
  for (const QuotaKind& kind : kQuotaKinds) {
    names.insert(kind.name);
    EXPECT_EQ(&quota_kind(kind.member), &kind);
  }
  EXPECT_EQ(names.size(), kQuotaKinds.size());
}

TEST(ClientQuotas, EveryKindOfJobsAndFilesIsChecked) {
  JobSpec spec;
  spec.owner = "ann";
  spec.settings.width = spec.settings.height = 100;
  spec.settings.spp = 1000;
  OwnerUse one;
  one.add(spec);
  for (double ClientQuota::*member :
       {&ClientQuota::jobs, &ClientQuota::gigasamples, &ClientQuota::gb, &ClientQuota::stored_gb}) {
    const QuotaKind& kind = quota_kind(member);
    ClientQuota quota;
    quota.*member = 1.5 * one.of(kind);
    EXPECT_TRUE(check_quota(quota, {}, spec).ok()) << kind.name;
    const QuotaKind* refused = nullptr;
    const absl::Status status = check_quota(quota, one, spec, &refused);
    EXPECT_TRUE(absl::IsResourceExhausted(status)) << kind.name;
    EXPECT_EQ(refused, &kind);
    EXPECT_EQ(status.message().find(std::string("quota ") + kind.name + ": client ann"), 0u)
        << status;
  }
}

TEST(ClientQuotas, KeptResultsCountAsStored) {
  OwnerUse use;
  use.kept_bytes = 3e9;
  use.store_bytes = 2e9;
  EXPECT_EQ(use.of(quota_kind(&ClientQuota::stored_gb)), 5);
  EXPECT_EQ(use.of(quota_kind(&ClientQuota::gb)), 2);
}

}  // namespace
}  // namespace tessera::server
