#include "tests/support/scene/folder_reader.h"

#include <fstream>
#include <sstream>

#include "absl/strings/str_cat.h"

namespace tessera::testing {

absl::StatusOr<std::span<const std::byte>> FolderReader::read(std::string_view uri) {
  auto found = files_.find(uri);
  if (found == files_.end()) {
    std::ifstream file(folder_ / std::filesystem::path(uri), std::ios::binary);
    if (!file) return absl::NotFoundError(absl::StrCat(std::string(uri), ": cannot be opened"));
    std::ostringstream bytes;
    bytes << file.rdbuf();
    found = files_.emplace(std::string(uri), std::move(bytes).str()).first;
  }
  return std::as_bytes(std::span(found->second));
}

}  // namespace tessera::testing
