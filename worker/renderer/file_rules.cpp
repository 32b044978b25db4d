#include "worker/renderer/file_rules.h"

#include <fcntl.h>
#include <linux/landlock.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "worker/ipc/message_socket.h"

namespace tessera::agent {
namespace {

// The kernel's interface grows by version; Debian's header describes the first ones.
constexpr std::uint64_t kReadFile = LANDLOCK_ACCESS_FS_READ_FILE;
constexpr std::uint64_t kReadFolder = LANDLOCK_ACCESS_FS_READ_DIR;
constexpr std::uint64_t kExecute = LANDLOCK_ACCESS_FS_EXECUTE;
constexpr std::uint64_t kFirstVersionAccess = (std::uint64_t{1} << 13) - 1;
constexpr std::uint64_t kRefer = std::uint64_t{1} << 13;        // version 2
constexpr std::uint64_t kTruncate = std::uint64_t{1} << 14;     // version 3
constexpr std::uint64_t kNetwork = 3;                           // version 4: bind and connect, TCP
constexpr std::uint64_t kDeviceIoctl = std::uint64_t{1} << 15;  // version 5
constexpr std::uint64_t kScopes = 3;  // version 6: abstract Unix sockets, signals

struct Ruleset {
  std::uint64_t files, network, scopes;
};

/// Readable with everything below them. Those that are missing are left out.
constexpr std::array<const char*, 10> kReadable = {
    "/usr",          "/lib",       "/lib64",       "/etc/ld.so.cache",    "/proc/self",
    "/proc/meminfo", "/proc/stat", "/proc/sys/vm", "/sys/devices/system", "/etc/ssl/openssl.cnf"};

absl::Status refused(const char* step) {
  return absl::ErrnoToStatus(errno, step);
}

Ruleset ruleset_of(long version, std::size_t& size) {
  Ruleset rules{kFirstVersionAccess, 0, 0};
  size = sizeof rules.files;
  if (version >= 2) rules.files |= kRefer;
  if (version >= 3) rules.files |= kTruncate;
  if (version >= 4) {
    rules.network = kNetwork;
    size = offsetof(Ruleset, scopes);
  }
  if (version >= 5) rules.files |= kDeviceIoctl;
  if (version >= 6) {
    rules.scopes = kScopes;
    size = sizeof rules;
  }
  return rules;
}

absl::Status allow_reading(const Descriptor& ruleset, const std::string& path) {
  const Descriptor where(::open(path.c_str(), O_PATH | O_CLOEXEC));
  if (where.get() < 0) return absl::OkStatus();
  struct stat info {};
  if (::fstat(where.get(), &info) != 0) return refused("stat");
  landlock_path_beneath_attr rule{};
  // Libraries that are loaded late are mapped as code, which needs no right to execute files.
  rule.allowed_access = S_ISDIR(info.st_mode) ? kReadFile | kReadFolder : kReadFile;
  rule.parent_fd = where.get();
  if (::syscall(SYS_landlock_add_rule, ruleset.get(), LANDLOCK_RULE_PATH_BENEATH, &rule, 0) != 0) {
    return refused("landlock_add_rule");
  }
  return absl::OkStatus();
}

/// The directory of this program, empty if it is unknown.
std::string program_folder() {
  std::array<char, 4096> path{};
  const ssize_t size = ::readlink("/proc/self/exe", path.data(), path.size() - 1);
  const std::string program(path.data(), static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
  return program.substr(0, program.rfind('/') + 1);
}

}  // namespace

absl::StatusOr<bool> limit_file_access() {
  static_assert(kExecute <= kFirstVersionAccess);  // denied everywhere
  const long version =
      ::syscall(SYS_landlock_create_ruleset, nullptr, 0, LANDLOCK_CREATE_RULESET_VERSION);
  if (version < 1) return false;
  std::size_t size = 0;
  const Ruleset rules = ruleset_of(version, size);
  const Descriptor ruleset(
      static_cast<int>(::syscall(SYS_landlock_create_ruleset, &rules, size, 0)));
  if (ruleset.get() < 0) return refused("landlock_create_ruleset");
  for (const char* path : kReadable) {
    if (absl::Status status = allow_reading(ruleset, path); !status.ok()) return status;
  }
  if (absl::Status status = allow_reading(ruleset, program_folder()); !status.ok()) return status;
  if (::syscall(SYS_landlock_restrict_self, ruleset.get(), 0) != 0) {
    return refused("landlock_restrict_self");
  }
  return true;
}

}  // namespace tessera::agent
