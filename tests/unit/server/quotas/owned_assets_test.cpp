#include "server/assets/owned_assets.h"

#include <gtest/gtest.h>

namespace tessera::server {
namespace {

using std::chrono::hours;
using std::chrono::minutes;

const Time kStart{hours(1000)};
const contract::Digest kScene = contract::sha256("scene"), kImage = contract::sha256("image");

TEST(OwnedAssets, AssetOfSeveralJobsCountsOnce) {
  OwnedAssets owned;
  owned.add_job("ann", kScene, 100);
  owned.add_job("ann", kScene, 100);
  owned.add_job("bob", kScene, 100);
  EXPECT_EQ(owned.bytes("ann", kStart), 100);
  owned.remove_job("ann", kScene);
  EXPECT_EQ(owned.bytes("ann", kStart), 100);
  owned.remove_job("ann", kScene);
  EXPECT_EQ(owned.bytes("ann", kStart), 0);
  EXPECT_EQ(owned.bytes("bob", kStart), 100);
}

TEST(OwnedAssets, UploadCountsForAnHour) {
  OwnedAssets owned;
  owned.add_upload("ann", kScene, 100, kStart);
  owned.add_upload("ann", kImage, 7, kStart + minutes(30));
  EXPECT_EQ(owned.bytes("ann", kStart + minutes(59)), 107);
  EXPECT_EQ(owned.bytes("ann", kStart + minutes(61)), 7);
  EXPECT_EQ(owned.bytes("ann", kStart + minutes(91)), 0);
}

TEST(OwnedAssets, RepeatedUploadStartsTheHourAgain) {
  OwnedAssets owned;
  owned.add_upload("ann", kScene, 100, kStart);
  owned.add_upload("ann", kScene, 100, kStart + minutes(30));
  EXPECT_EQ(owned.bytes("ann", kStart + minutes(61)), 100);
  EXPECT_EQ(owned.bytes("ann", kStart + minutes(91)), 0);
}

TEST(OwnedAssets, UploadThatAJobNamesStays) {
  OwnedAssets owned;
  owned.add_upload("ann", kScene, 100, kStart);
  owned.add_job("ann", kScene, 100);
  EXPECT_EQ(owned.bytes("ann", kStart), 100);
  EXPECT_EQ(owned.bytes("ann", kStart + hours(2)), 100);
  owned.remove_job("ann", kScene);
  EXPECT_EQ(owned.bytes("ann", kStart + hours(2)), 0);
}

TEST(OwnedAssets, FailedUploadDoesNotCount) {
  OwnedAssets owned;
  owned.add_upload("ann", kScene, 100, kStart);
  owned.drop_upload("ann", kScene);
  EXPECT_EQ(owned.bytes("ann", kStart), 0);
  EXPECT_EQ(owned.bytes("ann", kStart + hours(2)), 0);
}

TEST(OwnedAssets, NewAssetIsAddedToTheSum) {
  OwnedAssets owned;
  owned.add_job("ann", kScene, 100);
  EXPECT_EQ(owned.bytes_with("ann", kScene, 100, kStart), 100);
  EXPECT_EQ(owned.bytes_with("ann", kImage, 7, kStart), 107);
  EXPECT_EQ(owned.bytes_with("bob", kImage, 7, kStart), 7);
}

}  // namespace
}  // namespace tessera::server
