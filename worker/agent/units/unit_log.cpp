#include "worker/agent/units/unit_log.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::agent {

absl::StatusOr<UnitLog> UnitLog::open(const std::string& path) {
  UnitLog log;
  log.file_ = Descriptor(::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644));
  if (!log.file_) {
    return absl::FailedPreconditionError(absl::StrCat(path, ": ", std::strerror(errno)));
  }
  return log;
}

void UnitLog::write(const char* event, const UnitKey& key, const std::string& more) {
  if (!file_) return;
  const std::string line =
      absl::StrCat(event, " ", to_string(key), more.empty() ? "" : " ", more, "\n");
  (void)!::write(file_.get(), line.data(), line.size());
}

}  // namespace tessera::agent
