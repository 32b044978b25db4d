#include "client/local_farm/private_folder.h"

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <system_error>

namespace tessera::client {
namespace {

constexpr std::size_t kMaxParentLength = 80;  // a socket path has at most 107 characters

}  // namespace

std::string make_private_folder() {
  for (const char* parent : {static_cast<const char*>(std::getenv("TMPDIR")), "/tmp"}) {
    if (parent == nullptr || *parent != '/' || std::strlen(parent) > kMaxParentLength) continue;
    std::string path = std::string(parent) + "/tessera-XXXXXX";
    if (::mkdtemp(path.data()) != nullptr) return path;  // mode 0700
  }
  return {};
}

PrivateFolder::~PrivateFolder() {
  std::error_code ignored;
  if (!path_.empty()) std::filesystem::remove_all(path_, ignored);
}

}  // namespace tessera::client
