#include "server/identity/revocations.h"

#include <sys/stat.h>

#include <utility>
#include <vector>

#include "absl/strings/str_split.h"
#include "server/identity/private_file.h"

namespace tessera::server {

Revocations::Revocations(std::string path) : path_(std::move(path)) {
  update();
}

bool Revocations::contains(const std::string& serial) const {
  const MutexLock lock(mutex_);
  return serials_.count(serial) != 0;
}

void Revocations::update() {
  struct stat info {};
  if (::stat(path_.c_str(), &info) != 0) return;
  const Version version{info.st_ino, info.st_size, info.st_mtim.tv_sec, info.st_mtim.tv_nsec};
  if (version == read_) return;
  const auto text = read_file(path_);
  if (!text.ok()) return;
  std::set<std::string> serials;
  const std::vector<std::string> lines = absl::StrSplit(*text, '\n');
  for (const std::string& line : lines) {
    if (!line.empty()) serials.insert(line.substr(0, line.find(' ')));
  }
  read_ = version;
  const MutexLock lock(mutex_);
  serials_ = std::move(serials);
}

}  // namespace tessera::server
