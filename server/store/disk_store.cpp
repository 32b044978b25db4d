#include "server/store/disk_store.h"

#include <filesystem>
#include <system_error>

namespace tessera::server {

absl::Status DiskStore::write_together(const std::function<void()>& body) {
  return reserve_.write_together(*journal_, body);
}

std::int64_t DiskStore::free_bytes() const {
  std::error_code error;
  const std::filesystem::space_info space = std::filesystem::space(folder_, error);
  return error ? 0 : static_cast<std::int64_t>(space.available);
}

std::int64_t DiskStore::used_bytes() const {
  return units_->file_bytes() + frames_->file_bytes() + assets_->file_bytes() +
         journal_->used_bytes();
}

}  // namespace tessera::server
