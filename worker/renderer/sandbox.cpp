#include "worker/renderer/sandbox.h"

#include <fcntl.h>
#include <sched.h>
#include <seccomp.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "worker/renderer/file_rules.h"

namespace tessera::agent {
namespace {

constexpr int kAllowedCalls[] = {
    // Memory.
    SCMP_SYS(brk), SCMP_SYS(mmap), SCMP_SYS(munmap), SCMP_SYS(mprotect), SCMP_SYS(mremap),
    SCMP_SYS(madvise), SCMP_SYS(mincore), SCMP_SYS(membarrier),
    // Threads of this process.
    SCMP_SYS(futex), SCMP_SYS(set_robust_list), SCMP_SYS(get_robust_list), SCMP_SYS(rseq),
    SCMP_SYS(set_tid_address), SCMP_SYS(gettid), SCMP_SYS(getpid), SCMP_SYS(getppid),
    SCMP_SYS(sched_yield), SCMP_SYS(sched_getaffinity), SCMP_SYS(getcpu), SCMP_SYS(exit),
    SCMP_SYS(exit_group), SCMP_SYS(restart_syscall),
    // Signals of this process.
    SCMP_SYS(rt_sigaction), SCMP_SYS(rt_sigprocmask), SCMP_SYS(rt_sigreturn), SCMP_SYS(sigaltstack),
    // Time.
    SCMP_SYS(clock_gettime), SCMP_SYS(clock_getres), SCMP_SYS(clock_nanosleep), SCMP_SYS(nanosleep),
    SCMP_SYS(gettimeofday), SCMP_SYS(time), SCMP_SYS(times), SCMP_SYS(getrusage),
    // Open descriptors: scene files, the file for texels, the agent's socket, the log.
    SCMP_SYS(read), SCMP_SYS(readv), SCMP_SYS(pread64), SCMP_SYS(preadv), SCMP_SYS(write),
    SCMP_SYS(writev), SCMP_SYS(pwrite64), SCMP_SYS(pwritev), SCMP_SYS(lseek), SCMP_SYS(ftruncate),
    SCMP_SYS(fadvise64), SCMP_SYS(close), SCMP_SYS(fstat), SCMP_SYS(fcntl), SCMP_SYS(dup),
    SCMP_SYS(sendto), SCMP_SYS(recvfrom), SCMP_SYS(sendmsg), SCMP_SYS(recvmsg), SCMP_SYS(shutdown),
    SCMP_SYS(poll), SCMP_SYS(ppoll),
    // Reading files: libraries that are loaded late, and what the kernel says about processors and
    // memory. Opening is restricted below and by Landlock.
    SCMP_SYS(stat), SCMP_SYS(lstat), SCMP_SYS(newfstatat), SCMP_SYS(statx), SCMP_SYS(access),
    SCMP_SYS(faccessat), SCMP_SYS(faccessat2), SCMP_SYS(readlink), SCMP_SYS(readlinkat),
    SCMP_SYS(getcwd), SCMP_SYS(getdents64),
    // The system and the user.
    SCMP_SYS(uname), SCMP_SYS(sysinfo), SCMP_SYS(getrandom), SCMP_SYS(getrlimit), SCMP_SYS(getuid),
    SCMP_SYS(geteuid), SCMP_SYS(getgid), SCMP_SYS(getegid)};

constexpr int kSanitizerCalls[] = {SCMP_SYS(clone),      SCMP_SYS(ptrace), SCMP_SYS(wait4),
                                   SCMP_SYS(prctl),      SCMP_SYS(pipe2),  SCMP_SYS(personality),
                                   SCMP_SYS(arch_prctl), SCMP_SYS(tkill)};

/// Flags with which opening a file changes it or allows writing. O_TMPFILE contains O_DIRECTORY,
/// with which directories are read, but is useless without one of the first two.
constexpr unsigned kWriteFlags = O_WRONLY | O_RDWR | O_CREAT | O_TRUNC;

/// Builds the filter; keeps the first error.
class FilterBuilder {
 public:
  FilterBuilder() : filter_(seccomp_init(SCMP_ACT_ERRNO(EPERM)), seccomp_release) {
    if (filter_ == nullptr) {
      status_ = absl::UnavailableError("seccomp_init failed");
      return;
    }
    // Calls of other architectures, x32 among them, kill the process.
    check(seccomp_attr_set(filter_.get(), SCMP_FLTATR_ACT_BADARCH, SCMP_ACT_KILL_PROCESS),
          "seccomp_attr_set");
  }

  void allow(int call) { add(SCMP_ACT_ALLOW, call, {}); }
  /// Allows the call if all conditions on its arguments hold.
  void allow_if(int call, std::initializer_list<scmp_arg_cmp> conditions) {
    add(SCMP_ACT_ALLOW, call, conditions);
  }
  /// Makes the call fail with `error`.
  void fail_with(int error, int call) {
    add(SCMP_ACT_ERRNO(static_cast<std::uint32_t>(error)), call, {});
  }
  absl::Status load() {
    if (status_.ok()) check(seccomp_load(filter_.get()), "seccomp_load");
    return status_;
  }

 private:
  void add(std::uint32_t action, int call, std::initializer_list<scmp_arg_cmp> conditions) {
    if (!status_.ok()) return;
    check(seccomp_rule_add_array(filter_.get(), action, call,
                                 static_cast<unsigned>(conditions.size()), conditions.begin()),
          "seccomp_rule_add");
  }
  void check(int error, const char* step) {
    if (error < 0 && status_.ok()) {
      status_ = absl::UnavailableError(absl::StrCat(step, ": ", std::strerror(-error)));
    }
  }

  std::unique_ptr<void, void (*)(void*)> filter_;
  absl::Status status_;
};

scmp_arg_cmp equals(unsigned index, std::uint64_t value) {
  return {index, SCMP_CMP_EQ, value, 0};
}

/// All bits of `mask` of the argument are those of `value`.
scmp_arg_cmp has_bits(unsigned index, std::uint64_t mask, std::uint64_t value) {
  return {index, SCMP_CMP_MASKED_EQ, mask, value};
}

absl::Status install_filter() {
  FilterBuilder filter;
  for (const int call : kAllowedCalls) filter.allow(call);
  filter.allow_if(SCMP_SYS(open), {has_bits(1, kWriteFlags, 0)});
  filter.allow_if(SCMP_SYS(openat), {has_bits(2, kWriteFlags, 0)});
  // abort() and raise().
  filter.allow_if(SCMP_SYS(tgkill), {equals(0, static_cast<std::uint64_t>(::getpid()))});
  // Reading limits of this process.
  filter.allow_if(SCMP_SYS(prlimit64), {equals(0, 0), equals(2, 0)});
  // A filter cannot see the flags of clone3, so it fails as on an old kernel, and glibc uses clone.
  filter.fail_with(ENOSYS, SCMP_SYS(clone3));
  if (kHasSanitizer) {
    for (const int call : kSanitizerCalls) filter.allow(call);
  } else {
    filter.allow_if(SCMP_SYS(clone), {has_bits(0, CLONE_THREAD, CLONE_THREAD)});
    constexpr std::uint64_t kNameMemory = 0x53564d41;  // PR_SET_VMA, used by glibc
    for (const std::uint64_t option : {std::uint64_t{PR_SET_NAME}, kNameMemory}) {
      filter.allow_if(SCMP_SYS(prctl), {equals(0, option)});
    }
  }
  return filter.load();
}

}  // namespace

void limit_resources(std::int64_t memory_bytes) {
  if (memory_bytes > 0) {
    const auto bytes = static_cast<rlim_t>(memory_bytes);
    const rlimit limit{bytes, bytes};
    ::setrlimit(RLIMIT_DATA, &limit);
  }
  constexpr rlimit kFileLimit{kMaxFileBytes, kMaxFileBytes};
  ::setrlimit(RLIMIT_FSIZE, &kFileLimit);
}

absl::StatusOr<Confinement> enter_sandbox() {
  if (::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) {
    return absl::UnavailableError(absl::StrCat("no_new_privs: ", std::strerror(errno)));
  }
  Confinement confinement;
  if (!kHasSanitizer) {  // whose reports name lines of source files
    confinement.reads_are_limited = limit_file_access().value_or(false);
  }
  if (absl::Status status = install_filter(); !status.ok()) return status;
  return confinement;
}

}  // namespace tessera::agent
