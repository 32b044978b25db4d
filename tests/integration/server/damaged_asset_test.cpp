// Scene files whose bytes have changed on the server's disk, but not their size.
#include <fstream>
#include <string>

#include "contract/digest.h"
#include "tests/integration/server/support/test_farm.h"

namespace tessera::server {
namespace {

class DamagedAsset : public TestFarm {
 protected:
  /// Changes the middle of the asset's file.
  void damage(const std::string& bytes) {
    const std::string hex = contract::sha256(bytes).hex();
    std::fstream file(folder_ + "/assets/" + hex.substr(0, 2) + "/" + hex.substr(2),
                      std::ios::binary | std::ios::in | std::ios::out);
    ASSERT_TRUE(file.good());
    file.seekp(static_cast<std::streamoff>(bytes.size() / 2));
    file << "damage";
  }

  const std::string bytes_ = std::string(2'500'000, 'x');  // a file, and several chunks
};

TEST_F(DamagedAsset, IsDeletedWhenItIsSent) {
  ASSERT_TRUE(upload(id_of(bytes_), bytes_).ok());
  damage(bytes_);
  std::string got;
  const grpc::Status status = download(id_of(bytes_), got);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::NOT_FOUND) << status.error_message();
  EXPECT_TRUE(is_missing(id_of(bytes_)));
  EXPECT_TRUE(upload(id_of(bytes_), bytes_).ok());
  got.clear();
  EXPECT_TRUE(download(id_of(bytes_), got).ok());
  EXPECT_TRUE(got == bytes_) << got.size() << " bytes";
}

}  // namespace
}  // namespace tessera::server
