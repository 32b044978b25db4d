#include "worker/renderer/sandbox.h"

#include <fcntl.h>
#include <seccomp.h>

#include <cerrno>
#include <cstdint>
#include <cstring>
#include <memory>

#include "absl/strings/str_cat.h"

// LeakSanitizer stops the threads of the process with ptrace when it exits.
#if defined(__SANITIZE_ADDRESS__)
#define TESSERA_LEAK_CHECK 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define TESSERA_LEAK_CHECK 1
#endif
#endif

namespace tessera::agent {
namespace {

constexpr std::uint32_t kDeny = SCMP_ACT_ERRNO(EPERM);

constexpr int kDeniedCalls[] = {
    // Network. io_uring executes requests that no filter sees.
    SCMP_SYS(socket),
    SCMP_SYS(connect),
    SCMP_SYS(bind),
    SCMP_SYS(listen),
    SCMP_SYS(accept),
    SCMP_SYS(accept4),
    SCMP_SYS(io_uring_setup),
    SCMP_SYS(io_uring_enter),
    SCMP_SYS(io_uring_register),
    // Other programs and processes.
    SCMP_SYS(execve),
    SCMP_SYS(execveat),
    SCMP_SYS(kill),
    SCMP_SYS(process_vm_readv),
    SCMP_SYS(process_vm_writev),
    SCMP_SYS(pidfd_open),
    SCMP_SYS(pidfd_getfd),
    SCMP_SYS(pidfd_send_signal),
#ifndef TESSERA_LEAK_CHECK
    SCMP_SYS(ptrace),
#endif
    // Files and names. Filters cannot see the flags of openat2.
    SCMP_SYS(creat),
    SCMP_SYS(openat2),
    SCMP_SYS(open_by_handle_at),
    SCMP_SYS(truncate),
    SCMP_SYS(unlink),
    SCMP_SYS(unlinkat),
    SCMP_SYS(rename),
    SCMP_SYS(renameat),
    SCMP_SYS(renameat2),
    SCMP_SYS(link),
    SCMP_SYS(linkat),
    SCMP_SYS(symlink),
    SCMP_SYS(symlinkat),
    SCMP_SYS(mkdir),
    SCMP_SYS(mkdirat),
    SCMP_SYS(rmdir),
    SCMP_SYS(mknod),
    SCMP_SYS(mknodat),
    SCMP_SYS(chmod),
    SCMP_SYS(fchmodat),
    SCMP_SYS(chown),
    SCMP_SYS(lchown),
    SCMP_SYS(fchownat),
    SCMP_SYS(setxattr),
    SCMP_SYS(lsetxattr),
    SCMP_SYS(utimensat),
    // System.
    SCMP_SYS(mount),
    SCMP_SYS(umount2),
    SCMP_SYS(chroot),
    SCMP_SYS(pivot_root),
    SCMP_SYS(unshare),
    SCMP_SYS(setns),
    SCMP_SYS(bpf),
    SCMP_SYS(perf_event_open),
    SCMP_SYS(userfaultfd),
    SCMP_SYS(add_key),
    SCMP_SYS(request_key),
    SCMP_SYS(keyctl),
};

/// Flags with which opening a file changes it or allows writing.
constexpr unsigned kWriteFlags[] = {O_WRONLY, O_RDWR, O_CREAT, O_TRUNC};

absl::Status check(int error, const char* step) {
  if (error >= 0) return absl::OkStatus();
  return absl::UnavailableError(absl::StrCat(step, ": ", std::strerror(-error)));
}

/// Denies `call` if its argument `index` has any of the bits of kWriteFlags.
absl::Status deny_writing(scmp_filter_ctx filter, int call, unsigned index) {
  for (const unsigned flag : kWriteFlags) {
    const scmp_arg_cmp has_flag{index, SCMP_CMP_MASKED_EQ, flag, flag};
    absl::Status status =
        check(seccomp_rule_add_array(filter, kDeny, call, 1, &has_flag), "seccomp_rule_add");
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status enter_sandbox() {
  const std::unique_ptr<void, void (*)(void*)> filter(seccomp_init(SCMP_ACT_ALLOW),
                                                      seccomp_release);
  if (filter == nullptr) return absl::UnavailableError("seccomp_init failed");
  // Calls of other architectures, x32 among them, kill the process. seccomp_load sets no_new_privs,
  // which lets an unprivileged process install a filter.
  absl::Status status = check(
      seccomp_attr_set(filter.get(), SCMP_FLTATR_ACT_BADARCH, SCMP_ACT_KILL_PROCESS), "seccomp");
  for (const int call : kDeniedCalls) {
    if (!status.ok()) return status;
    status = check(seccomp_rule_add(filter.get(), kDeny, call, 0), "seccomp_rule_add");
  }
  if (status.ok()) status = deny_writing(filter.get(), SCMP_SYS(open), 1);
  if (status.ok()) status = deny_writing(filter.get(), SCMP_SYS(openat), 2);
  if (status.ok()) status = check(seccomp_load(filter.get()), "seccomp_load");
  return status;
}

}  // namespace tessera::agent
